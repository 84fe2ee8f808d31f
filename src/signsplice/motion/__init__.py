"""Motion, independent of files, glosses and networks; uses numpy and scipy only. Its modules import one another."""

from signsplice.motion.clip import (
    Channels,
    Clip,
    EndSite,
    JoinedClips,
    Skeleton,
    at_frames,
    batch_clips,
    bone_translations,
    concatenate,
    copy_unchecked,
    frozen,
    resample,
    same_fps,
    sample_clip,
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
    "batch_clips",
    "bone_translations",
    "concatenate",
    "copy_unchecked",
    "frozen",
    "resample",
    "same_fps",
    "sample_clip",
]
