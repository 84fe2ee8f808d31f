"""Motion: a skeleton, and a clip of its joints' rotations over time.

Both are frozen and are checked once, when created; ``derived`` caches values computed from them. Operations are module
functions: ``concatenate``, ``resample``, ``batch_clips``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import ref

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signsplice.errors import InputError
from signsplice.hooks import html_renderers
from signsplice.motion import rotation
from signsplice.motion.face import Face, concatenate_faces
from signsplice.motion.points import Points, concatenate_points
from signsplice.motion.rotation import FloatArray

_UNIT_TOLERANCE = 1e-6
_BLOCK = 32
_FARTHEST = 1e12
"""Limit of lengths and positions: larger ones are not motion."""
_LONGEST_NAME = 300
SAME_FPS = 1e-6
"""Frame rates that differ by less than this fraction are equal."""
MOST_FRAMES = 1500
"""Frames that ``batch_clips`` joins at most: larger batches exceed the processor's cache and are no faster."""
Value = TypeVar("Value")
ChannelNames = tuple[tuple[str, ...], ...]


def frozen(array: ArrayLike) -> FloatArray:
    """Return a read-only view, without a copy."""
    view = np.asarray(array, np.float64).view()
    view.flags.writeable = False
    return view


def _is_text(text: object) -> bool:
    """Whether an object is text that UTF-8 can encode; lone surrogates of JSON or of a file name are not."""
    return isinstance(text, str) and not any("\ud800" <= character <= "\udfff" for character in text)


def _are_near(lengths: FloatArray) -> bool:
    """Whether all lengths are finite and within ``_FARTHEST``; False for NaN."""
    return lengths.size == 0 or bool(lengths.min() > -_FARTHEST and lengths.max() < _FARTHEST)


class Derived(dict[Callable[[Any], Any], Any]):
    """Cache of values computed from an object, by the function that computes them.

    ``clip.derived[arms]`` calls ``arms(clip)`` at the first access and keeps the value as long as the object lives.
    Neither the value nor this mapping may refer to the object. Safe to clear at any time; ``shared`` stays.

    shared: values of all objects with the same content, for the functions that are its keys; None if not computed yet.
    """

    def __init__(self, owner: object) -> None:
        self._owner = ref(owner)
        self.shared: dict[Callable[[Any], Any], Any] = {}

    def share(self, values: dict[Callable[[Any], Any], Any]) -> None:
        """Take values that are known of all objects with the same content, and add to them what is computed here."""
        self.shared = values

    def __missing__(self, compute: Callable[[Any], Any]) -> Any:
        value = self.shared.get(compute)
        if value is None:
            value = compute(self._owner())
            if compute in self.shared:
                self.shared[compute] = value
        self[compute] = value
        return value

    if TYPE_CHECKING:

        def __getitem__(self, compute: Callable[[Any], Value]) -> Value: ...


class HasDerived:
    """An object that caches values computed from it; copies start with an empty cache."""

    @cached_property
    def derived(self) -> Derived:
        """Values computed from this object alone."""
        return Derived(self)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "derived"}


@dataclass(frozen=True)
class StoredCard:
    """What a lexicon stores of a word by itself, for splices (``splicing.cards``).

    sha256: of the word's stored frames.
    content: a card; empty if none is stored.
    """

    sha256: str
    content: bytes


def stored_card(clip: Clip) -> StoredCard | None:
    """Return the card that a lexicon has put into the derived values of a clip; None for other clips."""
    return None


@dataclass(frozen=True, eq=False)
class EndSite:
    """The tip of a bone at the end of a chain of joints.

    joint: index of the joint that carries the bone.
    offset: (3,) from that joint to the tip, clip units.
    """

    joint: int
    offset: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen(self.offset))


