"""A face over time as ARKit's 52 coefficients, the meaning of names of face targets in them, and their conversion to
and from bone rotations of gaze and jaw.

Coefficients are named and ordered as Apple's ``ARFaceAnchor.BlendShapeLocation`` and Live Link Face have them. Targets
have ARKit's names, also with ``_L`` and ``_R``, those of the presets of VRM 1.0 (VRMC_vrm, expressions) and of VRM 0.x
(blendShapeMaster), of VRoid's targets of mouth and lids, or of Meta's 15 visemes (Oculus Lipsync, "Viseme Reference").
The sources define names and show pictures, but no numbers: the coefficients are our own, derived from how a sound is
articulated.

Bones have the axes left +X, up +Y, forward +Z. An eye turns by its yaw about +Y, then by its pitch about +X, as VRM's
look-at does.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.rotation import FloatArray

SIDES = ("Left", "Right")
_EYE = ("Blink", "LookDown", "LookIn", "LookOut", "LookUp", "Squint", "Wide")
ARKIT_CHANNELS = (
    *(f"eye{part}{side}" for side in SIDES for part in _EYE),
    "jawForward", "jawRight", "jawLeft", "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRight",
    "mouthLeft", "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight", "mouthDimpleLeft",
    "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight", "mouthRollLower", "mouthRollUpper",
    "mouthShrugLower", "mouthShrugUpper", "mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft",
    "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp",
    "browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft",
    "noseSneerRight", "tongueOut",
)  # fmt: skip
"""The 52 coefficients in the order of a Live Link Face file."""
_KNOWN = frozenset(ARKIT_CHANNELS)


@dataclass(frozen=True, eq=False, repr=False)
class Face:
    """A face of T frames at the rate of the clip that carries it.

    channels: C different names of ``ARKIT_CHANNELS``, without coefficients that were not recorded.
    weights: (T, C) from 0, at rest, to 1.

    Raises ``InputError`` for an unknown or repeated name, another shape, or a weight outside 0 to 1.
    """

    channels: tuple[str, ...]
    weights: FloatArray

    def __post_init__(self) -> None:
        weights = np.asarray(self.weights, np.float64).view()
        weights.flags.writeable = False
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "channels", tuple(self.channels))
        for k, name in enumerate(self.channels):
            if name not in _KNOWN:
                raise InputError(f"face: {name!r:.60} is none of ARKit's 52 coefficients")
            if name in self.channels[:k]:
                raise InputError(f"face: {name} comes twice, expected different coefficients")
        if not self.channels or weights.ndim != 2 or weights.shape[1] != len(self.channels):
            raise InputError(f"face: weights {weights.shape} for {len(self.channels)} coefficients, expected (T, C)")
        if not ((weights >= 0.0) & (weights <= 1.0)).all():  # False for NaN too
            t, k = np.argwhere(~((weights >= 0.0) & (weights <= 1.0)))[0]
            raise InputError(f"face: {self.channels[k]} is {weights[t, k]:g} at frame {t}, expected 0 to 1")

    def __repr__(self) -> str:
        return f"<Face: {len(self)} frames of {len(self.channels)} coefficients>"

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, frames: slice) -> Face:
        """Return the face in some frames, with views of its weights."""
        return Face(self.channels, self.weights[frames])

    def of(self, channels: Sequence[str]) -> FloatArray:
        """Return the weights (T, len(channels)) of some coefficients; 0, at rest, for absent ones."""
        weights = np.zeros((len(self), len(channels)))
        column = {name: k for k, name in enumerate(self.channels)}
        for k, name in enumerate(channels):
            if name in column:
                weights[:, k] = self.weights[:, column[name]]
        return weights

    @property
    def moving(self) -> tuple[str, ...]:
        """The coefficients that are not always at rest."""
        peaks = self.weights.max(axis=0, initial=0.0).tolist()
        return tuple(name for name, weight in zip(self.channels, peaks, strict=True) if weight > 0.0)

    def mirror(self) -> Face:
        """Return the mirrored face: left and right coefficients swapped."""
        return Face(tuple(_counterpart(name) for name in self.channels), self.weights)


def _counterpart(name: str) -> str:
    """Return the name of the coefficient on the other side; the name itself if it has no side."""
    for side, opposite in (SIDES, SIDES[::-1]):
        if name.endswith(side):
            return name.removesuffix(side) + opposite
    return name


def concatenate_faces(parts: Sequence[tuple[Face | None, int]]) -> Face | None:
    """Join faces in time, each given with its number of frames, with the coefficients of all; a part without a face, or
    without a coefficient, is at rest. Returns None if no part has a face.
    """
    known = {name for face, _ in parts if face is not None for name in face.channels}
    if not known:
        return None
    channels = tuple(name for name in ARKIT_CHANNELS if name in known)
    rows = [np.zeros((n, len(channels))) if face is None else face.of(channels) for face, n in parts]
    return Face(channels, np.concatenate(rows))


def _both(**parts: float) -> dict[str, float]:
    """Return coefficients of both sides: mouthSmile -> mouthSmileLeft, mouthSmileRight."""
    return {f"{part}{side}": weight for part, weight in parts.items() for side in SIDES}


VISEMES: Mapping[str, Mapping[str, float]] = {
    "sil": {},
    "PP": {"mouthRollLower": 0.3, "mouthRollUpper": 0.3} | _both(mouthPress=0.5),
    "FF": {"jawOpen": 0.05, "mouthRollLower": 0.9} | _both(mouthUpperUp=0.4),
    "TH": {"jawOpen": 0.18, "tongueOut": 0.35} | _both(mouthLowerDown=0.2, mouthUpperUp=0.1),
    "DD": {"jawOpen": 0.15} | _both(mouthLowerDown=0.25, mouthStretch=0.1),
    "kk": {"jawOpen": 0.25} | _both(mouthLowerDown=0.1),
    "CH": {"jawOpen": 0.1, "mouthFunnel": 0.6, "mouthPucker": 0.15} | _both(mouthLowerDown=0.15),
    "SS": {"jawOpen": 0.05} | _both(mouthStretch=0.3, mouthLowerDown=0.25, mouthUpperUp=0.1),
    "nn": {"jawOpen": 0.12} | _both(mouthLowerDown=0.1, mouthStretch=0.05),
    "RR": {"jawOpen": 0.15, "mouthPucker": 0.35, "mouthFunnel": 0.2},
    "aa": {"jawOpen": 0.6} | _both(mouthLowerDown=0.3, mouthUpperUp=0.15),
    "E": {"jawOpen": 0.32} | _both(mouthStretch=0.3, mouthSmile=0.15, mouthLowerDown=0.25),
    "I": {"jawOpen": 0.15} | _both(mouthStretch=0.3, mouthSmile=0.35),
    "O": {"jawOpen": 0.4, "mouthFunnel": 0.5, "mouthPucker": 0.3},
    "U": {"jawOpen": 0.18, "mouthPucker": 0.75, "mouthFunnel": 0.25},
}
"""Meta's viseme -> coefficients."""
PRESETS: Mapping[str, Mapping[str, float]] = {
    "aa": VISEMES["aa"], "ih": VISEMES["I"], "ou": VISEMES["U"], "ee": VISEMES["E"], "oh": VISEMES["O"],
    "blink": _both(eyeBlink=1.0), "blinkLeft": {"eyeBlinkLeft": 1.0}, "blinkRight": {"eyeBlinkRight": 1.0},
    "lookUp": _both(eyeLookUp=1.0), "lookDown": _both(eyeLookDown=1.0),
    "lookLeft": {"eyeLookOutLeft": 1.0, "eyeLookInRight": 1.0},
    "lookRight": {"eyeLookInLeft": 1.0, "eyeLookOutRight": 1.0},
    "happy": _both(mouthSmile=0.8, cheekSquint=0.4),
    "angry": _both(browDown=0.8, noseSneer=0.3, mouthPress=0.2),
    "sad": {"browInnerUp": 0.7} | _both(mouthFrown=0.6),
    "relaxed": _both(mouthSmile=0.35, eyeSquint=0.2),
    "surprised": {"browInnerUp": 0.7, "jawOpen": 0.25} | _both(browOuterUp=0.8, eyeWide=0.7),
    "neutral": {},
}  # fmt: skip
"""VRM 1.0 preset -> coefficients."""
_EMOTIONS = [PRESETS[name] for name in ("happy", "angry", "sad", "relaxed", "surprised")]
MOUTH = ("jaw", "mouth", "tongue")
"""Prefixes of the names of a mouth's coefficients."""
_OTHER_NAMES = {
    **{"a": "aa", "i": "ih", "u": "ou", "e": "ee", "o": "oh", "joy": "happy", "sorrow": "sad", "fun": "relaxed"},
    **{"blinkl": "blinkLeft", "blinkr": "blinkRight", "fcleyeclose": "blink"},
    **{"fcleyeclosel": "blinkLeft", "fcleyecloser": "blinkRight"},
    **{f"fclmth{vowel}": preset for vowel, preset in zip("aiueo", ("aa", "ih", "ou", "ee", "oh"), strict=True)},
}
"""Names in VRM 0.x and in VRoid's files -> VRM 1.0 preset."""


