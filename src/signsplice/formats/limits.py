"""How much a file may ask for, so that a small or broken file never costs unbounded time or memory."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from signsplice.errors import LimitError

if TYPE_CHECKING:
    from signsplice.motion.clip import Clip

FRAME_BYTES = 80
"""Memory that a joint takes in a frame while its clip is made: a rotation, a translation, and checks of both."""


@dataclass(frozen=True)
class ReadLimits:
    """The limits of everything that reads clips. The defaults pass two hours of 75 joints at 120 fps, 1.8 GB of BVH.

    file_bytes: size of a file, with the buffer files that it names.
    unpacked_bytes: size of an archive's members, unpacked.
    expansion: how many times its own size an archive may unpack to, beyond 64 MiB.
    members: members of an archive.
    joints, depth: joints (and End Sites) of a skeleton, and how deep they nest in BVH.
    nodes: nodes of a glTF document.
    frames: frames of a clip, as read and at the output's rate.
    seconds, fps: duration and frame rate of a clip.
    free_bytes, growth: a clip's arrays, and what they are decoded from, may take ``free_bytes`` of memory and
        ``growth`` times the file's own size besides. A clip that is resampled may grow by as much.
    """

    file_bytes: float = 2 << 30
    unpacked_bytes: float = 8 << 30
    expansion: float = 200.0
    members: float = 100
    joints: float = 1024
    depth: float = 256
    nodes: float = 50_000
    frames: float = 2_000_000
    seconds: float = 86_400.0
    fps: float = 1000.0
    free_bytes: float = 48 << 20
    growth: float = 10.0

    def check_clip(
        self, n_frames: float, n_joints: int, fps: float, n_bytes: float, given_bytes: float, file: str = ""
    ) -> None:
        """Raise ``LimitError`` where a clip is larger than allowed; its arrays take ``n_bytes`` and come from
        ``given_bytes``.
        """
        what = f"{n_frames / fps:,.0f} s of {n_joints:,} joints at {fps:g} fps, {n_frames:,.0f} frames"
        for most, value, unit in (
            (self.joints, n_joints, "joints"),
            (self.fps, fps, "fps"),
            (self.seconds, n_frames / fps, "seconds"),
            (self.frames, n_frames, "frames"),
        ):
            if not value <= most:  # True for NaN too
                raise LimitError(f"{what}, expected at most {most:,.0f} {unit}", file=file)
        self.check_memory(what, n_bytes, given_bytes, file)

    def check_resampling(self, clip: Clip, fps: float, speed: float = 1.0) -> None:
        """Raise ``LimitError`` where ``resample`` would make more frames than allowed, or far more than there are."""
        n_given, n_joints, _ = clip.local_rotations.shape
        n_frames, frame_bytes = n_given / clip.fps / speed * fps, n_joints * FRAME_BYTES
        self.check_clip(n_frames, n_joints, fps, n_frames * frame_bytes, n_given * frame_bytes, clip.name)

    def check_memory(self, what: str, n_bytes: float, given_bytes: float, file: str = "") -> None:
        """Raise ``LimitError`` where ``what`` takes ``n_bytes`` of memory, far more than the ``given_bytes`` that it
        comes from.
        """
        most = self.free_bytes + self.growth * given_bytes
        if n_bytes > most:
            raise LimitError(
                f"{what} take {n_bytes / 1e6:,.0f} MB of memory, expected at most {most / 1e6:,.0f} MB from "
                f"{given_bytes:,.0f} bytes",
                file=file,
            )


DEFAULT_LIMITS = ReadLimits()
NO_LIMITS = ReadLimits(**{limit.name: math.inf for limit in fields(ReadLimits)})
"""No limit at all: for files that you trust."""
