"""Lexicons open for reading: gloss -> clip, from one or several sources of words; the first that has a word wins.

Sources are folders written by ``builder`` (``store``), forms of the shipped signs, written signs, and other lexicons.
The synthetic signer is imported only for words that no folder has.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.gloss import Entry, Suggestions, fold, gloss_of, kind_of, plain, readings
from signsplice.lexicon.languages import ALPHABETS, read_languages
from signsplice.lexicon.store import BUILD_HINT, OWNS, REBUILD, SourceWord, StoredWords, owns_extension
from signsplice.motion import Clip, copy_unchecked
from signsplice.progress import Progress
from signsplice.rig.roles import CHANNELS

if TYPE_CHECKING:
    from signsplice.lexicon.recordings import GlossRow
    from signsplice.signer.phonology import Sign
    from signsplice.written.tree import WrittenSign

SHIPPED = Path(__file__).parent / "words"
INDEX_TABLE = "index.csv"
"""The table of a lexicon of spoken-to-signed (``IndexedWords``)."""
DEFAULT = "default"
"""Name of the shipped lexicon."""
_SHIPPED_LANGUAGE = "ase"
"""Signed language whose signs the shipped words imitate; no signer has checked them."""
_MIN_SIMILARITY = 0.55
"""Minimum similarity of the glosses that ``nearest`` suggests."""
_N_KEPT = 64
"""Animated signs, and words fitted to landmarks, kept in memory: these take a quarter of a second and 15 ms."""
_N_ENTRIES = 10_000
"""Entries of words kept in memory."""


class Source(Protocol):
    """Interface of a source of words. By default a source lists no words and stores nothing.

    path: its folder or file.
    where: its name in messages; empty if they do not name it.
    form: how rotations are stored; empty if nothing is stored.
    n_bytes: size of the stored frames.
    language: code of the signed language of its words; empty if unknown.
    """

    path: Path
    where: str
    form: str
    n_bytes: int
    language: str = ""

    def find(self, name: str) -> SourceWord | None:
        """Return the word with this gloss or synonym, or None."""

    def lists(self, name: str) -> bool:
        """Return whether ``name`` is a gloss or synonym of a word in ``entries``."""
        return False

    def names(self) -> list[tuple[str, str, bool]]:
        """Return (folded, shown, is a gloss) for every gloss and synonym in ``entries``."""
        return []

    def entries(self) -> Iterator[Entry]:
        """Return the entries of the listed words, sorted by gloss."""
        return iter(())

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """Return faults of the words, one line each."""
        return iter(())

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """Return warnings about the words, one line each."""
        return iter(())

    def verify(self) -> None:
        """Raise ``InputError`` if something is damaged."""
        return

    def close(self) -> None:
        """Close open files."""
        return


class Lexicon:
    """A lexicon open for reading: a thread-safe mapping of glosses to clips.

    It combines folders of lexicons and other sources. A name stands for the word of the first source that has it as a
    gloss or synonym; an earlier source's gloss hides the same gloss of later sources. Look-up ignores case; ``len`` and
    iteration cover the listed glosses. As a context manager it closes its sources; clips remain valid afterwards.
    Raises ``InputError`` if a folder holds no valid lexicon of this version or an earlier one.

    sources: in order of look-up.
    path: of the first source. where, form, n_bytes: as in ``Source``, for all sources.
    language: code of the signed language of its sentences: the given one, whose sources then come first, else that of
        the first source that names one; empty if none does.
    """

    def __init__(self, first: str | Path | Source, *others: str | Path | Source, language: str = "") -> None:
        sources = [StoredWords(source) if isinstance(source, (str, Path)) else source for source in (first, *others)]
        sources.sort(key=lambda source: bool(language) and source.language not in ("", language))
        self.sources: tuple[Source, ...] = tuple(sources)
        self._given_language = language
        self.language = language or next((source.language for source in sources if source.language), "")
        self.path = self.sources[0].path
        self.where = " and ".join(filter(None, (source.where for source in self.sources)))
        self.form = " and ".join(dict.fromkeys(filter(None, (source.form for source in self.sources))))
        self.n_bytes = sum(source.n_bytes for source in self.sources)

    def __enter__(self) -> Lexicon:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __reduce__(self) -> tuple[partial[Lexicon], tuple[Source, ...]]:
        return partial(type(self), language=self._given_language), self.sources

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
        """Return whether ``name`` is a gloss or synonym of a listed word."""
        return isinstance(name, str) and any(source.lists(name) for source in self.sources)

    def names(self) -> list[tuple[str, str, bool]]:
        """Return (folded, shown, is a gloss) for every listed gloss and synonym."""
        rows = {row[0]: row for source in reversed(self.sources) for row in source.names()}
        return list(rows.values())

    @cached_property
    def glosses(self) -> tuple[str, ...]:
        """Glosses of all listed words, sorted, without synonyms."""
        return tuple(sorted(shown for _, shown, is_gloss in self.names() if is_gloss))

    def entries(self) -> Iterator[Entry]:
        """Return the entries of all listed words, in the order of ``glosses``."""
        return (entry for entry, _ in self._entry_names)

    def search(self, text: str) -> list[Entry]:
        """Return entries with ``text`` in their gloss or a synonym, in any case; prefix matches come first."""
        folded = fold(text)
        matches = [(entry, names) for entry, names in self._entry_names if any(folded in name for name in names)]
        matches.sort(key=lambda match: not any(name.startswith(folded) for name in match[1]))
        return [entry for entry, _ in matches]

    def find(self, name: str) -> SourceWord | None:
        """Return the word that a name stands for, or None if no source has it."""
        for n, source in enumerate(self.sources):
            word = source.find(name)
            if word is not None:
                # If this is a synonym of a word whose gloss an earlier source has, the earlier word wins.
                is_hidden = any(earlier.find(word.gloss) for earlier in self.sources[:n])
                return self.find(word.gloss) if is_hidden else word
        return None

    def match(self, text: str) -> str | None:
        """Return the gloss that a text stands for, also without accents, marks, variant (tell: TO-TELL1^) and hyphens
        (thankyou); None if there is none. Finds no forms of signs.
        """
        shown = text if self.lists(text) else self._by_reading.get(plain(text))
        return None if shown is None else self._word(shown).gloss

    def entry(self, gloss: str) -> Entry:
        """Return the entry for a gloss or synonym. Raises ``UnknownGlossError``, which names similar glosses."""
        return self._word(gloss).entry()

    def clip(self, gloss: str) -> Clip:
        """Return the clip for a gloss or synonym, named by its gloss.

        Clips of one rig in one folder share one skeleton object; clips of several sources may differ in rig and rate.
        Raises ``UnknownGlossError``, or ``InputError`` for a damaged word.
        """
        return self._word(gloss).clip()

    def extensions(self, gloss: str) -> dict[str, bytes]:
        """Return the extensions stored with the word for a gloss or synonym, e.g. by ``Builder.add``: name -> bytes.
        Raises ``UnknownGlossError``.
        """
        return self._word(gloss).extensions()

    def owns(self, gloss: str) -> frozenset[str] | None:
        """Return the channels of the word's own for a gloss or synonym, some of ``roles.CHANNELS``; None if a rule
        decides. Ignores channels of newer versions. Raises ``UnknownGlossError``, or ``InputError`` for damaged bytes.
        """
        stored = self.extensions(gloss).get(OWNS)
        try:
            return None if stored is None else frozenset(CHANNELS).intersection(stored.decode().split(";"))
        except UnicodeDecodeError as error:
            raise InputError(f"{self.where}: the channels of the word {gloss[:40]!r} are damaged; {REBUILD}") from error

    def language_of(self, gloss: str) -> str:
        """Return the code of the signed language of a word, for a gloss or synonym; where nothing names it, that with
        which the lexicon was opened, else an empty text. Raises ``UnknownGlossError``.
        """
        return self._word(gloss).signed_language() or self._given_language

    def nearest(self, gloss: str, n: int = 3, similarity: float = _MIN_SIMILARITY) -> tuple[str, ...]:
        """Return up to ``n`` glosses and synonyms most similar to ``gloss``: first those that contain it between
        hyphens, then those of at least ``similarity``, best first; letters only if ``gloss`` begins as they do.

        The similarity of two words is twice the length of their longest common subsequence, divided by the sum of
        their lengths. Ties are ordered by edit distance, in which a swap of two neighbours is one edit.
        """
        return tuple(self._display_names[name] for name in self._suggestions.nearest(plain(gloss), n, similarity))

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """Yield faults of the words, one line each: checks bytes, hashes and names against the index. Reads all."""
        return (line for source in self.sources for line in source.faults(progress))

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """Yield warnings about readable words, one line each."""
        return (line for source in self.sources for line in source.warnings(progress))

    def verify(self) -> None:
        """Compare every entry, and the bytes of every word, with their SHA-256. Raises ``InputError`` at the first
        mismatch.

        Faster than ``faults``, which also decodes the words: about one second per GB.
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
        """Every listed entry and its folded names, in the order of ``glosses``."""
        rows, seen = list[tuple[Entry, list[str]]](), set[str]()
        for source in self.sources:
            named = [(entry, [fold(name) for name in (entry.gloss, *entry.synonyms)]) for entry in source.entries()]
            rows += (row for row in named if row[1][0] not in seen)
            seen |= {name for _, names in named for name in names}
        return sorted(rows, key=lambda row: row[0].gloss)

    @cached_property
    def _display_names(self) -> dict[str, str]:
        """Every name that typed words are compared with, by its plain letters; that of the first source counts."""
        names = [
            source.glosses if isinstance(source, WrittenWords) else [shown for _, shown, _ in source.names()]
            for source in self.sources
        ]
        found = {plain(name): name for name in reversed([*chain(*names)])}
        return dict(reversed(found.items()))

    @cached_property
    def _by_reading(self) -> dict[str, str]:
        """The same names by their ``readings``; the first of the best counts."""
        rows = [[(key, name) for key in readings(name)] for name in self._display_names.values()]
        return dict(reversed([*chain(*zip(*rows, strict=True))]))

    @cached_property
    def _suggestions(self) -> Suggestions:
        return Suggestions(self._display_names)