@dataclass(frozen=True, eq=False, repr=False)
class Skeleton(HasDerived):
    """Joints, parents before children.

    names: J different names.
    parents: (J,) index of each joint's parent; -1 for the root, which comes first.
    offsets: (J, 3) rest translation from the parent, in the parent's frame, in the clip's length unit.
    end_sites: bone tips.
    roles: role -> joint name, given by a user if the joint names are not recognised (``rig.roles``); else None.
    rest_pose: (J, 4) local rotations that show a person, if all at identity show none (``rig.rest_pose``); else None.

    Raises ``InputError`` if these do not fit together.
    """

    names: tuple[str, ...]
    parents: NDArray[np.intp]
    offsets: FloatArray
    end_sites: tuple[EndSite, ...] = ()
    roles: Mapping[str, str] | None = None
    rest_pose: FloatArray | None = None

    def __post_init__(self) -> None:
        parents = np.asarray(self.parents, np.intp).view()
        parents.flags.writeable = False
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "parents", parents)
        object.__setattr__(self, "offsets", frozen(self.offsets))
        n = len(self.names)
        if n == 0 or parents.shape != (n,) or self.offsets.shape != (n, 3):
            raise InputError(
                f"skeleton: {n} names, parents {parents.shape} and offsets {self.offsets.shape} do not fit; "
                "expected J names, (J,) and (J, 3) with J >= 1"
            )
        if not all(_is_text(name) and len(name) <= _LONGEST_NAME for name in self.names):
            raise InputError(f"skeleton: a joint name is no text of at most {_LONGEST_NAME} characters that UTF-8 has")
        roles = {} if self.roles is None else self.roles
        if not isinstance(roles, Mapping) or not all(isinstance(text, str) for text in (*roles, *roles.values())):
            raise InputError("skeleton: roles, expected role -> joint name")
        if len(set(self.names)) != n:
            twice = next(name for k, name in enumerate(self.names) if self.index[name] != k)
            raise InputError(f"skeleton: joint name {twice!r} appears twice, expected different names")
        if parents[0] != -1 or np.any(parents[1:] < 0) or np.any(parents >= np.arange(n)):
            raise InputError("skeleton: expected the root first (parent -1) and every other joint after its parent")
        if not _are_near(self.offsets):
            raise InputError(f"skeleton: an offset is not a finite number below {_FARTHEST:g}")
        for site in self.end_sites:
            if not 0 <= site.joint < n or site.offset.shape != (3,) or not _are_near(site.offset):
                raise InputError(
                    f"skeleton: end site of joint {site.joint} with offset {site.offset.shape}, expected one of {n} "
                    f"joints and three finite numbers below {_FARTHEST:g}"
                )

    def __repr__(self) -> str:
        return f"<Skeleton: {len(self)} joints below {self.names[0]}>"

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def index(self) -> dict[str, int]:
        """Joint name -> its index."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """For each joint, the indices of its children in order."""
        rows: list[list[int]] = [[] for _ in self.names]
        for joint, parent in enumerate(self.parents[1:], start=1):
            rows[parent].append(joint)
        return tuple(tuple(row) for row in rows)


@dataclass(frozen=True, eq=False)
class Channels:
    """The channels of a clip as read from a file.

    names: for each joint its channels in the file's order ("Zrotation", ...).
    values: (T, C) degrees and length units, C all channels in order; NaN for numbers that no file gave.
    offsets: (J, 3) rest translations as written, which position channels replace.
    frame_time: seconds a frame as written.
    starts: frames at which numbers from another source begin.
    root_moved: whether the root was moved since the file was read, so that its numbers no longer hold.
    """

    names: ChannelNames
    values: FloatArray
    offsets: FloatArray
    frame_time: float
    starts: tuple[int, ...] = (0,)
    root_moved: bool = False

    def __post_init__(self) -> None:
        width = sum(map(len, self.names))
        if self.values.ndim != 2 or self.values.shape[1] != width:
            raise InputError(f"channel values {self.values.shape}, expected (T, {width})")
        for name in ("values", "offsets"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.offsets.shape[1:] != (3,) or not 0.0 <= self.frame_time < np.inf:
            raise InputError(f"channel offsets {self.offsets.shape} at {self.frame_time} s a frame, expected (J, 3)")

    def __getitem__(self, frames: slice) -> Channels:
        start, stop, _ = frames.indices(len(self.values))
        inner = tuple(s - start for s in self.starts if start < s < stop)
        return replace(self, values=self.values[start:stop], starts=(0, *inner))

    def forgotten(self, n_frames: int) -> Channels:
        """Return the same layout for ``n_frames`` new frames, with all numbers NaN. Takes no memory."""
        values = np.broadcast_to(np.nan, (n_frames, self.values.shape[1]))
        return replace(self, values=values, starts=(0,), root_moved=False)

    def without_root(self) -> Channels:
        """Return the same numbers with the root's marked as outdated. Takes no memory."""
        return replace(self, root_moved=True)

    def mask_moved_root(self) -> Channels:
        """Return the same channels, with the root's ``values`` NaN if it was moved."""
        if not self.root_moved:
            return self
        values = np.array(self.values)
        values[:, : len(self.names[0])] = np.nan
        return replace(self, values=values, root_moved=False)

    @staticmethod
    def concatenate(parts: Sequence[tuple[Channels | None, int]]) -> Channels | None:
        """Join channels in time, each given with its number of frames, in the first one's layout.

        Numbers of a part with another layout become NaN. Returns None if the first is None.
        """
        layout = parts[0][0]
        if layout is None:
            return None
        width = layout.values.shape[1]
        values = np.empty((sum(n for _, n in parts), width))
        starts: list[int] = []
        row = 0
        for channels, n_frames in parts:
            if channels is not None and (channels.names is layout.names or channels.names == layout.names):
                values[row : row + n_frames] = channels.values
                if channels.root_moved:
                    values[row : row + n_frames, : len(layout.names[0])] = np.nan
                starts += [row + s for s in channels.starts]
            else:
                values[row : row + n_frames] = np.nan
                starts.append(row)
            row += n_frames
        return replace(layout, values=values, starts=tuple(starts), root_moved=False)