def _plain(name: str) -> str:
    """Return a target's name without mesh or namespace, in lower case, letters and digits only."""
    return re.sub("[^a-z0-9]", "", re.split("[.:|]", name)[-1].lower())


def _channel_names() -> dict[str, str]:
    """Plain name -> coefficient, also with L and R for the sides."""
    channels = {_plain(channel): channel for channel in ARKIT_CHANNELS}
    for channel in ARKIT_CHANNELS:
        short = re.sub("Left$", "L", re.sub("Right$", "R", channel))
        if channel not in ("jawLeft", "jawRight", "mouthLeft", "mouthRight"):
            channels[_plain(short)] = channel
    return channels


_CHANNELS = _channel_names()
_MIXED: Mapping[str, Mapping[str, float]] = {
    **{_plain(name): shape for name, shape in PRESETS.items()},
    **{alias: PRESETS[name] for alias, name in _OTHER_NAMES.items()},
    **{f"{mark}{name.lower()}": shape for name, shape in VISEMES.items() for mark in ("viseme", "v")},
}
_SHOWN = 0.1
"""Only a coefficient whose peak exceeds this can count as lost."""
_APART = 0.2
"""A coefficient is lost if the targets miss it by more than this in some frame."""


def channel_of(name: str) -> str | None:
    """Return the ARKit coefficient that a target's name means; None for any other name."""
    return _CHANNELS.get(_plain(name))


