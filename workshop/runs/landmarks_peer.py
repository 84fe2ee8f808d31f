"""Runs the stitcher of spoken-to-signed 0.4.0 in its own environment, for ``landmarks.py``.

python landmarks_peer.py stitch OUT.npz A.pose B.pose ...
python landmarks_peer.py fill OUT.npz A.pose START:STOP ...
"""

import contextlib
import io
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from pose_format import Pose

concatenate: Any = import_module("spoken_to_signed.gloss_to_pose.concatenate")
smoothing: Any = import_module("spoken_to_signed.gloss_to_pose.smoothing")


def read(path: str) -> Pose:
    """Return the pose in a file."""
    return Pose.read(Path(path).read_bytes())


def stitch(out: str, paths: list[str]) -> None:
    """Write the joined points, the frames where words end and begin, and the processor time, the best of five."""
    times, ends = [], []
    find = smoothing.find_best_connection_point

    def find_and_keep(first: Pose, second: Pose, window: float = 0.3) -> tuple[int, int]:
        ends.append(find(first, second, window))
        stop, start = ends[-1]
        return int(stop), int(start)

    smoothing.find_best_connection_point = find_and_keep
    for _ in range(5):
        poses = [read(path) for path in paths]
        ends.clear()
        began = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            joined = concatenate.concatenate_poses(poses)
        times.append(time.process_time() - began)
    seams, at, start = [], 0, 0
    for stop, following in ends:
        padding = int(0.07 * joined.body.fps)
        at += int(stop) - start
        seams.append((at, at + padding))
        at, start = at + padding, int(following)
    names = [f"{group.name}/{point}" for group in joined.header.components for point in group.points]
    np.savez(
        out, values=np.ma.getdata(joined.body.data)[:, 0], confidence=joined.body.confidence[:, 0],
        fps=joined.body.fps, seams=np.array(seams), names=np.array(names), seconds=min(times),
    )  # fmt: skip


def fill(out: str, path: str, gaps: list[str]) -> None:
    """Write the points of each gap, hidden, as the stitcher fills missing frames: lines, then its low-pass filter."""
    filled: dict[str, Any] = {}
    for gap in gaps:
        start, stop = map(int, gap.split(":"))
        pose = read(path)
        data, confidence = np.ma.getdata(pose.body.data).copy(), pose.body.confidence.copy()
        data[start:stop], confidence[start:stop] = 0.0, 0.0
        body = type(pose.body)(pose.body.fps, data, confidence).interpolate(kind="linear")
        whole = smoothing.pose_butterworth_filter(Pose(pose.header, body))
        filled[gap] = np.ma.getdata(whole.body.data)[start:stop, 0]
    np.savez(out, **filled)


if __name__ == "__main__":
    command, target, *rest = sys.argv[1:]
    if command == "stitch":
        stitch(target, rest)
    else:
        fill(target, rest[0], rest[1:])