SignT = TypeVar("SignT", bound="Sign | WrittenSign")


class SignedWords(Source, Generic[SignT]):
    """A source whose words the synthetic signer makes on demand. It lists no words and stores nothing.

    path, where, form, n_bytes, language: as in ``Source``.
    """

    where = form = language = ""
    n_bytes = 0

    def __init__(self, path: Path) -> None:
        self.path = path
        self._find_sign, self._make = lru_cache(_N_KEPT)(self.find_sign), lru_cache(_N_KEPT)(self._make_word)

    @abstractmethod
    def find_sign(self, name: str) -> SignT | None:
        """Return the sign that a name stands for, or None."""

    @abstractmethod
    def make_clip(self, sign: SignT) -> tuple[Clip, str, str]:
        """Return the clip of a sign, its signer and its source."""

    @abstractmethod
    def owned_channels(self, sign: SignT) -> frozenset[str]:
        """Return the channels that are a sign's own."""

    def find(self, name: str) -> SourceWord | None:
        """Return the word that a name stands for, or None."""
        sign = self._find_sign(name)
        if sign is None:
            return None
        return SourceWord(
            gloss_of(sign.gloss),
            lambda: self._make(sign)[0],
            lambda: self._make(sign)[1],
            lambda: owns_extension(self.owned_channels(sign)),
            self.language,
        )

    def _make_word(self, sign: SignT) -> tuple[Entry, Clip]:
        from signsplice.lexicon.builder import prepare

        clip, signer, source = self.make_clip(sign)
        gloss = gloss_of(sign.gloss)
        return prepare(clip, "float32").entry(gloss, kind_of(gloss), (), signer, source), clip


