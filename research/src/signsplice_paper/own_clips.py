"""The clips of a folder as words of one rig: in cm, at one rate, on one skeleton, standing in one place."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from shlex import quote

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import load
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.formats.roles import with_roles
from signsplice.lexicon.recordings import WordFile, find_word_files
from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, kinematics, resample
from signsplice.rig.align import ORIGIN, place
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import left_out_warnings
from signsplice.signer.signer import stream
from signsplice_workshop.corpora.number_space import NumberSpace, space_of
from signsplice_workshop.corpora.pairs import EXTENT

Progress = Callable[[int, int], None]

FEWEST = 3
"""Words of which a random split has pairs in all its parts."""
SAME_RIG_CM = 0.1
"""Bones that differ by no more than this are those of one rig."""
MARGIN = 1.05
"""Side of the cube over the longest side of the box around all frames, where that is wider than ``EXTENT`` statures."""


@dataclass(frozen=True, eq=False)
class Rig:
    """What the first clip of a folder sets for all.

    - skeleton: its skeleton, in cm
    - file: its file, for messages
    - scale: cm per length unit of the files
    """

    skeleton: Skeleton
    file: Path
    scale: float


@dataclass(frozen=True, eq=False)
class OwnWord:
    """A word of a corpus of clips.

    - gloss: its gloss
    - signer: who signs it, empty if the folder does not tell
    - file: its file
    - clip: its motion at the rate of the corpus, in cm
    - n_read: number of frames in the file
    - read_fps: frames per second of the file
    """

    gloss: str
    signer: str
    file: Path
    clip: Clip
    n_read: int
    read_fps: float

    def frame(self, read: int) -> int:
        """The frame of ``clip`` nearest in time to a frame of the file."""
        return min(round(read * self.clip.fps / self.read_fps), len(self.clip) - 1)


@dataclass(frozen=True)
class ClipChoice:
    """Which clips of a folder become words, and how.

    - folder: of clips of one rig, with subfolders
    - n_words: how many words, drawn by seed; None for 100, or all if there are fewer
    - seed: of the draw
    - fps: rate of the corpus
    - roles: role -> joint name, for rigs that are not known by joint names
    - limits: of each file
    """

    folder: Path
    n_words: int | None = None
    seed: int = 0
    fps: float = 30.0
    roles: Mapping[str, str] | None = None
    limits: ReadLimits = DEFAULT_LIMITS


USUAL_WORDS = 100


def read_words(
    choice: ClipChoice, named: Collection[str] | None, moves: bool, progress: Progress | None = None
) -> tuple[Rig, list[OwnWord], list[str]]:
    """The rig, the words in the order of their files, and what a user should know of them, one line each.

    named: glosses to draw from, None for all of the folder. moves: whether every word is moved to ``ORIGIN``.

    Raises ``InputError`` for a folder without clips, files that cannot be read, two rigs, arms that are not known by
    name, and too few words.
    """
    sources = _sample_word_files(choice, named)
    words: list[OwnWord] = []
    warnings: list[str] = []
    rig = None
    for done, source in enumerate(sources, start=1):
        clip = load(source.path, choice.limits)
        if choice.roles is not None:
            clip = with_roles(clip, choice.roles)
        rig = rig or _rig(clip, source.path)
        n_read, read_fps = len(clip), clip.fps
        choice.limits.check_resampling(clip, choice.fps)
        warnings += [f"{source.path}: {line.removeprefix(f'{clip.name}: ')}" for line in left_out_warnings(clip)]
        clip = on_rig(clip, rig, source.path, warnings)
        clip = resample(clip, choice.fps)
        clip = place(clip, ORIGIN) if moves else clip
        row, named_clip = source.row, replace(clip, name=source.row.gloss)
        words.append(OwnWord(row.gloss, row.signer, source.path, named_clip, n_read, read_fps))
        if progress is not None:
            progress(done, len(sources))
    assert rig is not None
    return rig, words, warnings


def _sample_word_files(choice: ClipChoice, named: Collection[str] | None) -> list[WordFile]:
    """The files of the words that are chosen, in order."""
    sources, faults = find_word_files(choice.folder)
    if faults:
        more = (
            f" (and {len(faults) - 1} more: `signsplice lexicon check {quote(str(choice.folder))}`)"
            if len(faults) > 1
            else ""
        )
        raise InputError(faults[0] + more)
    if named is not None:
        missing = sorted(set(named) - {source.row.gloss for source in sources})
        if missing:
            raise InputError(f"{choice.folder}: has no clip of the word {missing[0]!r}, for which positions are given")
        sources = [source for source in sources if source.row.gloss in named]
    n_words = min(USUAL_WORDS, len(sources)) if choice.n_words is None else choice.n_words
    if n_words > len(sources):
        for_them = "" if named is None else " for which positions are given"
        raise InputError(f"--words {n_words}, but {choice.folder} has {len(sources)} words{for_them}")
    if n_words < FEWEST and (choice.n_words is not None or named is None):  # of few positions the faults come first
        what = f"{choice.folder}: {n_words} words" if choice.n_words is None else f"--words {n_words}"
        raise InputError(f"{what}, expected at least {FEWEST}: a split has three parts")
    order = stream("choose", choice.seed).permutation(len(sources))[:n_words]
    return [sources[k] for k in sorted(order.tolist())]


def _rig(clip: Clip, file: Path) -> Rig:
    """The rig of the first clip. Raises ``InputError`` where its arms or hips are not known by name."""
    info = rig_info(clip.skeleton)
    if not info.has_arms or "hips" not in info.roles.joints:
        raise InputError(
            f"{file}: its arms and hips are not known by joint names ({', '.join(clip.skeleton.names[:3])}, ...); name "
            "them with a roles file (--roles)"
        )
    scale = round(100.0 * info.sizes.unit.metres, 9)
    bones = clip.skeleton if clip.translations is None else _with_offsets(clip.skeleton, _still_bones(clip))
    sites = tuple(EndSite(site.joint, scale * site.offset) for site in bones.end_sites)
    return Rig(replace(bones, offsets=scale * bones.offsets, end_sites=sites), file, scale)


def _still_bones(clip: Clip) -> FloatArray:
    """The median offsets (J, 3) of a clip whose joints move in their parents; the root keeps its own."""
    assert clip.translations is not None
    offsets = np.median(clip.translations, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return np.asarray(offsets)


def _with_offsets(bones: Skeleton, offsets: FloatArray) -> Skeleton:
    return replace(bones, offsets=offsets)


def on_rig(clip: Clip, rig: Rig, file: Path, warnings: list[str]) -> Clip:
    """A clip on the rig's skeleton, in cm. Joints that move in their parents are held still; ``warnings`` gets a line
    where that is seen.

    Raises ``InputError``, naming the file, for another rig.
    """
    bones, like = clip.skeleton, rig.skeleton
    what = None
    if bones.names != like.names or not np.array_equal(bones.parents, like.parents):
        other = next((name for name in bones.names if name not in like.index), None) or next(
            (name for name in like.names if name not in bones.index), None
        )
        what = f"{len(bones)} joints, not {len(like)}" if len(bones) != len(like) else "other joints"
        what += f" ({other} is in one alone)" if other else " or in another order"
    else:
        offsets = bones.offsets if clip.translations is None else _still_bones(clip)
        apart = np.linalg.norm(rig.scale * offsets - like.offsets, axis=-1)[1:]
        if len(apart) and apart.max() > SAME_RIG_CM:
            joint = int(apart.argmax()) + 1
            what = f"the bone to {bones.names[joint]} differs by {apart.max():.2g} cm"
        if clip.translations is not None:
            moved = rig.scale * np.abs(clip.translations[:, 1:] - offsets[1:]).max(initial=0.0)
            if moved > SAME_RIG_CM:
                warnings.append(f"{file}: its bones change by up to {moved:.2g} cm; they are held at their median")
    if what is not None:
        raise InputError(
            f"{file}: another rig than {rig.file} ({what}), expected clips of one rig; `signsplice convert "
            f"{quote(str(file))} OUT --onto {quote(str(rig.file))}` brings it onto that one"
        )
    return Clip(like, clip.local_rotations, rig.scale * clip.root_positions, clip.fps, clip.name)


def chosen_joints(bones: Skeleton, names: Sequence[str]) -> list[int]:
    """Indices of joints by name, with or without what stands before a colon. Raises ``InputError`` for others, and for
    none.
    """
    if not names:
        raise InputError("--joints: names no joint, expected names with commas between, wrists among them")
    bare = {name.rpartition(":")[2]: k for k, name in enumerate(bones.names)} | bones.index
    unknown = [name for name in names if name not in bare]
    if unknown:
        lower = {name.lower(): name for name in bare}
        near = [lower[name] for name in get_close_matches(unknown[0].rpartition(":")[2].lower(), lower)]
        some = f"nearest: {', '.join(near)}" if near else f"expected names like {', '.join(bones.names[:3])}"
        raise InputError(f"--joints: no joint {unknown[0]!r}; {some}")
    return [bare[name] for name in names]


def space_around(rig: Rig, words: Sequence[OwnWord], joints: Sequence[int] | None) -> NumberSpace:
    """The cube around all frames of the words: ``EXTENT`` statures wide, or wider where a joint reaches farther."""
    chosen = list(range(len(rig.skeleton))) if joints is None else sorted({0, *joints})
    boxes = []
    for word in words:
        positions = kinematics.forward(word.clip, chosen)[1].reshape(-1, 3)
        boxes += [positions.min(axis=0), positions.max(axis=0)]
    low, high = np.min(boxes, axis=0), np.max(boxes, axis=0)
    middle = np.round(0.5 * (low + high), 1)
    reach = 2.0 * float(np.maximum(high - middle, middle - low).max())
    side = max(EXTENT * rig_info(rig.skeleton).sizes.stature, MARGIN * reach)
    return space_of(rig.skeleton, middle.tolist(), round(side, 3), chosen)


def fingerprint(rig: Rig, words: Sequence[OwnWord]) -> str:
    """The SHA-256 of everything about the words that a corpus depends on."""
    digest = hashlib.sha256()
    for name in rig.skeleton.names:
        digest.update(name.encode() + b"\0")
    digest.update(np.ascontiguousarray(rig.skeleton.offsets).tobytes())
    for word in words:
        digest.update(f"{word.gloss}\0{word.n_read}\0{word.read_fps!r}\0".encode())
        for array in (word.clip.local_rotations, word.clip.root_positions):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