@dataclass(frozen=True, eq=False, repr=False)
class Clip(HasDerived):
    """A motion of one skeleton at an even frame rate; T frames, J joints.

    skeleton: the joints; all of its rotations at identity are the rest pose.
    local_rotations: (T, J, 4) unit quaternions x y z w, each joint relative to its parent.
    root_positions: (T, 3) position of the root in the world, in the skeleton's length unit.
    fps: frames a second.
    name: the gloss or file name.
    translations: (T, J, 3) offset from the parent per frame, for files that animate bone lengths; None: the skeleton's.
    channels: the numbers of the file, kept to be written back exactly; None without a file.
    left_out: names of what its file animates but the clip does not hold (expressions, morph targets, look-at).
    notes: lines about other differences from its file: the first of several animations, a rounded rate.
    face: the face in every frame; None if unknown.
    points: the landmarks of the video that its pose was fitted to; None for motion from elsewhere.
    report: JSON-ready report of the splice that made the frames (``splicing.report``); None for all others.
    source_clip: the clip that this one is a rigid placement of (``rig.align.place``), else None.

    Arrays are used without a copy: do not write to them afterwards. Raises ``InputError`` if shapes do not fit, T is 0,
    a number is not finite or a quaternion has not unit length.
    """

    skeleton: Skeleton
    local_rotations: FloatArray
    root_positions: FloatArray
    fps: float
    name: str = ""
    translations: FloatArray | None = None
    channels: Channels | None = None
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    face: Face | None = None
    points: Points | None = None
    report: Mapping[str, Any] | None = None
    source_clip: Clip | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        for name in ("local_rotations", "root_positions", "translations"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen(value))
        object.__setattr__(self, "fps", float(self.fps))
        q, p, j = self.local_rotations, self.root_positions, len(self.skeleton)
        if not _is_text(self.name):
            raise InputError("clip: its name is no text that UTF-8 has")
        label = f"clip {self.name[:80]!r}" if self.name else "clip"
        if q.ndim != 3 or q.shape[1:] != (j, 4) or p.shape != (len(q), 3):
            raise InputError(
                f"{label}: rotations {q.shape} and root positions {p.shape} do not fit {j} joints; "
                f"expected (T, {j}, 4) and (T, 3)"
            )
        if len(q) == 0:
            raise InputError(f"{label}: no frames, expected at least one")
        if self.translations is not None and self.translations.shape != (len(q), j, 3):
            raise InputError(f"{label}: translations {self.translations.shape}, expected {(len(q), j, 3)}")
        if not (np.isfinite(self.fps) and self.fps > 0.0):
            raise InputError(f"{label}: frame rate {self.fps}, expected a positive number")
        if not _are_near(p) or (self.translations is not None and not _are_near(self.translations)):
            raise InputError(f"{label}: a position is not a finite number below {_FARTHEST:g}")
        squared = np.einsum("tjc,tjc->tj", q, q)
        if not (np.abs(squared - 1.0) < 2.0 * _UNIT_TOLERANCE).all():  # False for NaN too
            t, joint = np.argwhere(~(np.abs(squared - 1.0) < 2.0 * _UNIT_TOLERANCE))[0]
            raise InputError(
                f"{label}: rotation of joint {self.skeleton.names[joint]!r} at frame {t} has length "
                f"{np.sqrt(squared[t, joint]):.6g}, expected unit quaternions"
            )
        if self.channels is not None and self.channels.values.shape[0] != len(q):
            raise InputError(f"{label}: {len(self.channels.values)} rows of channels for {len(q)} frames")
        if self.channels is not None and not (len(self.channels.names) == len(self.channels.offsets) == j):
            raise InputError(f"{label}: channels of {len(self.channels.names)} joints, expected {j}")
        if self.face is not None and len(self.face) != len(q):
            raise InputError(f"{label}: a face of {len(self.face)} frames for {len(q)} frames")
        if self.points is not None and len(self.points) != len(q):
            raise InputError(f"{label}: landmarks of {len(self.points)} frames for {len(q)} frames")

    def __repr__(self) -> str:
        frames = f"{len(self)} frame{'s' * (len(self) != 1)}, {self.seconds:.2f} s at {self.fps:g} fps"
        return f"<Clip {self.name!r}: {frames}, {len(self.skeleton)} joints>"

    def _repr_html_(self) -> str:
        """Return an animated drawing of this clip, for notebooks."""
        return html_renderers[-1](self)

    def __len__(self) -> int:
        return len(self.local_rotations)

    def __getitem__(self, frames: slice) -> Clip:
        """Return the frames of a slice with step 1, as views of this clip's arrays. Raises ``InputError`` if the slice
        is empty, ``TypeError`` for anything but a slice.
        """
        if not isinstance(frames, slice):
            raise TypeError(f"a clip is cut with a slice: clip[3:4], not clip[{frames!r:.40}]")
        start, stop, step = frames.indices(len(self))
        if step != 1:
            raise InputError("a clip is sliced with step 1; use resample to change its rate")
        if stop <= start:
            raise InputError(f"frames {start}:{stop} of clip {self.name!r}: none left, expected at least one")
        frames = slice(start, stop)
        return copy_unchecked(
            self,
            **_arrays_at(self, frames),
            channels=None if self.channels is None else self.channels[frames],
            face=None if self.face is None else self.face[frames],
            points=_points_at(self, frames),
        )

    @property
    def seconds(self) -> float:
        """Duration of the clip: each frame counts for 1 / fps."""
        return len(self) / self.fps

    @property
    def nbytes(self) -> int:
        """Bytes of memory of the clip's arrays."""
        total = self.local_rotations.nbytes + self.root_positions.nbytes
        total += 0 if self.face is None else self.face.weights.nbytes
        total += 0 if self.points is None else self.points.nbytes
        if self.translations is not None:
            total += self.translations.nbytes
        return total + (self.channels.values.nbytes if self.channels is not None else 0)