class SignsInNotation(SignedWords["Sign"]):
    """Signs that the package holds in notation."""

    def make_clip(self, sign: Sign) -> tuple[Clip, str, str]:
        """Return the clip of a sign, its signer and its source."""
        from signsplice.signer import planner

        signed_word = planner.synthesize_word(sign)
        return signed_word.clip, signed_word.signer.name, sign.source

    def owned_channels(self, sign: Sign) -> frozenset[str]:
        """Return the channels that are a sign's own."""
        from signsplice.signer import phonology

        return phonology.owned_channels(sign)


class FormsOfSigns(SignsInNotation):
    """All forms that ``signer.inflection`` makes of the shipped signs: I-GIVE-YOU, 2-GIVE-1, BOOK-PLURAL.

    words: the shipped words, whose skeleton the clips of forms share.
    """

    language = _SHIPPED_LANGUAGE

    def __init__(self, words: StoredWords) -> None:
        super().__init__(words.path)
        self._words = words

    def __reduce__(self) -> tuple[type[FormsOfSigns], tuple[StoredWords]]:
        return type(self), (self._words,)

    @cached_property
    def _signs(self) -> dict[str, Sign]:
        """The shipped signs by gloss and synonym."""
        from signsplice.signer import notation

        return {name: sign for sign in notation.everyday().values() for name in (*sign.synonyms, sign.gloss)}

    def find_sign(self, name: str) -> Sign | None:
        """Return the form that a gloss names, or None."""
        if "-" not in name:
            return None
        from signsplice.signer import inflection

        with suppress(InputError):
            return inflection.form(self._signs, name.upper())
        return None

    def make_clip(self, sign: Sign) -> tuple[Clip, str, str]:
        """Return the clip of a form, named by its gloss (2-GIVE-1)."""
        words, (clip, signer, source) = Lexicon(self._words), super().make_clip(sign)
        return copy_unchecked(clip, skeleton=words.clip(words.glosses[0]).skeleton), signer, source


