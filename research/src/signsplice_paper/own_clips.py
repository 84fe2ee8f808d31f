"""Reads the clips of a folder as words of one rig: in cm, at one rate, on one skeleton, at one place."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from shlex import quote

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import AS_WRITTEN, ReadAs, load
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.lexicon.recordings import WordFile, find_word_files
from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, kinematics, resample
from signsplice.rig.align import ORIGIN, place
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import left_out_warnings
from signsplice.signer.signer import stream
from signsplice_workshop.corpora.number_space import NumberSpace, make_space
from signsplice_workshop.corpora.pairs import EXTENT

Progress = Callable[[int, int], None]

FEWEST = 3
"""Fewest words with which a random split has pairs in all its parts."""
SAME_RIG_CM = 0.1
"""Largest difference between bones of one rig."""
MARGIN = 1.05
"""Side of the cube over the longest side of the box around all frames, if that is wider than ``EXTENT`` statures."""


@dataclass(frozen=True, eq=False)
class Rig:
    """The rig of a corpus, from the first clip of its folder.

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
    - signer: its signer, empty if the folder does not tell
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

    def find_frame(self, file_frame: int) -> int:
        """Returns the frame of ``clip`` nearest in time to a frame of the file."""
        return min(round(file_frame * self.clip.fps / self.read_fps), len(self.clip) - 1)


@dataclass(frozen=True)
class ClipChoice:
    """The clips of a folder that become words, and how they are read.

    - folder: of clips of one rig, with subfolders
    - n_words: how many words, drawn by seed; None for 100, or all if there are fewer
    - seed: of the draw
    - fps: rate of the corpus
    - read: how clips are read, where a table in their folder does not say
    - limits: of each file
    """

    folder: Path
    n_words: int | None = None
    seed: int = 0
    fps: float = 30.0
    read: ReadAs = AS_WRITTEN
    limits: ReadLimits = DEFAULT_LIMITS


USUAL_WORDS = 100


def read_words(
    choice: ClipChoice, glosses: Collection[str] | None, moves_words: bool, progress: Progress | None = None
) -> tuple[Rig, list[OwnWord], list[str]]:
    """Returns the rig, the words in the order of their files, and warnings for the user, one line each.

    glosses: glosses to draw from, None for all of the folder. moves_words: whether every word is moved to ``ORIGIN``.

    Raises ``InputError`` for a folder without clips, files that cannot be read, two rigs, arms that are not known by
    name, and too few words.
    """
    sources = _sample_word_files(choice, glosses)
    words: list[OwnWord] = []
    warnings: list[str] = []
    rig = None
    for done, source in enumerate(sources, start=1):
        clip = load(source.path, choice.limits, read=source.row.read.or_else(choice.read))
        rig = rig or _make_rig(clip, source.path)
        n_read, read_fps = len(clip), clip.fps
        choice.limits.check_resampling(clip, choice.fps)
        warnings += [f"{source.path}: {line.removeprefix(f'{clip.name}: ')}" for line in left_out_warnings(clip)]
        clip = put_on_rig(clip, rig, source.path, warnings)
        clip = resample(clip, choice.fps)
        clip = place(clip, ORIGIN) if moves_words else clip
        row, named_clip = source.row, replace(clip, name=source.row.gloss)
        words.append(OwnWord(row.gloss, row.signer, source.path, named_clip, n_read, read_fps))
        if progress is not None:
            progress(done, len(sources))
    assert rig is not None
    return rig, words, warnings


def _sample_word_files(choice: ClipChoice, glosses: Collection[str] | None) -> list[WordFile]:
    """Returns the files of the chosen words, in order."""
    sources, faults = find_word_files(choice.folder)
    if faults:
        further_faults = (
            f" (and {len(faults) - 1} more: `signsplice lexicon check {quote(str(choice.folder))}`)"
            if len(faults) > 1
            else ""
        )
        raise InputError(faults[0] + further_faults)
    if glosses is not None:
        missing = sorted(set(glosses) - {source.row.gloss for source in sources})
        if missing:
            raise InputError(f"{choice.folder}: has no clip of the word {missing[0]!r}, for which positions are given")
        sources = [source for source in sources if source.row.gloss in glosses]
    n_words = min(USUAL_WORDS, len(sources)) if choice.n_words is None else choice.n_words
    if n_words > len(sources):
        condition = "" if glosses is None else " for which positions are given"
        raise InputError(f"--words {n_words}, but {choice.folder} has {len(sources)} words{condition}")
    if n_words < FEWEST and (choice.n_words is not None or glosses is None):  # of few positions the faults come first
        word_count = f"{choice.folder}: {n_words} words" if choice.n_words is None else f"--words {n_words}"
        raise InputError(f"{word_count}, expected at least {FEWEST}: a split has three parts")
    order = stream("choose", choice.seed).permutation(len(sources))[:n_words]
    return [sources[k] for k in sorted(order.tolist())]


