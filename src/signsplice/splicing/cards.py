"""Cards of words: what a splice knows of a word by itself, kept beside its frames or in memory.

A card holds derived values of a clip (``CARD_VALUES`` and the ends that a cutter reads), so that a splice need not
compute them: its motion span, warnings, placement, whether it is keyed, the channels that it owns, where head and trunk
may turn, and where it may be left and entered. Lexicons store cards as bytes; those of other clips are kept by content.
A card that does not belong to the frames, the features or the bundle at hand is not used.

Numbers are stored whole: they equal those that the processor computed which made the card; networks differ in their
last digits between processors.
"""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.motion.cache import CACHE
from signsplice.motion.clip import StoredCard, stored_card
from signsplice.rig.align import Placement, find_placement, placement
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import MotionSpan, clip_warnings, find_motion_span, list_clip_warnings, motion_span
from signsplice.rig.keyedness import Keyedness, judge_clip, judge_keyedness
from signsplice.rig.roles import CHANNELS
from signsplice.splicing import features
from signsplice.splicing.carriage import find_freedom, find_hand_offsets, measure_freedom
from signsplice.splicing.contracts import Cutter
from signsplice.splicing.learned import LearnedCutter, WordEnd
from signsplice.splicing.options import choose
from signsplice.splicing.person import find_low_places, find_owned_channels, owned_channels

VERSION = 2
"""Version of cards: another one where a derived value is computed in another way."""
_MOST_KEPT = 1024
"""Largest number of words whose values are kept in memory, about 50 bytes a frame."""
_MOST_FRAMES = 1000
"""Longest clip of which values are kept, frames: longer ones are takes, not words."""
_MOST_BYTES = 1 << 20
"""Size of an unpacked card from which on it is not read."""

_NUMBER, _HEIGHT = "<f8", "<f4"
"""Types of the numbers on a card."""
CARD_VALUES: tuple[Callable[[Clip], Any], ...] = (
    find_motion_span, list_clip_warnings, find_placement, judge_clip, find_owned_channels, find_freedom,
    find_hand_offsets, find_low_places,
)  # fmt: skip
"""The derived values of a clip that a card holds, besides the ends that a cutter reads."""


def recall(clip: Clip, cutter: Cutter) -> None:
    """Give a clip the derived values on its stored card, and those of clips with the same frames that were seen before;
    values that are not known are computed when they are asked for, and kept.
    """
    reader = _reads_alone(cutter)
    ends = None if reader is None else reader.ends
    if len(clip) > _MOST_FRAMES or (clip.derived.shared and (ends is None or ends in clip.derived.shared)):
        return
    stored = clip.derived[stored_card]
    known = CACHE.recent(_nothing_known, digest_clip(clip) if stored is None else stored.sha256, most=_MOST_KEPT)
    for other in [key for key in known if key not in CARD_VALUES and ends is not None and key != ends]:
        del known[other]  # of another cutter, whose networks it would keep open
    if stored is not None and stored.content and known.get(ends or find_motion_span) is None:
        known.update(_unpack(stored, clip, reader))
    if ends is not None:
        known.setdefault(ends, None)
    clip.derived.share(known)


def forget() -> None:
    """Forget what is kept of words in memory."""
    CACHE.forget(_nothing_known)


def _nothing_known(key: str | bytes) -> dict[Callable[[Clip], Any], Any]:
    """Return the functions of the values on a card, for a word of which none is known."""
    return dict.fromkeys(CARD_VALUES)


def make_card(clip: Clip, sha256: str, cutter: Cutter | None = None) -> bytes:
    """Return the card of a clip whose stored frames have this ``sha256``, with the ends that a cutter reads, by default
    those of the default cutter.
    """
    motion, standing, keyed = motion_span(clip), placement(clip), judge_keyedness(clip)
    reader = _reads_alone(choose().cutter if cutter is None else cutter)
    ends = () if reader is None else clip.derived[reader.ends]
    head = {
        "key": _key(sha256),
        "cutter": None if reader is None else _cutter_key(reader),
        "motion": [motion.start, motion.stop, motion.warnings],
        "warnings": clip_warnings(clip),
        "placement": [part.tolist() for part in (standing.position, standing.up, standing.forward)],
        "keyed": [keyed.is_keyed, keyed.fraction, keyed.every, keyed.reason],
        "owns": sorted(owned_channels(clip)),
        "hands": clip.derived[find_hand_offsets].tolist(),
        "low": [
            None if low is None else low[arm].tolist()
            for low, arm in zip(clip.derived[find_low_places], _upper_and_lower_arms(clip), strict=True)
        ],
        "ends": [[end.first, end.active, end.stroke, len(end.heights), len(end.scores)] for end in ends],
    }
    numbers = [measure_freedom(clip).astype(_NUMBER).tobytes()]
    for end in ends:
        numbers += [end.heights.astype(_HEIGHT).tobytes(), end.scores.astype(_NUMBER).tobytes()]
    return zlib.compress(json.dumps(head).encode() + b"\n" + b"".join(numbers))