def same_fps(a: float, b: float) -> bool:
    """Whether two frame rates are equal (they differ by less than a millionth)."""
    return abs(a - b) <= SAME_FPS * max(a, b)


def concatenate(clips: Sequence[Clip], name: str = "") -> Clip:
    """Join clips in order into one, bit for bit, on the first clip's skeleton.

    Raises ``InputError`` if a clip has other joint names or another frame rate.
    """
    if not clips:
        raise InputError("nothing to join, expected at least one clip")
    first = clips[0]
    for clip in clips[1:]:
        if clip.skeleton is not first.skeleton and clip.skeleton.names != first.skeleton.names:
            raise InputError(f"clip {clip.name!r} has other joints than {first.name!r}; align it first")
        if not same_fps(clip.fps, first.fps):
            raise InputError(
                f"clip {clip.name!r} runs at {clip.fps:g} fps, {first.name!r} at {first.fps:g}; resample it first"
            )
    return copy_unchecked(
        first,
        **_concatenate_arrays(clips),
        name=name or first.name,
        channels=first.channels and Channels.concatenate([(clip.channels, len(clip)) for clip in clips]),
        face=concatenate_faces([(clip.face, len(clip)) for clip in clips])
        if any(clip.face is not None for clip in clips)
        else None,
        points=concatenate_points([clip.points for clip in clips]),
    )


