"""Lexicons open for reading: gloss -> clip, from memory-mapped frames."""

from __future__ import annotations

import mmap
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType

from signsplice.errors import InputError, UnknownGlossError
from signsplice.formats.reading import opened
from signsplice.lexicon.entry import LETTER_MARK, Entry, fold
from signsplice.lexicon.frames import FORMS, FRAMES, HEAD_BYTES, MAGIC, Shape, decode, fingerprint
from signsplice.lexicon.index import INDEX, REBUILD, ClipLocation, Head, Index
from signsplice.lexicon.suggestions import Suggestions
from signsplice.motion import Clip, Skeleton
from signsplice.progress import Progress
from signsplice.rig.inspection import clip_warnings

SHIPPED = Path(__file__).parent / "words"
_MIN_SIMILARITY = 0.55
"""Least similarity of the glosses that ``nearest`` suggests."""
_HINT = "build one from a folder of clips by `signsplice lexicon build`"


class Lexicon:
    """A lexicon open for reading: a mapping of glosses to clips, for any number of threads.

    Look-up accepts glosses and synonyms in any case; ``len`` and iteration cover glosses only. A context manager; clips
    remain valid after it closes. Raises ``InputError`` where the folder holds no valid lexicon of this version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._lock = threading.Lock()
        self._skeletons: dict[int, tuple[Skeleton, str]] = {}
        self._frames: mmap.mmap | None
        while True:
            place = _place(self.path)
            try:
                self._index, self._frames = _files(self.path)
                break
            except InputError:
                if _place(self.path) == place:
                    raise  # else another lexicon has taken its place between one file and the next
        self._head = self._index.head

    def __enter__(self) -> Lexicon:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __reduce__(self) -> tuple[type[Lexicon], tuple[Path]]:
        return type(self), (self.path,)

    def close(self) -> None:
        """Close both files."""
        frames, self._frames = self._frames, None
        self._index.close()
        if frames is not None:
            with suppress(BufferError):  # another thread is reading a word; the file is closed when that is done
                frames.close()

    @property
    def parts(self) -> tuple[Lexicon, ...]:
        """The lexicons of which this one is made: itself."""
        return (self,)

    @property
    def where(self) -> str:
        """Where its words are, for messages."""
        return str(self.path)

    @property
    def form(self) -> str:
        """How rotations are stored: "float32" or "int16"."""
        return self._head.form

    @property
    def n_bytes(self) -> int:
        """Size of the frames file."""
        return self._head.n_bytes

    def __len__(self) -> int:
        return self._head.n_words

    def __iter__(self) -> Iterator[str]:
        return iter(self.glosses)

    def __contains__(self, gloss: object) -> bool:
        return self.lists(gloss)

    def lists(self, gloss: object) -> bool:
        """Whether it is the gloss or a synonym of a word."""
        return isinstance(gloss, str) and self._index.find(gloss) is not None

    @cached_property
    def glosses(self) -> tuple[str, ...]:
        """The glosses of all words, sorted; without synonyms."""
        return tuple(shown for _, shown, is_gloss in self._index.names() if is_gloss)

    def entries(self) -> Iterator[Entry]:
        """The entries of all words, in the order of ``glosses``."""
        return (entry for entry, _ in self._named)

    def search(self, text: str) -> list[Entry]:
        """Entries with ``text`` in their gloss or a synonym, in any case; those that begin with it come first."""
        wanted = fold(text)
        found = [(entry, names) for entry, names in self._named if any(wanted in name for name in names)]
        found.sort(key=lambda match: not any(name.startswith(wanted) for name in match[1]))
        return [entry for entry, _ in found]

    def entry(self, gloss: str) -> Entry:
        """The entry of the word with this gloss or synonym. Raises ``UnknownGlossError``, which names similar ones."""
        return self._find(gloss)[0]

    def clip(self, gloss: str) -> Clip:
        """The clip of the word with this gloss or synonym, named by its gloss.

        Clips of one rig share one skeleton object. Raises ``UnknownGlossError``, or ``InputError`` for a damaged word.
        """
        return self._clip(*self._find(gloss))

    def nearest(self, gloss: str, n: int = 3, similarity: float = _MIN_SIMILARITY) -> tuple[str, ...]:
        """Up to ``n`` glosses and synonyms most like ``gloss``: those that have it between hyphens, then those of at
        least that ``similarity``, best first. Letters only for what begins as they do.

        The similarity of two words is twice the number of letters that both have in the same order, over the number of
        letters of both. Of words equally like, those come first that fewer edits lead to; two neighbours that change
        places are one edit.
        """
        return tuple(self._shown[name] for name in self._suggestions.nearest(fold(gloss), n, similarity))

    def hyphenated(self, word: str) -> str | None:
        """The gloss that ``word`` is without its hyphens (THANKYOU: THANK-YOU), None where there is none."""
        shown = self._without_hyphens.get(fold(word))
        return None if shown is None else self.entry(shown).gloss

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """Faults of the words, one line each: checks bytes, hashes and names against the index. Reads every frame."""
        n_words = 0
        for entry, location in self._words(progress):
            n_words += 1
            try:
                self._clip(entry, location)
                for name in (entry.gloss, *entry.synonyms):
                    found = self._index.find(name)
                    if found is None or found[0].gloss != entry.gloss:
                        yield f"{self.path}: word {entry.gloss[:40]!r}: is not found by {name[:40]!r}"
            except InputError as error:
                yield str(error)
        if n_words != len(self):
            yield f"{self.path}: {n_words} words, expected {len(self)}"
        try:
            self._index.check()
        except InputError as error:
            yield str(error)

    def verify(self) -> None:
        """Compare every entry, and the bytes of every word, with their SHA-256. Raises ``InputError`` at the first that
        is another.

        Quicker than ``faults``, which decodes the words too: about a second for each GB.
        """
        for entry, location in self._words(None):
            self._verify(entry, location)
        self._index.check()

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """What a user should know about words that can be read, one line each."""
        for entry, location in self._words(progress):
            with suppress(InputError):  # ``faults`` names it
                for line in clip_warnings(self._clip(entry, location)):
                    yield f"{self.path}: word {entry.gloss[:40]!r}: {line}"

    def _words(self, progress: Progress | None) -> Iterator[tuple[Entry, ClipLocation]]:
        """Every word and its location; ``progress`` is called with how many are done and how many there are."""
        for done, word in enumerate(self._index.words(), start=1):
            yield word
            if progress is not None:
                progress(done, len(self))

    @cached_property
    def _named(self) -> list[tuple[Entry, list[str]]]:
        """Every entry and its names, folded, in the order of ``glosses``."""
        words = self._index.words()
        return [(entry, [fold(name) for name in (entry.gloss, *entry.synonyms)]) for entry, _ in words]

    @cached_property
    def _shown(self) -> dict[str, str]:
        return {folded: shown for folded, shown, _ in self._index.names()}

    @cached_property
    def _suggestions(self) -> Suggestions:
        return Suggestions(self._shown)

    @cached_property
    def _without_hyphens(self) -> dict[str, str]:
        return {
            folded.replace("-", ""): shown
            for folded, shown in self._shown.items()
            if "-" in folded and not folded.startswith(LETTER_MARK)
        }

    def _find(self, gloss: str) -> tuple[Entry, ClipLocation]:
        found = self._index.find(gloss)
        if found is None:
            raise UnknownGlossError({gloss: self.nearest(gloss)}, self.where)
        return found

    def _clip(self, entry: Entry, location: ClipLocation) -> Clip:
        block = self._block(location)
        try:
            skeleton, _ = self._skeleton(location.skeleton)
            shape = Shape(self.form, entry.n_frames, len(skeleton), location.has_translations)
            clip = decode(block, shape, skeleton, entry.fps, entry.gloss)
        except Exception as error:  # of whatever damaged bytes make of a clip
            reason = (str(error).splitlines() or [type(error).__name__])[0][:300]
            raise InputError(f"{self.path}: word {entry.gloss[:40]!r} is damaged ({reason}); {REBUILD}") from error
        self._verify(entry, location)
        return clip

    def _verify(self, entry: Entry, location: ClipLocation) -> None:
        """Raise ``InputError`` where a word's bytes are not those that were written: few flips make them unreadable."""
        found = fingerprint(self._block(location), self._skeleton(location.skeleton)[1], entry.fps, entry.n_frames)
        if found != entry.sha256:
            raise InputError(
                f"{self.path}: word {entry.gloss[:40]!r}: its SHA-256 is another than when it was written; {REBUILD}"
            )

    def _block(self, location: ClipLocation) -> memoryview:
        frames = self._frames  # once, since another thread may close
        if frames is None or frames.closed:
            raise InputError(f"{self.path}: the lexicon is closed")
        return memoryview(frames)[location.start : location.start + location.n_bytes]

    def _skeleton(self, number: int) -> tuple[Skeleton, str]:
        with self._lock:
            if number not in self._skeletons:
                self._skeletons[number] = self._index.skeleton(number)
            return self._skeletons[number]


