"""Lexicons open for reading: gloss -> clip, of one source of words or of several, in which the first that has a word
counts.

Sources are folders that ``builder`` has written (``store``), forms of the signs that ship, written signs, and other
lexicons. What the synthetic signer makes is imported when a word is asked for that no folder has.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from functools import cached_property, lru_cache
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.gloss import LETTER_MARK, Entry, Suggestions, fold, gloss_of
from signsplice.lexicon.store import BUILD_HINT, SourceWord, StoredWords
from signsplice.motion import Clip, copy_unchecked
from signsplice.progress import Progress

if TYPE_CHECKING:
    from signsplice.signer.phonology import Sign
    from signsplice.written.tree import WrittenSign

SHIPPED = Path(__file__).parent / "words"
DEFAULT = "default"
"""The name by which the words that ship are opened."""
_MIN_SIMILARITY = 0.55
"""Least similarity of the glosses that ``nearest`` suggests."""
_N_KEPT = 64
"""Signs that are kept once signed: one takes a quarter of a second."""


class Source(Protocol):
    """What a lexicon asks of a source of words. Those that inherit from it list no words, and store nothing.

    path: its folder or file.
    where: as messages name it; empty where they do not.
    form: how rotations are stored; empty where nothing is.
    n_bytes: size of what is stored of frames.
    """

    path: Path
    where: str
    form: str
    n_bytes: int

    def find(self, name: str) -> SourceWord | None:
        """The word with this gloss or synonym, None where there is none."""

    def lists(self, name: str) -> bool:
        """Whether it is the gloss or a synonym of a word in ``entries``."""
        return False

    def names(self) -> list[tuple[str, str, bool]]:
        """(folded, shown, is a gloss) of every gloss and synonym in ``entries``."""
        return []

    def entries(self) -> Iterator[Entry]:
        """The entries of the words that are listed, sorted by gloss."""
        return iter(())

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """What is damaged, one line each."""
        return iter(())

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """What a user should know about the words, one line each."""
        return iter(())

    def verify(self) -> None:
        """Raise ``InputError`` where something is damaged."""
        return

    def close(self) -> None:
        """Close what is open."""
        return


class Lexicon:
    """A lexicon open for reading: a mapping of glosses to clips, for any number of threads.

    It is made of folders of lexicons and of other sources. A name stands for the word of the first source that has it
    as a gloss or synonym; a word whose gloss an earlier source has cannot be found. Look-up accepts names in any case;
    ``len`` and iteration cover the glosses that are listed. A context manager that closes its sources; clips remain
    valid after that. Raises ``InputError`` where a folder holds no valid lexicon of this version or an earlier one.

    sources: in the order in which they are asked.
    path: of the first source. where, form, n_bytes: as of ``Source``, of all.
    """

    def __init__(self, first: str | Path | Source, *others: str | Path | Source) -> None:
        self.sources: tuple[Source, ...] = tuple(
            StoredWords(source) if isinstance(source, (str, Path)) else source for source in (first, *others)
        )
        self.path = self.sources[0].path
        self.where = " and ".join(filter(None, (source.where for source in self.sources)))
        self.form = " and ".join(dict.fromkeys(filter(None, (source.form for source in self.sources))))
        self.n_bytes = sum(source.n_bytes for source in self.sources)

    def __enter__(self) -> Lexicon:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __reduce__(self) -> tuple[type[Lexicon], tuple[Source, ...]]:
        return type(self), self.sources

    def close(self) -> None:
        """Close every source."""
        for source in self.sources:
            source.close()

    def __len__(self) -> int:
        return len(self.glosses)

    def __iter__(self) -> Iterator[str]:
        return iter(self.glosses)

    def __contains__(self, gloss: object) -> bool:
        return isinstance(gloss, str) and self.find(gloss) is not None

    def lists(self, name: object) -> bool:
        """Whether it is the gloss or a synonym of a word that is listed."""
        return isinstance(name, str) and any(source.lists(name) for source in self.sources)

    def names(self) -> list[tuple[str, str, bool]]:
        """(folded, shown, is a gloss) of every gloss and synonym that is listed."""
        rows = {row[0]: row for source in reversed(self.sources) for row in source.names()}
        return list(rows.values())

    @cached_property
    def glosses(self) -> tuple[str, ...]:
        """The glosses of all words that are listed, sorted; without synonyms."""
        return tuple(sorted(shown for _, shown, is_gloss in self.names() if is_gloss))

    def entries(self) -> Iterator[Entry]:
        """The entries of all words that are listed, in the order of ``glosses``."""
        return (entry for entry, _ in self._entry_names)

    def search(self, text: str) -> list[Entry]:
        """Entries with ``text`` in their gloss or a synonym, in any case; those that begin with it come first."""
        wanted = fold(text)
        matches = [(entry, names) for entry, names in self._entry_names if any(wanted in name for name in names)]
        matches.sort(key=lambda match: not any(name.startswith(wanted) for name in match[1]))
        return [entry for entry, _ in matches]

    def find(self, name: str) -> SourceWord | None:
        """The word that a name stands for, None where no source has it."""
        for n, source in enumerate(self.sources):
            word = source.find(name)
            if word is not None:
                # A synonym of a word whose gloss an earlier source has: the sign of that name is the earlier one's.
                is_hidden = any(earlier.find(word.gloss) for earlier in self.sources[:n])
                return self.find(word.gloss) if is_hidden else word
        return None

    def entry(self, gloss: str) -> Entry:
        """The entry of the word with this gloss or synonym. Raises ``UnknownGlossError``, which names similar ones."""
        return self._word(gloss).entry()

    def clip(self, gloss: str) -> Clip:
        """The clip of the word with this gloss or synonym, named by its gloss.

        Clips of one rig in one folder share one skeleton object; clips of several sources may differ in rig and rate.
        Raises ``UnknownGlossError``, or ``InputError`` for a damaged word.
        """
        return self._word(gloss).clip()

    def extensions(self, gloss: str) -> dict[str, bytes]:
        """What is stored with the word with this gloss or synonym by other names than this version reads, or writes by
        ``Builder.add``: name -> bytes. Raises ``UnknownGlossError``.
        """
        return self._word(gloss).extensions()

    def nearest(self, gloss: str, n: int = 3, similarity: float = _MIN_SIMILARITY) -> tuple[str, ...]:
        """Up to ``n`` glosses and synonyms most like ``gloss``: those that have it between hyphens, then those of at
        least that ``similarity``, best first. Letters only for what begins as they do.

        The similarity of two words is twice the number of letters that both have in the same order, over the number of
        letters of both. Of words equally like, those come first that fewer edits lead to; two neighbours that change
        places are one edit.
        """
        return tuple(self._display_names[name] for name in self._suggestions.nearest(fold(gloss), n, similarity))

    def find_hyphenated_gloss(self, word: str) -> str | None:
        """The gloss that ``word`` is without its hyphens (THANKYOU: THANK-YOU), None where there is none."""
        shown = self._without_hyphens.get(fold(word))
        return None if shown is None else self.entry(shown).gloss

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """Faults of the words, one line each: checks bytes, hashes and names against the index. Reads every frame."""
        return (line for source in self.sources for line in source.faults(progress))

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """What a user should know about words that can be read, one line each."""
        return (line for source in self.sources for line in source.warnings(progress))

    def verify(self) -> None:
        """Compare every entry, and the bytes of every word, with their SHA-256. Raises ``InputError`` at the first that
        is another.

        Quicker than ``faults``, which decodes the words too: about a second for each GB.
        """
        for source in self.sources:
            source.verify()

    def _word(self, gloss: str) -> SourceWord:
        word = self.find(gloss)
        if word is None:
            raise UnknownGlossError({gloss: self.nearest(gloss)}, self.where)
        return word

    @cached_property
    def _entry_names(self) -> list[tuple[Entry, list[str]]]:
        """Every entry that is listed and its names, folded, in the order of ``glosses``."""
        rows, seen = list[tuple[Entry, list[str]]](), set[str]()
        for source in self.sources:
            named = [(entry, [fold(name) for name in (entry.gloss, *entry.synonyms)]) for entry in source.entries()]
            rows += (row for row in named if row[1][0] not in seen)
            seen |= {name for _, names in named for name in names}
        return sorted(rows, key=lambda row: row[0].gloss)

    @cached_property
    def _display_names(self) -> dict[str, str]:
        return {folded: shown for folded, shown, _ in self.names()}

    @cached_property
    def _suggestions(self) -> Suggestions:
        return Suggestions(self._display_names)

    @cached_property
    def _without_hyphens(self) -> dict[str, str]:
        return {
            folded.replace("-", ""): shown
            for folded, shown in self._display_names.items()
            if "-" in folded and not folded.startswith(LETTER_MARK)
        }


SignT = TypeVar("SignT", bound="Sign | WrittenSign")


class SignedWords(Source, Generic[SignT]):
    """A source whose words the synthetic signer makes when they are asked for. It lists none and stores nothing.

    path, where, form, n_bytes: as of ``Source``.
    """

    where = form = ""
    n_bytes = 0

    def __init__(self, path: Path) -> None:
        self.path = path
        self._find_sign, self._make = lru_cache(_N_KEPT)(self.find_sign), lru_cache(_N_KEPT)(self._make_word)

    @abstractmethod
    def find_sign(self, name: str) -> SignT | None:
        """The sign that a name stands for, None where there is none."""

    @abstractmethod
    def make_clip(self, sign: SignT) -> tuple[Clip, str, str]:
        """The clip of a sign, who signs it, and where it comes from."""

    def find(self, name: str) -> SourceWord | None:
        """The word that a name stands for, None where there is none."""
        sign = self._find_sign(name)
        if sign is None:
            return None
        return SourceWord(gloss_of(sign.gloss), lambda: self._make(sign)[0], lambda: self._make(sign)[1])

    def _make_word(self, sign: SignT) -> tuple[Entry, Clip]:
        from signsplice.lexicon.builder import prepare

        clip, signer, source = self.make_clip(sign)
        return prepare(clip, "float32").entry(gloss_of(sign.gloss), "sign", (), signer, source), clip


class FormsOfSigns(SignedWords["Sign"]):
    """Every form of the signs that ship that ``signer.inflection`` makes: I-GIVE-YOU, 2-GIVE-1, BOOK-PLURAL.

    words: those that ship, whose skeleton the clips of forms share.
    """

    def __init__(self, words: StoredWords) -> None:
        super().__init__(words.path)
        self._words = words

    def __reduce__(self) -> tuple[type[FormsOfSigns], tuple[StoredWords]]:
        return type(self), (self._words,)

    @cached_property
    def _signs(self) -> dict[str, Sign]:
        """The signs of the words that ship, by gloss and synonym."""
        from signsplice.signer import notation

        return {name: sign for sign in notation.everyday().values() for name in (*sign.synonyms, sign.gloss)}

    def find_sign(self, name: str) -> Sign | None:
        """The form that a gloss names, None where there is none."""
        if "-" not in name:
            return None
        from signsplice.signer import inflection

        with suppress(InputError):
            return inflection.form(self._signs, name.upper())
        return None

    def make_clip(self, sign: Sign) -> tuple[Clip, str, str]:
        """The clip of a form, named by its gloss (2-GIVE-1)."""
        from signsplice.signer import planner

        words, made = Lexicon(self._words), planner.synthesize_word(sign)
        clip = copy_unchecked(made.clip, skeleton=words.clip(words.glosses[0]).skeleton)
        return clip, made.signer.name, sign.source


class WrittenWords(SignedWords["WrittenSign"]):
    """The signs of a file or folder of written signs (SiGML, HamNoSys)."""

    def __init__(self, path: str | Path) -> None:
        from signsplice.written import files

        super().__init__(Path(path))
        self._signs = {fold(gloss_of(gloss)): sign for gloss, sign in files.read(path).signs.items()}

    def __reduce__(self) -> tuple[type[WrittenWords], tuple[Path]]:
        return type(self), (self.path,)

    def find_sign(self, name: str) -> WrittenSign | None:
        """The sign with this gloss, None where there is none."""
        return self._signs.get(fold(name))

    def make_clip(self, sign: WrittenSign) -> tuple[Clip, str, str]:
        """The clip of a sign, of no named signer."""
        from signsplice.written import signing

        return signing.animate_sign(sign), "", str(self.path)


def open_lexicon(
    path: str | Path | None = None, *others: str | Path | None, fallback: str | Path | None = None
) -> Lexicon:
    """Open the lexicon in a folder; without one, by the name ``default`` or in that of the words that ship, those with
    the forms of their signs. With ``others`` they are opened as one, in which the first that has a word counts.

    fallback: file or folder of written signs for the glosses that all of them lack. Raises ``InputError`` where there
    is no such folder or file, or it is damaged or newer than this version of signsplice.
    """
    sources = list[Source]()
    with ExitStack() as stack:
        for folder in map(lexicon_folder, (path, *others)):
            words = _open_stored_words(folder)
            stack.enter_context(closing(words))
            sources += [words, FormsOfSigns(words)] if folder.resolve() == SHIPPED.resolve() else [words]
        sources += [] if fallback is None else [WrittenWords(fallback)]
        stack.pop_all()
    return Lexicon(*sources)


def open_shipped_lexicon() -> Lexicon:
    """Open the words that ship with the package, without forms. Raises ``InputError`` where this build has none."""
    return Lexicon(_open_stored_words(SHIPPED))


def lexicon_folder(path: str | Path | None) -> Path:
    """The folder of a lexicon as ``open_lexicon`` takes it."""
    return SHIPPED if path is None or str(path) == DEFAULT else Path(path)


def _open_stored_words(folder: Path) -> StoredWords:
    if folder == SHIPPED and not SHIPPED.is_dir():
        raise InputError(f"no words ship with this build of signsplice; name a lexicon, or {BUILD_HINT}")
    return StoredWords(folder)