def _concatenate_arrays(clips: Sequence[Clip]) -> dict[str, Any]:
    moving = any(clip.translations is not None for clip in clips)
    return {
        "local_rotations": np.concatenate([clip.local_rotations for clip in clips]),
        "root_positions": np.concatenate([clip.root_positions for clip in clips]),
        "translations": np.concatenate([bone_translations(clip) for clip in clips]) if moving else None,
    }


def copy_unchecked(clip: Clip, **changes: object) -> Clip:
    """Copy ``clip`` with some fields changed, without the checks of a new clip and without its ``source_clip``; also
    without its face, points and report if the number of frames changes and none are given.

    For changes that cannot break a valid clip: slices, joins and rigid moves.
    """
    new_clip = object.__new__(Clip)
    new_clip.__dict__.update(clip.__dict__, source_clip=None)
    new_clip.__dict__.pop("derived", None)
    for name, value in changes.items():
        new_clip.__dict__[name] = frozen(value) if isinstance(value, np.ndarray) and value.flags.writeable else value
    for name in ("face", "points"):
        if new_clip.__dict__[name] is not None and len(new_clip.__dict__[name]) != len(new_clip):
            new_clip.__dict__[name] = None
    if "report" not in changes and len(new_clip) != len(clip):
        new_clip.__dict__["report"] = None
    return new_clip


def at_frames(clip: Clip, frames: slice | NDArray[np.intp]) -> Clip:
    """Return the frames of a clip in a slice or at indices, in any order, without its file's channels."""
    return copy_unchecked(clip, **_arrays_at(clip, frames), channels=None, points=_points_at(clip, frames))


def _points_at(clip: Clip, frames: slice | NDArray[np.intp]) -> Points | None:
    return None if clip.points is None else clip.points[frames]


def _arrays_at(clip: Clip, frames: slice | NDArray[np.intp]) -> dict[str, Any]:
    return {
        "local_rotations": clip.local_rotations[frames],
        "root_positions": clip.root_positions[frames],
        "translations": None if clip.translations is None else clip.translations[frames],
    }


def bone_translations(clip: Clip) -> FloatArray:
    """Return the translation (T, J, 3) of every joint from its parent in every frame, animated or not."""
    if clip.translations is not None:
        return clip.translations
    return np.broadcast_to(clip.skeleton.offsets, (len(clip), len(clip.skeleton), 3))