def open_lexicon(path: str | Path | None = None) -> Lexicon:
    """Open the lexicon in a folder; without one, the words that ship. Raises ``InputError`` where there is none, or it
    is damaged or newer than this version of signsplice.
    """
    return shipped() if path is None else Lexicon(path)


def shipped(kind: Callable[[Path], Lexicon] = Lexicon) -> Lexicon:
    """Open the lexicon that ships with the package, as a ``kind`` of lexicon. Raises ``InputError`` where this build
    has none.
    """
    if not SHIPPED.is_dir():
        raise InputError(f"no words ship with this build of signsplice; name a lexicon, or {_HINT}")
    return kind(SHIPPED)


def _files(path: Path) -> tuple[Index, mmap.mmap]:
    """The two files of a lexicon, open. Raises ``InputError`` where they are none, or do not belong to each other."""
    _check_path(path)
    index = Index(path / INDEX)
    try:
        if index.head.form not in FORMS:
            raise InputError(f"{index.path}: form {index.head.form[:40]!r}, expected one of {', '.join(FORMS)}")
        return index, _mapped(path / FRAMES, index.head)
    except BaseException:
        index.close()
        raise


def _mapped(path: Path, head: Head) -> mmap.mmap:
    """The frames that belong to an index."""
    try:
        with opened(path) as (file, size):
            if size != head.n_bytes or size < HEAD_BYTES:
                raise InputError(f"{path}: {size} bytes, expected {head.n_bytes}; {REBUILD}")
            frames = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if frames[:HEAD_BYTES].hex() != MAGIC.hex() + str(head.sha256):
        frames.close()
        raise InputError(f"{path}: belongs to another index than the one beside it; {REBUILD}")
    return frames


def _place(path: Path) -> tuple[int, int, int] | None:
    """What tells a folder from one that takes its place; None where there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):  # a zero byte in the name
        return None
    return status.st_dev, status.st_ino, status.st_ctime_ns


def _check_path(path: Path) -> None:
    """Raise ``InputError`` where a path is clearly not a lexicon."""
    try:
        if not path.exists():
            raise InputError(f"{path}: no such folder, expected a lexicon; {_HINT}")
        if not path.is_dir():
            raise InputError(f"{path}: is a file, expected a lexicon's folder")
        for name in (INDEX, FRAMES):
            if not (path / name).is_file():
                raise InputError(f"{path}: is no lexicon, it has no {name}; {_HINT}")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
