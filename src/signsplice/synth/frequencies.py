"""How often pseudo-signs have hands, places, handshapes and movements: tables of weights, which need not sum to one."""

from __future__ import annotations

from signsplice.synth.phonology import Posture

HANDS = {"one": 0.39, "symmetric": 0.22, "alternating": 0.13, "base": 0.26}
PLACES = {
    "one": {"neutral": 0.30, "head": 0.50, "trunk": 0.13, "arm": 0.07},
    "symmetric": {"neutral": 0.67, "head": 0.16, "trunk": 0.17},
    "base": {"hand": 0.95, "arm": 0.03, "neutral": 0.02},
}
"""Where signs begin; together with ``HANDS``, neutral space and the other hand have their frequencies in ASL-LEX.
Alternating signs are like symmetric ones.
"""
SHAPES = {
    **dict.fromkeys(("B", "1", "5"), 8.0),
    **dict.fromkeys(("A", "S", "C", "F", "V", "O-flat", "5-claw", "B-bent", "L", "X"), 3.0),
    **dict.fromkeys(("Y", "H", "O", "10", "W", "K", "I", "8-open", "3", "V-bent", "R", "ILY", "E", "D", "G"), 1.2),
}
_HEAD = {
    **dict.fromkeys(("chin", "forehead", "mouth", "cheek", "temple", "nose", "face-space"), 2.0),
    **dict.fromkeys(("ear", "eye", "jaw", "mouth-corner", "side-space"), 0.7),
    **dict.fromkeys(("crown", "under-chin", "cheek-weak", "chin-weak", "above-head"), 1.0),
}
_NEUTRAL = {
    **{"space": 6.0, "space-mid": 3.0, "space-out": 2.0, "space-high": 3.0, "space-low": 1.5},
    **dict.fromkeys(("space-in", "space-far", "space-high-out"), 0.8),
}
_ARM = {"upper-arm-weak": 2.0, "elbow-weak": 1.0}
_TRUNK = {
    **{"chest": 2.0, "shoulder-weak": 0.8, "waist": 1.0},
    **dict.fromkeys(("shoulder", "chest-strong", "heart", "belly", "throat"), 0.7),
}
LOCATIONS = {
    "one": {"neutral": _NEUTRAL, "head": _HEAD, "trunk": _TRUNK, "arm": _ARM},
    "symmetric": {
        "neutral": {
            **{"space": 5.0, "space-mid": 5.0, "space-out": 2.0, "space-low": 2.0, "space-high": 2.0},
            "space-low-mid": 1.5,
        },
        "head": {"cheek": 1.0, "temple": 1.0, "eye": 0.5, "ear": 0.5, "mouth-corner": 0.5, "side-space": 1.0},
        "trunk": {"chest-strong": 1.0, "waist": 1.0, "shoulder": 0.5},
    },
    "base": {
        "hand": {
            **{"base-palm": 5.0, "base-back": 3.0, "base-radial": 2.0, "base-fingertips": 1.0, "base-index": 1.0},
            **{"base-fingers": 1.0, "base-ulnar": 0.5, "base-heel": 0.5, "base-fingers-back": 0.5},
        },
        "arm": {"base-wrist": 1.0, "forearm-weak": 1.0},
        "neutral": _NEUTRAL,
    },
}
"""Locations by hands and place, as ASL-LEX counts them: in front of or beside the face belongs to the head."""
PARTS = {
    **dict.fromkeys(("palm", "index", "tips", "fingertips"), 3.0),
    **dict.fromkeys(("radial", "ulnar", "middles", "pinch", "thumb", "back"), 1.0),
}
BASES = (
    Posture("B", "space-low-mid", "palm", (0.0, 1.0, 0.0), (-0.6, 0.0, 0.8)),
    Posture("B", "space-low-mid", "palm", (0.0, -1.0, 0.0), (-0.8, 0.0, 0.6)),
    Posture("S", "space-low-mid", "palm", (0.0, -1.0, 0.0), (-0.7, 0.0, 0.7)),
    Posture("1", "space-mid", "palm", (-1.0, 0.0, 0.0), (-0.2, 0.6, 0.7)),
    Posture("B", "space-mid", "palm", (-1.0, 0.0, 0.0), (0.0, 0.5, 0.85)),
    Posture("B-open", "space-mid", "palm", (0.0, 1.0, 0.0), (-0.5, 0.0, 0.87), shift=(0.0, -6.0, 2.0)),
)
COURSES = {"free": 0.55, "touch": 0.25, "release": 0.16, "still": 0.04}
"""What a sign does: it moves freely; it ends in a touch of the body or the other hand, once or repeatedly; it begins
there, mostly with a touch, and moves away; or it is one posture. In neutral space there is nothing to touch.
"""
MOVEMENTS = {
    **{"move": 0.36, "rotation": 0.12, "circle": 0.11, "local": 0.13, "shape": 0.09, "zigzag": 0.05, "far": 0.06},
    **{"base": 0.04, "slash": 0.04},
}
LOCAL_RANGES = {
    **{"wiggle": (18.0, 26.0), "twist": (22.0, 36.0), "nod": (20.0, 34.0), "bend": (40.0, 62.0), "tremble": (0.6, 1.4)},
}