def resample(clip: Clip, fps: float, speed: float = 1.0) -> Clip:
    """Resample a clip at ``fps``, played ``speed`` times as fast; slerp between neighbouring frames.

    Frame k of the result shows time k / fps; the last one is the last that the source covers. Returns the clip itself
    if neither rate nor speed changes. Raises ``InputError`` if the rate or speed is not positive.
    """
    for what, value in (("frame rate", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{what} {value}, expected a positive number")
    if same_fps(clip.fps, fps) and speed == 1.0:
        return clip
    step = clip.fps * speed / fps  # source frames an output frame
    n_frames = int(np.floor((len(clip) - 1) / step + 1e-9)) + 1
    return replace(sample_clip(clip, np.minimum(np.arange(n_frames) * step, len(clip) - 1)), fps=fps)


def sample_clip(clip: Clip, at: FloatArray) -> Clip:
    """Sample a clip at ``at`` (N,), in frames from 0 to T - 1; slerp between neighbouring frames."""
    low = np.minimum(np.floor(at + 1e-9).astype(np.intp), len(clip) - 1)
    high = np.minimum(low + 1, len(clip) - 1)
    weight = np.clip(at - low, 0.0, 1.0)
    q = clip.local_rotations

    rotations = np.empty((len(at), *q.shape[1:]))
    for start in range(0, len(at), _BLOCK):  # in blocks, to limit the memory of slerp
        part = slice(start, start + _BLOCK)
        rotations[part] = rotation.slerp(q[low[part]], q[high[part]], weight[part, None])

    def between(x: FloatArray) -> FloatArray:
        w = weight.reshape(-1, *([1] * (x.ndim - 1)))
        return np.asarray(x[low] + w * (x[high] - x[low]))  # a value that does not change stays exact

    return replace(
        clip,
        local_rotations=rotations,
        root_positions=between(clip.root_positions),
        translations=None if clip.translations is None else between(clip.translations),
        channels=None if clip.channels is None else clip.channels.forgotten(len(at)),
        face=None if clip.face is None else Face(clip.face.channels, between(clip.face.weights)),
        points=None if clip.points is None else clip.points.sample(low, high, weight),
    )


@dataclass(frozen=True, eq=False)
class JoinedClips:
    """Clips joined so that frame-by-frame computations handle all of them at once. Every frame gets the same numbers,
    bit for bit, as in its own clip: only the number of frames in an operation changes.

    rows: indices of the clips in the request.
    clip: all their frames.
    starts: (G + 1,) the first frame of each of the G clips, and the total number of frames.
    """

    rows: list[int]
    clip: Clip
    starts: NDArray[np.intp]

    def __iter__(self) -> Iterator[tuple[int, slice]]:
        """Yield the index of each clip and its frames."""
        for row, start, stop in zip(self.rows, self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True):
            yield row, slice(start, stop)


def batch_clips(clips: Sequence[Sequence[Clip]], most: int = MOST_FRAMES) -> Iterator[JoinedClips]:
    """Join clips, each given as its parts in order, with others of the same skeleton and rate, about ``most`` frames at
    a time, without channels and faces.
    """
    groups: dict[tuple[int, float, bool], list[int]] = {}
    for row, parts in enumerate(clips):
        moving = any(part.translations is not None for part in parts)
        groups.setdefault((id(parts[0].skeleton), parts[0].fps, moving), []).append(row)
    for rows in groups.values():
        lengths = [sum(len(part.local_rotations) for part in clips[row]) for row in rows]
        first = n_frames = 0
        for k, length in enumerate(lengths):
            if n_frames and n_frames + length > most:
                yield _concatenate_batch(clips, rows[first:k], lengths[first:k])
                first, n_frames = k, 0
            n_frames += length
        yield _concatenate_batch(clips, rows[first:], lengths[first:])


def _concatenate_batch(clips: Sequence[Sequence[Clip]], rows: list[int], lengths: list[int]) -> JoinedClips:
    parts = [part for row in rows for part in clips[row]]
    joined = copy_unchecked(parts[0], **_concatenate_arrays(parts), channels=None, face=None, points=None)
    return JoinedClips(rows, joined, np.concatenate([[0], np.cumsum(lengths)]).astype(np.intp))
