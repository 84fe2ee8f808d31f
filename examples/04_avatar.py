"""Carries a sign to another body: hands keep their places on it, and touch what they touched.

Run: python examples/04_avatar.py [FOLDER [AVATAR]]     (writes FOLDER/avatar.glb, FOLDER/retargeted.glb and .vrma)
AVATAR is your own .vrm or .glb file; without it a small body is made of the signer that ships.
"""

import sys
from dataclasses import replace
from pathlib import Path

import signsplice as ss

CHILD = {"Shoulder": 0.8, "Arm": 0.8, "ForeArm": 0.75, "Hand": 0.75}
"""How long the bones to these joints are, as parts of the signer's."""


def small_avatar(signer: ss.Clip, path: Path) -> None:
    """Write the signer with shorter arms and narrower shoulders, as an avatar with a mesh."""
    skeleton = signer.skeleton
    offsets = skeleton.offsets.copy()  # (J, 3) from each joint's parent; a skeleton's own arrays are read-only
    for part, factor in CHILD.items():
        for side in ("Left", "Right"):
            offsets[skeleton.index[f"mixamorig:{side}{part}"]] *= factor
    ss.save(replace(signer, skeleton=replace(skeleton, offsets=offsets), channels=None), path)


def main(folder: Path, file: Path | None) -> None:
    """Bring a word that ships to an avatar."""
    folder.mkdir(parents=True, exist_ok=True)
    with ss.open_lexicon() as lexicon:
        mother = lexicon.clip("MOTHER")  # the thumb touches the chin
    if file is None:
        file = folder / "avatar.glb"
        small_avatar(mother[:1], file)
    # Reads the bones at rest, and measures head, trunk and arms on the mesh that they carry.
    avatar = ss.read_avatar(file)

    # The same rotations on shorter arms would leave the hand in the air, or put it into the head. Here wrists and
    # elbows are moved until each hand is where it was, seen from the parts of the body near it.
    done = ss.retarget(mother, avatar)
    for one in done.contacts:
        kept = "not measured" if one.is_kept is None else "kept" if one.is_kept else "lost"
        print(f"{one.hand} hand on {one.region}: {one.before_mm} mm apart before, {one.after_mm} mm after: {kept}")
    for line in done.warnings:
        print(f"warning: {line}")
    for name in ("retargeted.glb", "retargeted.vrma"):  # .vrma: only the motion, for any player of VRM avatars
        ss.save(done.clip, folder / name)
        print(f"wrote {folder / name}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples"), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
