"""What a motion is: numpy and scipy only; knows no file, no gloss, no network. Its own modules import one another."""

from signsplice.motion.clip import (
    Channels,
    Clip,
    EndSite,
    JoinedClips,
    Skeleton,
    at_frames,
    bone_translations,
    concatenate,
    frozen,
    joined,
    resample,
    same_fps,
    sampled,
    unchecked_copy,
)
from signsplice.motion.rotation import FloatArray

__all__ = [
    "Channels",
    "Clip",
    "EndSite",
    "FloatArray",
    "JoinedClips",
    "Skeleton",
    "at_frames",
    "bone_translations",
    "concatenate",
    "frozen",
    "joined",
    "resample",
    "same_fps",
    "sampled",
    "unchecked_copy",
]