def preset_of(name: str) -> str | None:
    """Return the VRM 1.0 preset that a name of VRM 1.0 or 0.x means; None for any other name."""
    return _OTHER_NAMES.get(_plain(name)) or (name if name in PRESETS else None)


def shape_of(name: str) -> Mapping[str, float] | None:
    """Return the shape of a target by its name, coefficient -> weight, empty for a face at rest; None if unknown."""
    channel = channel_of(name)
    return _MIXED.get(_plain(name)) if channel is None else {channel: 1.0}


def face_from(names: Sequence[str], weights: FloatArray) -> Face | None:
    """Return the face that targets show by their weights (T, N); None if no name is known.

    Targets with ARKit's names alone set their coefficient and, if any is of the mouth, the whole mouth: presets
    repeat them.
    """
    arkit_columns = {channel: k for k, name in enumerate(names) if (channel := channel_of(name)) is not None}
    has_mouth = any(channel.startswith(MOUTH) for channel in arkit_columns)
    combined = np.zeros((len(weights), len(ARKIT_CHANNELS)))
    known = set(arkit_columns)
    for name, values in zip(names, weights.T, strict=True):
        for channel, weight in _MIXED.get(_plain(name), {}).items():
            if channel not in arkit_columns and not (has_mouth and channel.startswith(MOUTH)):
                combined[:, ARKIT_CHANNELS.index(channel)] += weight * values
                known.add(channel)
    for channel, k in arkit_columns.items():
        combined[:, ARKIT_CHANNELS.index(channel)] = weights[:, k]
    channels = tuple(channel for channel in ARKIT_CHANNELS if channel in known)
    columns = [ARKIT_CHANNELS.index(channel) for channel in channels]
    return Face(channels, np.clip(combined[:, columns], 0.0, 1.0)) if channels else None


def target_weights(face: Face, names: Sequence[str]) -> tuple[FloatArray, tuple[str, ...]]:
    """Return weights (T, N) from 0 to 1 with which targets of these names show a face, and the coefficients that they
    cannot show. Targets with ARKit's names take their coefficient; visemes and presets fit the rest by least squares,
    except emotions: no coefficient says what a person feels.
    """
    goal, shown = face.of(ARKIT_CHANNELS), np.zeros((len(face), len(ARKIT_CHANNELS)))
    weights, mixed, remaining = np.zeros((len(face), len(names))), dict[int, Mapping[str, float]](), np.array(goal)
    for k, name in enumerate(names):
        if (channel := channel_of(name)) is not None:
            column = ARKIT_CHANNELS.index(channel)
            weights[:, k] = shown[:, column] = goal[:, column]
            remaining[:, column] = 0.0
        elif (shape := _MIXED.get(_plain(name))) and shape not in _EMOTIONS:
            mixed[k] = shape
    if mixed:
        from scipy.optimize import nnls  # a conversion without a face does without scipy

        basis = np.array([[shape.get(name, 0.0) for shape in mixed.values()] for name in ARKIT_CHANNELS])
        for t in np.flatnonzero(remaining.any(axis=1)):
            weights[t, list(mixed)] = np.minimum(nnls(basis, remaining[t])[0], 1.0)
        shown = np.maximum(shown, weights[:, list(mixed)] @ basis.T)
    is_lost = (goal.max(axis=0) > _SHOWN) & (np.abs(goal - shown).max(axis=0) > _APART)
    return weights, tuple(name for name, lost in zip(ARKIT_CHANNELS, is_lost, strict=True) if lost)


