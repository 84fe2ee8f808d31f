"""What the names of face targets mean in ARKit's coefficients, and faces by such names, there and back.

Names: ARKit's own, also with ``_L`` and ``_R``; the presets of VRM 1.0 (VRMC_vrm, expressions) and of VRM 0.x
(blendShapeMaster), VRoid's targets of mouth and lids, and Meta's 15 visemes (Oculus Lipsync, "Viseme Reference"). The
sources define names and show pictures, no numbers: the coefficients are of our own, written down from how a sound is
articulated.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.face import ARKIT_CHANNELS, Face


def _both(**parts: float) -> dict[str, float]:
    """Coefficients of both sides: mouthSmile -> mouthSmileLeft, mouthSmileRight."""
    return {f"{part}{side}": weight for part, weight in parts.items() for side in ("Left", "Right")}


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
"""How the names of a mouth's coefficients begin."""
_OTHER_NAMES = {
    **{"a": "aa", "i": "ih", "u": "ou", "e": "ee", "o": "oh", "joy": "happy", "sorrow": "sad", "fun": "relaxed"},
    **{"blinkl": "blinkLeft", "blinkr": "blinkRight", "fcleyeclose": "blink"},
    **{"fcleyeclosel": "blinkLeft", "fcleyecloser": "blinkRight"},
    **{f"fclmth{vowel}": preset for vowel, preset in zip("aiueo", ("aa", "ih", "ou", "ee", "oh"), strict=True)},
}
"""Names in VRM 0.x and in VRoid's files -> VRM 1.0 preset."""


def _plain(name: str) -> str:
    """A target's name without the mesh or namespace before it, in lower case, letters and digits alone."""
    return re.sub("[^a-z0-9]", "", re.split("[.:|]", name)[-1].lower())


def _channel_names() -> dict[str, str]:
    """Plain name -> coefficient, also with L and R for the sides."""
    found = {_plain(channel): channel for channel in ARKIT_CHANNELS}
    for channel in ARKIT_CHANNELS:
        short = re.sub("Left$", "L", re.sub("Right$", "R", channel))
        if channel not in ("jawLeft", "jawRight", "mouthLeft", "mouthRight"):
            found[_plain(short)] = channel
    return found


_CHANNELS = _channel_names()
_MIXED: Mapping[str, Mapping[str, float]] = {
    **{_plain(name): shape for name, shape in PRESETS.items()},
    **{other: PRESETS[name] for other, name in _OTHER_NAMES.items()},
    **{f"{mark}{name.lower()}": shape for name, shape in VISEMES.items() for mark in ("viseme", "v")},
}
_SHOWN, _APART = 0.1, 0.2
"""A coefficient that reaches the first is seen to be lost where a target is off by more than the second."""


def channel_of(name: str) -> str | None:
    """The coefficient whose name, as ARKit has it, a target bears; None for any other."""
    return _CHANNELS.get(_plain(name))


def preset_of(name: str) -> str | None:
    """The preset of VRM 1.0 that a name means, also one of VRM 0.x; None for any other."""
    return _OTHER_NAMES.get(_plain(name)) or (name if name in PRESETS else None)


def shape_of(name: str) -> Mapping[str, float] | None:
    """What a target by a name shows, coefficient -> weight, empty for a face at rest; None for an unknown name."""
    channel = channel_of(name)
    return _MIXED.get(_plain(name)) if channel is None else {channel: 1.0}


def face_from(names: Sequence[str], weights: FloatArray) -> Face | None:
    """The face that targets show by their weights (T, N); None where no name is known. Where some are ARKit's own,
    those alone count for their coefficient, and for the whole mouth: presets beside them say the same again.
    """
    own = {channel: k for k, name in enumerate(names) if (channel := channel_of(name)) is not None}
    has_mouth = any(channel.startswith(MOUTH) for channel in own)
    out = np.zeros((len(weights), len(ARKIT_CHANNELS)))
    known = set(own)
    for name, values in zip(names, weights.T, strict=True):
        for channel, weight in _MIXED.get(_plain(name), {}).items():
            if channel not in own and not (has_mouth and channel.startswith(MOUTH)):
                out[:, ARKIT_CHANNELS.index(channel)] += weight * values
                known.add(channel)
    for channel, k in own.items():
        out[:, ARKIT_CHANNELS.index(channel)] = weights[:, k]
    channels = tuple(channel for channel in ARKIT_CHANNELS if channel in known)
    columns = [ARKIT_CHANNELS.index(channel) for channel in channels]
    return Face(channels, np.clip(out[:, columns], 0.0, 1.0)) if channels else None


def target_weights(face: Face, names: Sequence[str]) -> tuple[FloatArray, tuple[str, ...]]:
    """Weights (T, N) from 0 to 1 with which targets by these names show a face, and the coefficients that they cannot
    show. ARKit's own names take their coefficient; what is left over, visemes and presets by least squares, emotions
    never: no coefficient says what a person feels.
    """
    wanted, shown = face.of(ARKIT_CHANNELS), np.zeros((len(face), len(ARKIT_CHANNELS)))
    out, mixed, left = np.zeros((len(face), len(names))), dict[int, Mapping[str, float]](), np.array(wanted)
    for k, name in enumerate(names):
        if (channel := channel_of(name)) is not None:
            column = ARKIT_CHANNELS.index(channel)
            out[:, k] = shown[:, column] = wanted[:, column]
            left[:, column] = 0.0
        elif (shape := _MIXED.get(_plain(name))) and shape not in _EMOTIONS:
            mixed[k] = shape
    if mixed:
        from scipy.optimize import nnls  # a conversion without a face does without scipy

        basis = np.array([[shape.get(name, 0.0) for shape in mixed.values()] for name in ARKIT_CHANNELS])
        for t in np.flatnonzero(left.any(axis=1)):
            out[t, list(mixed)] = np.minimum(nnls(basis, left[t])[0], 1.0)
        shown = np.maximum(shown, out[:, list(mixed)] @ basis.T)
    is_lost = (wanted.max(axis=0) > _SHOWN) & (np.abs(wanted - shown).max(axis=0) > _APART)
    return out, tuple(name for name, lost in zip(ARKIT_CHANNELS, is_lost, strict=True) if lost)