def _unpack(stored: StoredCard, clip: Clip, reader: LearnedCutter | None) -> dict[Callable[[Clip], Any], Any]:
    """Return the derived values on a stored card; none if it is another's, of another version, or damaged."""
    try:
        line, _, numbers = zlib.decompressobj().decompress(stored.content, _MOST_BYTES).partition(b"\n")
        head = json.loads(line)
        if head["key"] != _key(stored.sha256):
            return {}
        free, numbers = _array(numbers, _NUMBER, len(clip), 4)
        standing = Placement(*(_finite(part, 3) for part in head["placement"]))
        (start, stop, lines), owns = head["motion"], frozenset(head["owns"])
        motion = MotionSpan(int(start), int(stop), tuple(map(str, lines)))
        _check(0 <= motion.start < motion.stop <= len(clip) and owns <= {*CHANNELS})
        _check(bool(((free >= 0.0) & (free <= 1.0)).all()))
        values: dict[Callable[[Clip], Any], Any] = {
            find_motion_span: motion,
            list_clip_warnings: tuple(map(str, head["warnings"])),
            find_placement: standing,
            judge_clip: Keyedness(*head["keyed"]),
            find_owned_channels: owns,
            find_freedom: free,
            find_hand_offsets: _finite(head["hands"], 2, 3),
            find_low_places: tuple(_lower_arms(clip, head["low"])),
        }
        ends = []
        for first, active, stroke, n_frames, n_scores in head["ends"]:
            heights, numbers = _array(numbers, _HEIGHT, n_frames, 2)
            scores, numbers = _array(numbers, _NUMBER, n_scores)
            span = None if stroke is None else (int(stroke[0]), int(stroke[1]))
            _check(first >= 0 and 0 <= active[0] < active[1] <= n_frames and n_scores == active[1] - active[0])
            _check(span is None or 0 <= span[0] <= span[1] < n_frames)
            _check(bool(np.isfinite(heights).all() and np.isfinite(scores).all()))
            ends.append(WordEnd(first, (active[0], active[1]), span, heights, scores))
        _check(not numbers and len(ends) in (0, 2))
        if reader is not None and head["cutter"] == _cutter_key(reader):
            values[reader.ends] = ends[0], ends[1]
    except Exception:  # a card from elsewhere may hold anything; then it is computed
        return {}
    return values


def _check(holds: bool) -> None:
    """Raise ``ValueError`` if what a card must hold does not."""
    if not holds:
        raise ValueError("the card does not fit")


def _finite(numbers: Any, *shape: int) -> FloatArray:
    """Return finite numbers, each below 1e9, of a shape. Raises ``ValueError`` for others."""
    array = np.array(numbers, np.float64).reshape(shape)
    _check(bool((np.abs(array) < 1e9).all()))
    return array


def _upper_and_lower_arms(clip: Clip) -> list[list[int]]:
    """Return the joints of the left upper and lower arm, and of the right ones."""
    joints = rig_info(clip.skeleton).arm_joints
    return [joints[0:2], joints[3:5]]


def _lower_arms(clip: Clip, stored: Sequence[Any]) -> Iterator[FloatArray | None]:
    """Yield the first frame (J, 4) of a clip with the left and with the right arm at its low place; None for none."""
    for rotations, joints in zip(stored, _upper_and_lower_arms(clip), strict=True):
        if rotations is None:
            yield None
            continue
        local = np.array(clip.local_rotations[0])
        local[joints] = _finite(rotations, 2, 4)
        _check(bool((np.abs(np.linalg.norm(local[joints], axis=1) - 1.0) < 1e-5).all()))
        yield local


def _array(content: bytes, kind: str, *shape: int) -> tuple[NDArray[Any], bytes]:
    """Return the array that bytes begin with, and the bytes after it."""
    array = np.frombuffer(content, kind, math.prod(shape)).reshape(shape)
    return array, content[array.nbytes :]


def _reads_alone(cutter: Cutter) -> LearnedCutter | None:
    """Return a cutter whose networks read each word by itself; None for others."""
    return cutter if isinstance(cutter, LearnedCutter) and cutter.whole else None


def _key(sha256: str) -> str:
    return hashlib.sha256(f"{VERSION} {sha256}".encode()).hexdigest()


def _cutter_key(cutter: LearnedCutter) -> str:
    """Return what the ends that a cutter reads depend on, besides the word."""
    files = cutter.reader.sessions.config.files
    return hashlib.sha256(f"{features.VERSION} {files['word.onnx']} {files['cut.onnx']}".encode()).hexdigest()


def digest_clip(clip: Clip) -> bytes:
    """Return a digest of a clip's frames, skeleton and rate, and of the notes on its file."""
    digest = hashlib.blake2b(clip.skeleton.derived[digest_skeleton], digest_size=32)
    digest.update(repr((clip.fps, len(clip), clip.left_out, clip.notes)).encode())
    add_frames(digest, clip)
    return digest.digest()


def add_frames(digest: hashlib.blake2b, clip: Clip) -> None:
    """Add the frames of a clip to a digest."""
    for array in (clip.local_rotations, clip.root_positions, clip.translations):
        digest.update(b"-" if array is None else b"+" + np.ascontiguousarray(array).tobytes())


def digest_skeleton(skeleton: Skeleton) -> bytes:
    """Return a digest of a skeleton: names, parents, offsets, tips, roles and rest pose."""
    tips = [(site.joint, site.offset.tobytes()) for site in skeleton.end_sites]
    roles = None if skeleton.roles is None else sorted(skeleton.roles.items())
    rest = None if skeleton.rest_pose is None else skeleton.rest_pose.tobytes()
    contents = (skeleton.names, skeleton.parents.tolist(), skeleton.offsets.tobytes(), tips, roles, rest)
    return hashlib.blake2b(repr(contents).encode(), digest_size=32).digest()
