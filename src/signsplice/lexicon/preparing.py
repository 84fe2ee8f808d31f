"""Clips made ready for a lexicon: read, cut, measured and encoded, by any number of processes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats import FORMATS, atomic, load
from signsplice.formats.live_link import with_face_of
from signsplice.formats.reading import ReadLimits
from signsplice.formats.roles import with_roles
from signsplice.lexicon import index
from signsplice.lexicon.frames import encode
from signsplice.motion import Clip, Skeleton, unchecked_copy
from signsplice.motion.cache import CACHE
from signsplice.rig.info import active_span, arms
from signsplice.rig.inspection import clip_warnings, stray_frames
from signsplice.rig.rest_pose import with_rest_pose

_VERSION = 2


@dataclass(frozen=True)
class PreparedWord:
    """A clip as a lexicon stores it.

    name, fps, n_frames, has_translations: of the clip.
    skeleton: as the index describes it.
    rest_before, rest_after: as in ``Entry``.
    block: its frames, encoded.
    warnings: what a user should know of the clip.
    """

    name: str
    fps: float
    n_frames: int
    has_translations: bool
    skeleton: str
    rest_before: int | None
    rest_after: int | None
    block: bytes
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class FileTask:
    """The words of one file.

    paths: the file, and others of the same recording that are read where it is broken.
    spans: start and end of each word in seconds; None where it begins or ends with the file.
    face: a file with its face; by default one beside it is looked for.
    form: as in ``FORMS``. roles, limits: as of ``build``.
    store: a folder that keeps what is prepared.
    """

    paths: tuple[Path, ...]
    spans: tuple[tuple[float | None, float | None], ...]
    form: str
    roles: Mapping[str, str] | None
    limits: ReadLimits
    store: Path | None = None
    face: Path | None = None


class SharedSkeletons:
    """The first of equal skeletons, of which each file has a copy of its own: finding roles and sizes of a rig takes
    longer than reading a clip.
    """

    def __init__(self) -> None:
        self._by_description: dict[str, Skeleton] = {}

    def of(self, clip: Clip) -> Clip:
        """The clip on the first skeleton that equals its own. Raises ``InputError`` for more joints than are read."""
        first = self._by_description.setdefault(index.describe(clip.skeleton), clip.skeleton)
        return clip if first is clip.skeleton else unchecked_copy(clip, skeleton=first)


def prepare(clip: Clip, form: str, warns: bool = False) -> PreparedWord:
    """A clip made ready. Raises ``InputError`` where it has too many joints, or a position exceeds float32."""
    before, after = rest_frames(clip)
    return PreparedWord(
        clip.name,
        clip.fps,
        len(clip),
        clip.translations is not None,
        index.describe(clip.skeleton),
        before,
        after,
        encode(clip, form),
        _warnings(clip) if warns else (),
    )


def _warnings(clip: Clip) -> tuple[str, ...]:
    """What a user should know about a clip; nothing where its roles do not fit, which ``splice`` says."""
    with suppress(InputError):
        return clip_warnings(clip)
    return ()


def prepare_file(task: FileTask) -> tuple[PreparedWord | str, ...]:
    """The words of a file, each ready or a line that says what is wrong with it."""
    kept = None if task.store is None else task.store / _key(task)
    if kept is not None and kept.exists():
        return _read(kept)
    words = _prepared(task)
    if kept is not None:
        atomic.write(kept, b"".join(_packed(word) for word in words))
    return words


def _prepared(task: FileTask) -> tuple[PreparedWord | str, ...]:
    faults = []
    for path in task.paths:
        try:
            clip = _with_face(load(path, task.limits, face=task.face), path, task)
        except InputError as error:
            faults.append(str(error))
            continue
        return tuple(_word(task, path, clip, span, faults) for span in task.spans)
    return (faults[0],) * len(task.spans)


def _with_face(clip: Clip, path: Path, task: FileTask) -> Clip:
    """A clip with the face of a file of its name in another format, where it has none of its own."""
    for other in task.paths:
        is_same = other.with_suffix("") == path.with_suffix("") and other != path
        if clip.face is None and is_same and FORMATS[other.suffix.lower()].holds_faces:
            with suppress(InputError):  # broken, or without a face
                clip = with_face_of(clip, load(other, task.limits), str(other))
    return clip


def _word(
    task: FileTask, path: Path, clip: Clip, span: tuple[float | None, float | None], faults: list[str]
) -> PreparedWord | str:
    """A word of a file that was read; ``faults``: of files that would have been better."""
    try:
        clip = clip if task.roles is None else with_roles(clip, task.roles)
        clip = CACHE.recent(SharedSkeletons, most=1).of(_cut(clip, span))
        word = prepare(clip, task.form, warns=True)
    except InputError as error:
        return f"{path}: {error}"
    lines = (*(f"{fault}; {path.name} is read" for fault in faults), *(f"{path}: {line}" for line in word.warnings))
    return PreparedWord(**{**vars(word), "warnings": lines})


def _cut(clip: Clip, span: tuple[float | None, float | None]) -> Clip:
    """The frames of a clip between two times."""
    start, end = span
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


def rest_frames(clip: Clip) -> tuple[int | None, int | None]:
    """Numbers of frames before and after the sign, of rest or left out by splices; None where the rig's arms are not
    known.
    """
    try:
        clip = with_rest_pose(clip)
        stray = stray_frames(clip)
        start, stop = active_span(arms(clip[stray.start : stray.stop]))
    except InputError:
        return None, None
    return stray.start + start, len(clip) - stray.start - stop


# --- what a build that was stopped has prepared: a line of JSON, then the frames, of each word


def _key(task: FileTask) -> str:
    """The name under which a file's words are kept: another where the file or how it is read has changed."""
    files = [task.face, *task.paths, *(path.with_suffix(".csv") for path in task.paths)]
    states = [(str(path), status.st_size, status.st_mtime_ns) for path in files if path and (status := _status(path))]
    asked = (_VERSION, states, task.spans, task.form, sorted((task.roles or {}).items()), asdict(task.limits))
    return hashlib.sha256(repr(asked).encode("utf-8", "surrogateescape")).hexdigest()


def _status(path: Path) -> Any:
    try:
        return path.stat()
    except OSError:
        return None


def _packed(word: PreparedWord | str) -> bytes:
    if isinstance(word, str):
        return json.dumps(word).encode() + b"\n"
    return json.dumps({**vars(word), "block": len(word.block)}).encode() + b"\n" + word.block


def _read(kept: Path) -> tuple[PreparedWord | str, ...]:
    content, words, at = kept.read_bytes(), [], 0
    while at < len(content):
        stop = content.index(b"\n", at)
        head = json.loads(content[at:stop])
        at = stop + 1
        if isinstance(head, dict):
            block = content[at : at + head["block"]]
            at += len(block)
            head = PreparedWord(**{**head, "block": block, "warnings": tuple(head["warnings"])})
        words.append(head)
    return tuple(words)
