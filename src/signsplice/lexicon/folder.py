"""Builds lexicons from folders of clips and from written signs, in any number of processes; checks such folders."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, TypeGuard

from signsplice.children import cores, in_order
from signsplice.errors import InputError, SignspliceError
from signsplice.formats import AS_WRITTEN, FORMATS, READ_SUFFIXES, ReadAs, atomic, load, skeletons
from signsplice.formats.live_link import with_face_of
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.lexicon.builder import Builder, MakeCard, PreparedWord, SharedSkeletons, building, check_target, prepare
from signsplice.lexicon.gloss import Entry, gloss_of
from signsplice.lexicon.languages import check_signed
from signsplice.lexicon.recordings import WordFile, find_word_files, gather, unread
from signsplice.lexicon.store import owns_extension
from signsplice.motion import Clip
from signsplice.motion.cache import CACHE
from signsplice.progress import Progress
from signsplice.rig.inspection import role_warnings

if TYPE_CHECKING:
    from signsplice.written.tree import WrittenSign


_VERSION = 4
"""Version of the words that a stopped build has prepared."""
_FILES_A_PROCESS = 50
"""Files that can be read in the time that a process takes to start."""
_SIGNS_A_PROCESS = 40
"""Signs that can be animated in the time that a process takes to start."""


@dataclass(frozen=True)
class Built:
    """The result of a build.

    n_words: number of words, letters included.
    n_letters: number of letters.
    n_bytes: size of the frames file.
    form: how rotations are stored.
    warnings: one line each.
    left_out: words and files left out, one line each; also among the warnings.
    unread: files that are not read, a line of those with further data of words in an archive and one of other kinds.
    """

    n_words: int
    n_letters: int
    n_bytes: int
    form: str
    warnings: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()


@dataclass(frozen=True)
class Checked:
    """The result of a check of a folder of clips.

    n_clips: number of clips.
    faults: everything that prevents a build, one line each.
    warnings: further warnings, one line each.
    unread: as in ``Built``.
    """

    n_clips: int
    faults: list[str]
    warnings: list[str]
    unread: tuple[str, ...] = ()


@dataclass(frozen=True)
class FileTask:
    """The words of one file.

    paths: the file, and others of the same recording, which are read if it is broken.
    spans: start and end of each word, seconds; None if it begins or ends with the file.
    face: a file with its face; by default the one beside the clip, if any.
    form: one of ``FORMS``. read, limits: as in ``build``.
    store: a folder that keeps prepared words. make_card: as in ``build``.
    """

    paths: tuple[Path, ...]
    spans: tuple[tuple[float | None, float | None], ...]
    form: str
    read: ReadAs
    limits: ReadLimits
    store: Path | None = None
    face: Path | None = None
    make_card: MakeCard | None = None


def build(
    inputs: str | Path | Sequence[str | Path],
    output: str | Path,
    *,
    compact: bool = False,
    signer: str = "",
    language: str = "",
    roles: Mapping[str, str] | None = None,
    skip_broken: bool = False,
    recipe: str = "",
    lenient: bool = False,
    jobs: int | None = 1,
    progress: Progress | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
    read: ReadAs = AS_WRITTEN,
    make_card: MakeCard | None = None,
) -> Built:
    """Build a lexicon at ``output`` from every clip below folders, and from files or folders of written signs (SiGML,
    HamNoSys), with few clips in memory at a time.

    compact: int16 rotations, half the size. signer: of clips for which the table names none. language: code of the
    signed language of words for which the table names none, such as ase; empty if unknown. roles: role -> joint name,
    for rigs that are not recognised by joint names. skip_broken: leave out broken clips, with a line each. recipe: of
    an archive, a name in ``RECIPES``, a ``.json`` file or a ``.csv`` table: files that do not fit are left out, and a
    stopped build resumes. lenient: leave out unknown parts of a written sign, with a warning. jobs: number of
    processes; None: one per core. limits: of each clip. read: how clips are read, where the table does not say.
    make_card: makes what splices know of a word by itself (``splicing.cards.make_card``); else the first use does.

    Refused written signs are left out, with a line each; one whose gloss is taken gets the next number, GLOSS#2.
    Raises ``InputError``, also if input and output lie in each other; then ``output`` is unchanged.
    """
    check_target(output)
    check_signed(language)
    folders, written = _folders_and_written(inputs)
    form = "int16" if compact else "float32"
    signs, refused = _read_written_signs(written, lenient)
    checks = " and ".join(f"`signsplice lexicon check {quote(str(folder))}`" for folder in folders)
    files, left_out = _gather(folders, output, recipe, signer, language, checks)
    store = Path(output).resolve().with_name(f".{Path(output).resolve().name}.prepared") if recipe else None
    log, ends_by = _BuildLog([*left_out], left_out), "" if skip_broken or recipe else checks
    task = FileTask((), (), form, ReadAs(roles=roles).or_else(read), limits, store, make_card=make_card)
    with atomic.resumable_folder(store) if store else nullcontext(), building(output, compact=compact) as builder:
        clips = [
            (_add_clip(builder, word, file, language), word.skeleton)
            for file, word in _prepare_files(files, task, jobs, progress)
            if log.takes(word, ends_by)
        ]
        for line in refused:
            log.leave_out(line)
        for sign, word in _prepare_signs(signs, form, lenient, jobs, progress, make_card):
            if log.takes(word):
                _add_written_sign(builder, word, sign, signer, language, lenient)
        log.warnings += _role_lines(output, {entry.gloss: skeleton for entry, skeleton in clips})
        if not builder.n_words:
            what = "clip" if folders else "sign"
            raise InputError(f"{[*folders, output][0]}: every {what} is broken, the first one: {log.left_out[0]}")
    counts = builder.n_words, sum(entry.kind == "letter" for entry, _ in clips), builder.n_bytes
    lines = tuple(log.warnings), tuple(log.left_out), unread([*folders, *written], files, recipe)
    return Built(*counts, builder.form, *lines)


def _gather(
    folders: Sequence[str | Path], output: str | Path, recipe: str, signer: str, language: str, checks: str
) -> tuple[list[WordFile], list[str]]:
    """Return the words' files and the lines of those left out. Raises ``InputError`` for such a line without a recipe;
    ``checks``: commands that show them all.
    """
    files, left_out = gather(folders, output, recipe, signer, language)
    if left_out and not recipe:
        raise InputError(left_out[0] + (f" (and {len(left_out) - 1} more: {checks})" if left_out[1:] else ""))
    return files, left_out


@dataclass
class _BuildLog:
    """What a build says of its words.

    warnings, left_out: as in ``Built``.
    """

    warnings: list[str]
    left_out: list[str]

    def takes(self, word: PreparedWord | str, checks: str = "") -> TypeGuard[PreparedWord]:
        """Return whether a word was prepared, and note its warnings; a broken one is left out. Raises ``InputError``
        instead if ``checks``, the commands that show every fault, are given.
        """
        if isinstance(word, PreparedWord):
            self.warnings += word.warnings
            return True
        if checks:
            raise InputError(
                f"{word}; nothing was built: {checks} shows every fault, skip_broken leaves such clips out"
            )
        self.leave_out(word)
        return False

    def leave_out(self, line: str) -> None:
        """Note that a word is left out."""
        self.left_out.append(f"{line}; left out")
        self.warnings.append(self.left_out[-1])


def _folders_and_written(inputs: str | Path | Sequence[str | Path]) -> tuple[list[str | Path], list[str | Path]]:
    """Return the inputs that may hold clips, and those that hold written signs; a folder may be both."""
    paths = [inputs] if isinstance(inputs, (str, Path)) else [*inputs]
    written = [path for path in paths if is_written(path)]
    folders = [
        path
        for path in paths
        if path not in written or any(file.suffix.lower() in READ_SUFFIXES for file in Path(path).rglob("*"))
    ]
    return folders, written


def check(
    folder: str | Path,
    roles: Mapping[str, str] | None = None,
    progress: Progress | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
    read: ReadAs = AS_WRITTEN,
    language: str = "",
) -> Checked:
    """Check the clips below a folder; ``roles``, ``limits``, ``read``, ``language`` as in ``build``. Raises
    ``InputError`` if there is no clip.
    """
    files, faults = find_word_files(folder, language=language)
    warnings: list[str] = []
    rigs: dict[str, str] = {}  # name of a word -> description of its skeleton
    for _, word in _prepare_files(
        files, FileTask((), (), "float32", ReadAs(roles=roles).or_else(read), limits), None, progress
    ):
        if isinstance(word, str):
            faults.append(word)
        else:
            warnings += word.warnings
            rigs[word.name] = word.skeleton
    warnings += _role_lines(folder, rigs)
    return Checked(len(files), faults, warnings, unread([folder], files))


def _role_lines(where: str | Path, rigs: Mapping[str, str]) -> Iterator[str]:
    """Yield lines about words that lack parts of the body which others have; ``rigs``: name of a word -> description of
    its skeleton.
    """
    described = {rig: skeletons.from_json(json.loads(rig)) for rig in {*rigs.values()}}
    yield from (f"{where}: {line}" for line in role_warnings({name: described[rig] for name, rig in rigs.items()}))


def reasons(lines: Iterable[str]) -> list[tuple[int, str, str]]:
    """Group lines that begin with a file, and perhaps a gloss, by reason: (number of lines, reason, first file), the
    most frequent first.
    """
    seen: dict[str, list[str]] = {}
    for line in lines:
        file, _, rest = line.partition(": ")
        reason = re.sub(r"^\S+: ", "", rest)
        seen.setdefault(re.sub(r"'[^']*'|\b\d[\d,.]*", "...", reason), []).append(file)
    return sorted(((len(files), reason, files[0]) for reason, files in seen.items()), key=lambda row: -row[0])


def _prepare_files(
    files: Sequence[WordFile], task: FileTask, jobs: int | None, progress: Progress | None
) -> Iterator[tuple[WordFile, PreparedWord | str]]:
    """Yield each file with its prepared word or an error line; a file of several words is read once."""
    groups = [list(words) for _, words in groupby(files, key=lambda word: (word.paths, word.face, word.row.read))]
    tasks = [
        replace(task, paths=first.paths, spans=tuple(word.row.span for word in words), face=first.face,
                read=first.row.read.or_else(task.read))
        for words in groups for first in words[:1]
    ]  # fmt: skip
    workers = min(cores(), len(tasks) // _FILES_A_PROCESS) if jobs is None else min(jobs, len(tasks))
    done = 0
    try:
        for words, ready in zip(groups, in_order(_prepare_file, tasks, max(workers, 1)), strict=True):
            yield from zip(words, ready, strict=True)
            done += len(words)
            if progress is not None:
                progress(done, len(files))
    except BrokenProcessPool as error:
        raise SignspliceError(
            "a process that reads clips has ended, out of memory or by a fault; call again with fewer processes"
        ) from error


def is_written(path: str | Path) -> bool:
    """Return whether a path is a file of written signs or a folder of SiGML."""
    path = Path(path)
    if path.is_dir():
        return any(path.rglob("*.sigml"))
    from signsplice.written.files import SUFFIXES

    return path.suffix.lower() in SUFFIXES


def _read_written_signs(paths: Sequence[str | Path], lenient: bool) -> tuple[list[WrittenSign], list[str]]:
    """Return the signs of files and folders of written signs, and a line for each refused sign."""
    if not paths:
        return [], []
    from signsplice.written import files

    read = files.read(paths, lenient)
    return [*read.signs.values()], [*map(str, read.refused)]


def _prepare_signs(
    signs: Sequence[WrittenSign],
    form: str,
    lenient: bool,
    jobs: int | None,
    progress: Progress | None,
    make_card: MakeCard | None,
) -> Iterator[tuple[WrittenSign, PreparedWord | str]]:
    """Yield each sign with its prepared word, or a line with the reason why it is refused."""
    workers = min(cores(), len(signs) // _SIGNS_A_PROCESS) if jobs is None else jobs
    words = in_order(partial(_prepare_sign, form=form, lenient=lenient, make_card=make_card), signs, max(workers, 1))
    for done, (sign, word) in enumerate(zip(signs, words, strict=True), 1):
        yield sign, word
        if progress is not None:
            progress(done, len(signs))


def _prepare_sign(sign: WrittenSign, form: str, lenient: bool, make_card: MakeCard | None) -> PreparedWord | str:
    from signsplice.written import signing

    try:
        clip = signing.animate_sign(sign, lenient=lenient)
        lines = (*signing.warnings(sign), *(f"{sign.where.file}: {sign.gloss}: {line}" for line in clip.notes))
        return replace(prepare(clip, form, make_card=make_card), warnings=lines)
    except InputError as error:
        return str(error)


def _add_clip(builder: Builder, word: PreparedWord, file: WordFile, language: str) -> Entry:
    """Add the word of a clip, as its row of the table names it, and return its entry."""
    row = file.row
    return builder.add(
        word, row.gloss, kind=row.kind, synonyms=row.synonyms, signer=row.signer, source=row.source,
        checked=row.checked, extensions=owns_extension(row.owns, row.language or language),
    )  # fmt: skip


def _add_written_sign(
    builder: Builder, word: PreparedWord, sign: WrittenSign, signer: str, language: str, lenient: bool
) -> None:
    """Add the word of a written sign under the next free gloss."""
    from signsplice.written import signing

    gloss, source = builder.free(gloss_of(sign.gloss)), Path(sign.where.file).name
    extensions = owns_extension(signing.owned_channels(sign, lenient), language)
    builder.add(word, gloss, signer=signer, source=source, extensions=extensions)


def _prepare_file(task: FileTask) -> tuple[PreparedWord | str, ...]:
    """Return the words of a file, each prepared or an error line."""
    stored = None if task.store is None else task.store / _key(task)
    if stored is not None and stored.exists():
        return _unpack(stored.read_bytes())
    words = _read_words(task)
    if stored is not None:
        atomic.write(stored, b"".join(_pack_word(word) for word in words))
    return words


def _read_words(task: FileTask) -> tuple[PreparedWord | str, ...]:
    faults = []
    for path in task.paths:
        try:
            clip = _with_face(load(path, task.limits, face=task.face, read=task.read), path, task)
        except InputError as error:
            faults.append(str(error))
            continue
        return tuple(_word(task, path, clip, span, faults) for span in task.spans)
    return (faults[0],) * len(task.spans)


def _with_face(clip: Clip, path: Path, task: FileTask) -> Clip:
    """Return the clip; if it has no face, with that of a file of the same name in another format."""
    for face_path in task.paths:
        is_same = face_path.with_suffix("") == path.with_suffix("") and face_path != path
        if clip.face is None and is_same and FORMATS[face_path.suffix.lower()].holds_faces:
            with suppress(InputError):  # broken, or without a face
                clip = with_face_of(clip, load(face_path, task.limits, read=ReadAs(task.read.fps)), str(face_path))
    return clip


def _word(
    task: FileTask, path: Path, clip: Clip, span: tuple[float | None, float | None], faults: list[str]
) -> PreparedWord | str:
    """Return a word of a file; ``faults``: of preferred files that could not be read."""
    try:
        clip = CACHE.recent(SharedSkeletons, most=1).of(trim_clip(clip, span))
        word = prepare(clip, task.form, warns=True, make_card=task.make_card)
    except InputError as error:
        return f"{path}: {error}"
    lines = (*(f"{fault}; {path.name} is read" for fault in faults), *(f"{path}: {line}" for line in word.warnings))
    return replace(word, warnings=lines)


def trim_clip(clip: Clip, span: tuple[float | None, float | None]) -> Clip:
    """Return the frames of a clip between two times, seconds. Tables of landmarks may give times of a longer film."""
    start, end = span
    if end is not None and clip.points is not None:
        end = min(end, clip.seconds)
    if start is None and end is None:
        return clip
    first = 0 if start is None else round(start * clip.fps)
    last = len(clip) if end is None else round(end * clip.fps)
    if not 0 <= first < last <= len(clip) + 1:
        raise InputError(
            f"{start or 0:g} s to {end if end is not None else clip.seconds:g} s, expected times in order "
            f"within its {clip.seconds:.2f} s"
        )
    return clip[first : min(last, len(clip))]


# --- the store of a stopped build: for each word a line of JSON, then its frames


def _key(task: FileTask) -> str:
    """Return the name under which a file's words are stored; it changes with the file and the options of reading."""
    paths = [task.face, *task.paths, *(path.with_suffix(".csv") for path in task.paths)]
    paths += [frame for path in task.paths if path.is_dir() for frame in sorted(path.iterdir())]
    states = []
    for path in filter(None, paths):
        with suppress(OSError):
            status = path.stat()
            states.append((str(path), status.st_size, status.st_mtime_ns))
    asked = (_VERSION, states, task.spans, task.form, asdict(task.read), asdict(task.limits), bool(task.make_card))
    return hashlib.sha256(repr(asked).encode("utf-8", "surrogateescape")).hexdigest()


def _pack_word(word: PreparedWord | str) -> bytes:
    if isinstance(word, str):
        return json.dumps(word).encode() + b"\n"
    kept = {"block": len(word.block), "card": word.card.hex(), "points": word.points.hex()}
    return json.dumps({**vars(word), **kept}).encode() + b"\n" + word.block


def _unpack(content: bytes) -> tuple[PreparedWord | str, ...]:
    words = []
    while content:
        line, _, content = content.partition(b"\n")
        word = json.loads(line)
        if isinstance(word, dict):
            block, content = content[: word["block"]], content[word["block"] :]
            parts = {name: bytes.fromhex(word[name]) for name in ("card", "points")}
            word = PreparedWord(**{**word, **parts, "block": block, "warnings": tuple(word["warnings"])})
        words.append(word)
    return tuple(words)
