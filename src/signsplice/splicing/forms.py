"""The words that ship with the forms of their signs: I-GIVE-YOU, 2-GIVE-1, BOOK-PLURAL.

No clip of a form ships: the synthetic signer makes it from the notation of its word when it is asked for. It stands
here because it joins two rooms, ``lexicon`` and ``synth``, that do not know each other.
"""

from __future__ import annotations

from contextlib import ExitStack, suppress
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from signsplice.errors import InputError
from signsplice.lexicon.entry import Entry
from signsplice.lexicon.frames import encode, fingerprint
from signsplice.lexicon.index import describe, sha256
from signsplice.lexicon.joined import JoinedLexicon
from signsplice.lexicon.preparing import rest_frames
from signsplice.lexicon.reader import SHIPPED, Lexicon, shipped
from signsplice.motion.clip import Clip, unchecked_copy

if TYPE_CHECKING:
    from signsplice.signer.phonology import Sign

DEFAULT = "default"
"""The name by which the words that ship are opened."""
_N_KEPT = 64
"""Forms that are kept once signed: one takes a quarter of a second."""


class WordsWithForms(Lexicon):
    """The lexicon that ships, which also has every form of its signs that ``signer.inflection`` can make: in ``in``,
    ``entry`` and ``clip``, and in no list.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._form, self._signed = lru_cache(_N_KEPT)(self._find_form), lru_cache(_N_KEPT)(self._sign)

    def __contains__(self, gloss: object) -> bool:
        return self.lists(gloss) or (isinstance(gloss, str) and self._form(gloss) is not None)

    def entry(self, gloss: str) -> Entry:
        """The entry of a word, or of a form, whose ``source`` is its word's. Raises as ``Lexicon.entry`` does."""
        form = None if self.lists(gloss) else self._form(gloss)
        return super().entry(gloss) if form is None else self._signed(form)[0]

    def clip(self, gloss: str) -> Clip:
        """The clip of a word, or of a form, named by its gloss (2-GIVE-1). Raises as ``Lexicon.clip`` does."""
        form = None if self.lists(gloss) else self._form(gloss)
        return super().clip(gloss) if form is None else self._signed(form)[1]

    @cached_property
    def _signs(self) -> dict[str, Sign]:
        """The signs of the words that ship, by gloss and synonym."""
        from signsplice.signer import notation

        return {name: sign for sign in notation.everyday().values() for name in (*sign.synonyms, sign.gloss)}

    def _find_form(self, gloss: str) -> Sign | None:
        """The form that a gloss names, None where there is none."""
        if "-" not in gloss:
            return None
        from signsplice.signer import inflection

        with suppress(InputError):
            return inflection.form(self._signs, gloss.upper())
        return None

    def _sign(self, form: Sign) -> tuple[Entry, Clip]:
        """The entry and the clip of a form."""
        from signsplice.signer import planner

        word = planner.isolated(form)
        clip = unchecked_copy(word.clip, skeleton=super().clip(self.glosses[0]).skeleton)
        found = fingerprint(encode(clip, "float32"), sha256(describe(clip.skeleton)), clip.fps, len(clip))
        before, after = rest_frames(clip)
        entry = Entry(
            form.gloss, "sign", (), clip.fps, len(clip), word.signer.name, form.source, False, before, after, found
        )
        return entry, clip


def open_lexicon(path: str | Path | None = None, *others: str | Path) -> Lexicon:
    """Open the lexicon in a folder; without one, by the name ``default`` or in that of the words that ship, those with
    the forms of their signs. With ``others`` they are opened as one, in which the first that has a word counts.

    Raises ``InputError`` where there is none, or it is damaged or newer than this version of signsplice.
    """
    with ExitStack() as held:
        parts = [held.enter_context(_opened(one)) for one in (path, *others)]
        held.pop_all()
    return JoinedLexicon(parts) if others else parts[0]


def _opened(path: str | Path | None) -> Lexicon:
    folder = lexicon_folder(path)
    return shipped(WordsWithForms) if folder.resolve() == SHIPPED.resolve() else Lexicon(folder)


def lexicon_folder(path: str | Path | None) -> Path:
    """The folder of a lexicon as ``open_lexicon`` takes it."""
    return SHIPPED if path is None or str(path) == DEFAULT else Path(path)
