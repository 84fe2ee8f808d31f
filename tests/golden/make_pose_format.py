"""Makes pose_format.pose and pose_format.json by the package pose-format (0.15.0, MIT), an independent writer.

The file has three frames of one person, with points of all kinds of components and some that are not seen; the JSON
repeats its numbers. Run it in an environment with pose-format: python tests/golden/make_pose_format.py
"""

import json
from pathlib import Path

import numpy as np
from pose_format import Pose
from pose_format.numpy import NumPyPoseBody
from pose_format.pose_header import PoseHeader, PoseHeaderComponent, PoseHeaderDimensions

HERE = Path(__file__).parent
BODY = ["NOSE", "LEFT_SHOULDER", "RIGHT_SHOULDER", "LEFT_ELBOW", "RIGHT_ELBOW", "LEFT_WRIST", "RIGHT_WRIST"]

components = [
    PoseHeaderComponent("POSE_LANDMARKS", BODY, [(1, 2), (1, 3)], [(255, 0, 10), (0, 255, 0)], "XYZC"),
    PoseHeaderComponent("LEFT_HAND_LANDMARKS", [f"P{n}" for n in range(21)], [(0, 1)], [(1, 2, 3)], "XYZC"),
]
header = PoseHeader(0.2, PoseHeaderDimensions(640, 480, 100), components)
generator = np.random.default_rng(1)
values = (generator.random((3, 1, 28, 3)) * 100.0).astype(np.float32)
places = [(250, 100), (300, 200), (200, 200), (330, 280), (170, 280), (320, 340), (180, 340)]
values[:, 0, :7, :2] = np.array(places) + generator.random((3, 7, 2))
confidence = np.ones((3, 1, 28), np.float32)
confidence[1, 0, 7:] = 0.0
confidence[2, 0, 0] = 0.25
pose = Pose(header, NumPyPoseBody(25.0, values, confidence))
with (HERE / "pose_format.pose").open("wb") as file:
    pose.write(file)
shown = {"fps": 25.0, "size": [640, 480, 100], "points": BODY + components[1].points}
numbers = {"values": values[:, 0].tolist(), "confidence": confidence[:, 0].tolist()}
(HERE / "pose_format.json").write_text(json.dumps(shown | numbers))
