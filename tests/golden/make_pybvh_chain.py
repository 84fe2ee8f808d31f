"""Makes pybvh_chain.bvh and pybvh_chain.npz with pybvh 0.9.0, an independent reader, writer and forward kinematics.

    python tests/golden/make_pybvh_chain.py

The motion is random Euler angles on a small tree with a branch; every joint has another channel order.
"""

from pathlib import Path

import numpy as np
import pybvh

HERE = Path(__file__).parent
TREE = [
    ("Hips", "", "ZXY"),
    ("Spine", "Hips", "XYZ"),
    ("Arm", "Spine", "YZX"),
    ("Hand", "Arm", "ZYX"),
    ("Leg", "Hips", "XZY"),
]
"""Joint, its parent, and the order of its rotation channels."""


def main() -> None:
    """Write both files."""
    rng = np.random.default_rng(20)
    lines = ["HIERARCHY"]

    def add_joint(name: str, order: str, depth: int) -> None:
        tab = "\t" * depth
        lines.extend([f"{tab}{'JOINT' if depth else 'ROOT'} {name}", tab + "{"])
        lines.append(f"{tab}\tOFFSET " + " ".join(f"{x:.6f}" for x in rng.normal(size=3)))
        position = "Xposition Yposition Zposition " if not depth else ""
        lines.append(f"{tab}\tCHANNELS {3 if depth else 6} {position}" + " ".join(f"{a}rotation" for a in order))
        children = [(child, channels) for child, parent, channels in TREE if parent == name]
        for child, channels in children:
            add_joint(child, channels, depth + 1)
        if not children:
            lines.extend([f"{tab}\tEnd Site", tab + "\t{", f"{tab}\t\tOFFSET 0.0 1.0 0.0", tab + "\t}"])
        lines.append(tab + "}")

    add_joint("Hips", "ZXY", 0)
    lines += ["MOTION", "Frames: 12", "Frame Time: 0.041666667"]
    lines += [" ".join(f"{x:.6f}" for x in rng.uniform(-170.0, 170.0, 18)) for _ in range(12)]
    path = HERE / "pybvh_chain.bvh"
    path.write_text("\n".join(lines) + "\n")
    clip = pybvh.read_bvh_file(path, world_up="+y")
    pybvh.write_bvh_file(clip, path)
    clip = pybvh.read_bvh_file(path, world_up="+y")
    convention = (
        "positions (T, J, 3) of joints in file order, pybvh 0.9.0 joint_positions(), root at its position channels"
    )
    np.savez_compressed(HERE / "pybvh_chain.npz", positions=clip.joint_positions(), convention=np.array(convention))


if __name__ == "__main__":
    main()