class ShippedLetters(SignsInNotation):
    """The letters and digits of the manual alphabets that ship in notation (``languages.ALPHABETS``): fs-A@GSG."""

    def __init__(self) -> None:
        super().__init__(SHIPPED)

    def __reduce__(self) -> tuple[type[ShippedLetters], tuple[()]]:
        return type(self), ()

    @cached_property
    def _signs(self) -> dict[str, Sign]:
        from signsplice.signer import notation

        signs = [(code, sign) for code in ALPHABETS for sign in notation.alphabet(code).values()]
        return {
            fold(f"{sign.gloss}@{code}"): replace(sign, gloss=f"{sign.gloss}@{code.upper()}") for code, sign in signs
        }

    def find(self, name: str) -> SourceWord | None:
        """Return the letter with this gloss, or None."""
        word = super().find(name) if "@" in name else None
        return word and replace(word, language=word.gloss[-3:].lower())

    def find_sign(self, name: str) -> Sign | None:
        """Return the letter with this gloss, or None."""
        return self._signs.get(fold(name))


class WrittenWords(SignedWords["WrittenSign"]):
    """The signs of a file or folder of written signs (SiGML, HamNoSys).

    glosses: of all signs.
    """

    def __init__(self, path: str | Path) -> None:
        from signsplice.written import files

        super().__init__(Path(path))
        self.where = str(path)
        self._signs = {fold(gloss_of(gloss)): sign for gloss, sign in files.read(path).signs.items()}
        self.glosses = [gloss_of(sign.gloss) for sign in self._signs.values()]

    def __reduce__(self) -> tuple[type[WrittenWords], tuple[Path]]:
        return type(self), (self.path,)

    def find_sign(self, name: str) -> WrittenSign | None:
        """Return the sign with this gloss, or None."""
        return self._signs.get(fold(name))

    def make_clip(self, sign: WrittenSign) -> tuple[Clip, str, str]:
        """Return the clip of a sign, without a named signer."""
        from signsplice.written import signing

        return signing.animate_sign(sign), "", str(self.path)

    def owned_channels(self, sign: WrittenSign) -> frozenset[str]:
        """Return the channels that are a sign's own."""
        from signsplice.written import signing

        return signing.owned_channels(sign)