LOOKS = ("eyeLookIn", "eyeLookOut", "eyeLookDown", "eyeLookUp")
"""Prefixes of the names of a gaze's coefficients, in the order of ``LookAt``."""
_USUAL = (30.0,) * 4
"""Usual ranges of a gaze inward, outward, down and up, degrees."""
_JAW_DEG = 20.0
"""Rotation of a jaw with jawOpen at 1, degrees; our own: no source gives one."""
_STILL = 1e-3
"""Bones that never turn by more than this, rad, are ignored."""


@dataclass(frozen=True)
class LookAt:
    """Angles of a gaze at its limit, a coefficient of 1, inward, outward, down and up, degrees.

    gaze: of the gaze given to a VRM player, the largest input of the avatar's range maps.
    eyes: of the eyes, the output of the range maps.

    Without an avatar's maps both are 30 degrees, our own: ARKit gives none.
    """

    gaze: tuple[float, ...] = _USUAL
    eyes: tuple[float, ...] = _USUAL


def has_gaze(face: Face | None) -> bool:
    """Whether a face has gaze coefficients."""
    return face is not None and any(name.startswith(LOOKS) for name in face.channels)


def eye_quats(face: Face, side: str, degrees: tuple[float, ...]) -> FloatArray:
    """Return the rotations (T, 4) of the eye of one of ``SIDES``."""
    return _quats(*_angles(face, side, degrees))


def gaze_quats(face: Face, look_at: LookAt) -> FloatArray:
    """Return the gaze (T, 4) of both eyes, the mean of their angles, as VRM animations store it."""
    (yaw, pitch), (other_yaw, other_pitch) = (_angles(face, side, look_at.gaze) for side in SIDES)
    return _quats(0.5 * (yaw + other_yaw), 0.5 * (pitch + other_pitch))


def eye_coefficients(quats: FloatArray, side: str, degrees: tuple[float, ...]) -> dict[str, FloatArray]:
    """Convert rotations (T, 4) of an eye or a gaze to coefficient -> values (T,) from 0 to 1."""
    x, y, z = rotation.rotate(quats, [0.0, 0.0, 1.0]).T
    outward, downward = np.arctan2(x, z) * (1.0 if side == "Left" else -1.0), -np.arcsin(np.clip(y, -1.0, 1.0))
    shown = (
        np.clip(np.degrees(angle) / limit, 0.0, 1.0) if limit > 0.0 else np.zeros(len(quats))
        for angle, limit in zip((-outward, outward, downward, -downward), degrees, strict=True)
    )
    return {f"{name}{side}": values for name, values in zip(LOOKS, shown, strict=True)}


def bone_quats(face: Face, look_at: LookAt | None, opens_jaw: bool) -> dict[str, FloatArray]:
    """Return role -> rotations (T, 4) of the eyes and jaw that show a face; ``look_at``: None if eyes are no bones."""
    quats = {}
    if look_at is not None and has_gaze(face):
        quats = {f"{side.lower()}Eye": eye_quats(face, side, look_at.eyes) for side in SIDES}
    if opens_jaw and "jawOpen" in face.channels:
        quats["jaw"] = rotation.exp(np.radians(_JAW_DEG) * face.of(["jawOpen"]) * [1.0, 0.0, 0.0])
    return quats


def bone_coefficients(quats: Mapping[str, FloatArray], look_at: LookAt) -> dict[str, FloatArray]:
    """Return coefficient -> values (T,) of the rotations (T, 4) of eyes and jaw, without bones that are still."""
    coefficients: dict[str, FloatArray] = {}
    for role, rotations in quats.items():
        if float(rotation.angle_between(rotations, rotation.IDENTITY).max()) < _STILL:
            continue
        if role == "jaw":
            _, y, z = rotation.rotate(rotations, [0.0, 0.0, 1.0]).T
            coefficients["jawOpen"] = np.clip(np.degrees(np.arctan2(-y, z)) / _JAW_DEG, 0.0, 1.0)
        else:
            coefficients |= eye_coefficients(rotations, role.removesuffix("Eye").capitalize(), look_at.eyes)
    return coefficients


def _angles(face: Face, side: str, degrees: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return yaw to the left and pitch downward (T,), rad."""
    inward, outward, down, up = (face.of([name + side for name in LOOKS]) * np.radians(degrees)).T
    return (outward - inward) * (1.0 if side == "Left" else -1.0), down - up


def _quats(yaw: FloatArray, pitch: FloatArray) -> FloatArray:
    return rotation.multiply(
        rotation.exp(yaw[:, None] * [0.0, 1.0, 0.0]), rotation.exp(pitch[:, None] * [1.0, 0.0, 0.0])
    )