def _make_rig(clip: Clip, file: Path) -> Rig:
    """Returns the rig of the first clip. Raises ``InputError`` if its arms or hips are not known by name."""
    info = rig_info(clip.skeleton)
    if not info.has_arms or "hips" not in info.roles.joints:
        raise InputError(
            f"{file}: its arms and hips are not known by joint names ({', '.join(clip.skeleton.names[:3])}, ...); name "
            "them with a roles file (--roles)"
        )
    scale = round(100.0 * info.sizes.unit.metres, 9)
    bones = (
        clip.skeleton if clip.translations is None else _replace_offsets(clip.skeleton, _compute_median_offsets(clip))
    )
    sites = tuple(EndSite(site.joint, scale * site.offset) for site in bones.end_sites)
    return Rig(replace(bones, offsets=scale * bones.offsets, end_sites=sites), file, scale)


def _compute_median_offsets(clip: Clip) -> FloatArray:
    """Returns the median offsets (J, 3) of a clip whose joints move in their parents; the root keeps its own."""
    assert clip.translations is not None
    offsets = np.median(clip.translations, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return np.asarray(offsets)


def _replace_offsets(bones: Skeleton, offsets: FloatArray) -> Skeleton:
    return replace(bones, offsets=offsets)


def put_on_rig(clip: Clip, rig: Rig, file: Path, warnings: list[str]) -> Clip:
    """Returns a clip on the rig's skeleton, in cm. Joints that move in their parents are fixed at their median, with a
    line in ``warnings`` if the move is visible.

    Raises ``InputError``, naming the file, for another rig.
    """
    bones, target = clip.skeleton, rig.skeleton
    difference = None
    if bones.names != target.names or not np.array_equal(bones.parents, target.parents):
        odd_joint = next((name for name in bones.names if name not in target.index), None) or next(
            (name for name in target.names if name not in bones.index), None
        )
        difference = f"{len(bones)} joints, not {len(target)}" if len(bones) != len(target) else "other joints"
        difference += f" ({odd_joint} is in one alone)" if odd_joint else " or in another order"
    else:
        offsets = bones.offsets if clip.translations is None else _compute_median_offsets(clip)
        distances = np.linalg.norm(rig.scale * offsets - target.offsets, axis=-1)[1:]
        if len(distances) and distances.max() > SAME_RIG_CM:
            joint = int(distances.argmax()) + 1
            difference = f"the bone to {bones.names[joint]} differs by {distances.max():.2g} cm"
        if clip.translations is not None:
            shift = rig.scale * np.abs(clip.translations[:, 1:] - offsets[1:]).max(initial=0.0)
            if shift > SAME_RIG_CM:
                warnings.append(f"{file}: its bones change by up to {shift:.2g} cm; they are held at their median")
    if difference is not None:
        raise InputError(
            f"{file}: another rig than {rig.file} ({difference}), expected clips of one rig; `signsplice convert "
            f"{quote(str(file))} OUT --onto {quote(str(rig.file))}` brings it onto that one"
        )
    return Clip(target, clip.local_rotations, rig.scale * clip.root_positions, clip.fps, clip.name)


def find_joints(bones: Skeleton, names: Sequence[str]) -> list[int]:
    """Returns the indices of joints by name, with or without the prefix before a colon. Raises ``InputError`` for
    unknown names, and for none.
    """
    if not names:
        raise InputError("--joints: names no joint, expected names with commas between, wrists among them")
    index_by_name = {name.rpartition(":")[2]: k for k, name in enumerate(bones.names)} | bones.index
    unknown = [name for name in names if name not in index_by_name]
    if unknown:
        lower = {name.lower(): name for name in index_by_name}
        nearest = [lower[name] for name in get_close_matches(unknown[0].rpartition(":")[2].lower(), lower)]
        suggestion = (
            f"nearest: {', '.join(nearest)}" if nearest else f"expected names like {', '.join(bones.names[:3])}"
        )
        raise InputError(f"--joints: no joint {unknown[0]!r}; {suggestion}")
    return [index_by_name[name] for name in names]


def fit_space(rig: Rig, words: Sequence[OwnWord], joints: Sequence[int] | None) -> NumberSpace:
    """Returns the cube around all frames of the words: ``EXTENT`` statures wide, wider if a joint reaches farther."""
    joint_indices = list(range(len(rig.skeleton))) if joints is None else sorted({0, *joints})
    corners = []
    for word in words:
        positions = kinematics.forward(word.clip, joint_indices)[1].reshape(-1, 3)
        corners += [positions.min(axis=0), positions.max(axis=0)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    middle = np.round(0.5 * (low + high), 1)
    reach = 2.0 * float(np.maximum(high - middle, middle - low).max())
    side = max(EXTENT * rig_info(rig.skeleton).sizes.stature, MARGIN * reach)
    return make_space(rig.skeleton, middle.tolist(), round(side, 3), joint_indices)


def hash_words(rig: Rig, words: Sequence[OwnWord]) -> str:
    """Returns the SHA-256 of everything about the words that a corpus depends on."""
    digest = hashlib.sha256()
    for name in rig.skeleton.names:
        digest.update(name.encode() + b"\0")
    digest.update(np.ascontiguousarray(rig.skeleton.offsets).tobytes())
    for word in words:
        digest.update(f"{word.gloss}\0{word.n_read}\0{word.read_fps!r}\0".encode())
        for array in (word.clip.local_rotations, word.clip.root_positions):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