class IndexedWords(Source):
    """The words of a folder of spoken-to-signed, landmarks with a table ``index.csv``, each read from its file when it
    is asked for; thread-safe.

    path, where, form, n_bytes, language: as in ``Source``.

    Raises ``InputError`` as ``recordings.read_index`` does.
    """

    form, n_bytes = "", 0

    def __init__(self, path: Path, language: str = "") -> None:
        from signsplice.lexicon.recordings import INDEX, read_index

        self.path, self.where, self._asked = path, str(path), language
        rows = read_index(path / INDEX, language)
        self.language = rows[0].language
        self._rows = {fold(name): row for row in rows for name in (row.gloss, *row.synonyms)}
        self._clip, self._entry = lru_cache(_N_KEPT)(self._read_clip), lru_cache(_N_ENTRIES)(self._read_entry)

    def __reduce__(self) -> tuple[type[IndexedWords], tuple[Path, str]]:
        return type(self), (self.path, self._asked)

    def find(self, name: str) -> SourceWord | None:
        """Return the word with this gloss or synonym, or None."""
        row = self._rows.get(fold(name))
        if row is None:
            return None
        owns = owns_extension(None, row.language)
        return SourceWord(row.gloss, lambda: self._entry(row), lambda: self._clip(row), lambda: owns, row.language)

    def lists(self, name: str) -> bool:
        """Return whether ``name`` is a gloss or synonym of a word."""
        return fold(name) in self._rows

    def names(self) -> list[tuple[str, str, bool]]:
        """Return (folded, shown, is a gloss) for every gloss and synonym."""
        rows = dict.fromkeys(self._rows.values())
        return [(fold(name), name, name == row.gloss) for row in rows for name in (row.gloss, *row.synonyms)]

    def entries(self) -> Iterator[Entry]:
        """Return the entries of all words, sorted by gloss. Reads every file."""
        return (self._entry(row) for row in sorted(dict.fromkeys(self._rows.values()), key=lambda row: row.gloss))

    def _read_clip(self, row: GlossRow) -> Clip:
        from signsplice.formats import load
        from signsplice.lexicon.folder import trim_clip

        if not (self.path / row.file).resolve().is_relative_to(self.path.resolve()):
            raise InputError(f"{self.path}: {row.file[:80]!r} lies outside the folder, expected a file in it")
        return copy_unchecked(trim_clip(load(self.path / row.file), row.span), name=row.gloss)

    def _read_entry(self, row: GlossRow) -> Entry:
        from signsplice.lexicon.builder import prepare

        return prepare(self._clip(row), "float32").entry(row.gloss, kind_of(row.gloss), row.synonyms, "", row.file)


def open_lexicon(
    path: str | Path | None = None, *others: str | Path | None, fallback: str | Path | None = None, language: str = ""
) -> Lexicon:
    """Open the lexicon in a folder. Without a folder, with the name ``default`` or with the shipped folder, open the
    shipped words with the forms of their signs. ``others`` are added to it; the first lexicon that has a word wins.

    fallback: file or folder of written signs for glosses that all of them lack. language: of the sentences
    (``languages.read_languages``): where it is a signed one, words of that language come first, and those that name
    none are taken to be of it. Raises ``InputError`` if a folder or file is missing, damaged or newer than this version
    of signsplice.
    """
    _, signed = read_languages(language)
    sources = list[Source]()
    with ExitStack() as stack:
        for folder in map(lexicon_folder, (path, *others)):
            words = _open_words(folder, signed)
            stack.enter_context(closing(words))
            sources.append(words)
            if isinstance(words, StoredWords) and folder.resolve() == SHIPPED.resolve():
                sources.append(FormsOfSigns(words))
        sources += [] if fallback is None else [WrittenWords(fallback)]
        sources.append(ShippedLetters())
        stack.pop_all()
    return Lexicon(*sources, language=signed)


def open_shipped_lexicon() -> Lexicon:
    """Open the shipped words without forms. Raises ``InputError`` if this build has none."""
    return Lexicon(_open_stored_words(SHIPPED))


def lexicon_folder(path: str | Path | None) -> Path:
    """Return the folder that ``open_lexicon`` opens for ``path``."""
    return SHIPPED if path is None or str(path) == DEFAULT else Path(path)


def _open_words(folder: Path, language: str) -> Source:
    """Open a folder with a table of spoken-to-signed as it is, any other as a lexicon that was built."""
    if (folder / INDEX_TABLE).is_file():
        from signsplice.lexicon.recordings import has_index

        if has_index(folder):
            return IndexedWords(folder, language)
    return _open_stored_words(folder)


def _open_stored_words(folder: Path) -> StoredWords:
    if folder == SHIPPED and not SHIPPED.is_dir():
        raise InputError(f"no words ship with this build of signsplice; name a lexicon, or {BUILD_HINT}")
    is_shipped = folder.resolve() == SHIPPED.resolve()
    return StoredWords(folder, "the words that ship", _SHIPPED_LANGUAGE) if is_shipped else StoredWords(folder)
