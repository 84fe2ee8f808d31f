"""What signs are made of: the words that ship, pseudo-signs, and written signs if a folder of SiGML is named.

python tests/vocabulary.py [FOLDER] [--every N]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.signer import notation, planner
from signsplice.signer.locations import ON_HEAD
from signsplice.signer.phonology import Sign, in_space, on_arm
from signsplice.written import files
from signsplice.written.compiler import compile_sign
from signsplice_workshop.corpora import pseudo

N_PSEUDO = 400
N_TIMED = 150
"""Signs whose length is measured, evenly spaced."""


def place(location: str) -> str:
    """The region of a location."""
    if in_space(location):
        return "space"
    if on_arm(location):
        return "hand and arm"
    return "head" if location.split("/")[0].split(":")[0].removesuffix("-weak") in ON_HEAD else "trunk"


def movements(sign: Sign) -> set[str]:
    """Kinds of movement in a sign."""
    found = set()
    for before, one in zip((None, *sign.segments), sign.segments, strict=False):
        if one.kind != "M":
            continue
        if before is not None and one.path.kind == "straight":
            moved = (one.strong.location, one.strong.shift, one.strong.off) != (
                before.strong.location,
                before.strong.shift,
                before.strong.off,
            )
            found |= {"straight"} if moved else set()
        else:
            found.add(one.path.kind)
        found |= {"within the hand"} if one.local else set()
        found |= {"repeated"} if one.times > 1 or abs(one.path.revolutions) > 1 else set()
        if before is not None and one.strong.shape != before.strong.shape:
            found.add("shape changes")
    return found or {"none"}


def share(signs: Sequence[Sign], what: str, of: str) -> float:
    """The fraction of signs that have something."""
    if of == "hands":
        return float(np.mean([sign.hands == what for sign in signs]))
    if of == "place":
        return float(np.mean([place(sign.segments[0].strong.location) == what for sign in signs]))
    return float(np.mean([what in movements(sign) for sign in signs]))


def seconds(signs: Sequence[Sign]) -> list[float]:
    """Lengths of signs from their first posture to the end of the last, s."""
    chosen = [signs[n] for n in np.linspace(0, len(signs) - 1, min(N_TIMED, len(signs))).astype(int)]
    words = [planner.synthesize_word(sign) for sign in chosen]
    return [(word.events.end - word.events.start) / word.clip.fps for word in words]


def written(folder: Path, every: int) -> list[Sign]:
    """The written signs of a folder that can be compiled."""
    found = []
    for sign in list(files.read(folder).signs.values())[::every]:
        try:
            found.append(compile_sign(sign))
        except InputError:
            continue
    return found


def main() -> None:
    """Print the table."""
    groups = {
        "words that ship": list(notation.everyday().values()),
        "pseudo-signs": [pseudo.draw_sign(n) for n in range(N_PSEUDO)],
    }
    arguments = sys.argv[1:]
    if arguments:
        every = int(arguments[arguments.index("--every") + 1]) if "--every" in arguments else 1
        groups["written signs"] = written(Path(arguments[0]), every)
    print("| | " + " | ".join(f"{name} ({len(signs)})" for name, signs in groups.items()) + " |")
    print("| --- |" + " --- |" * len(groups))
    for of, names in (
        ("hands", ("one", "symmetric", "alternating", "base")),
        ("place", ("head", "trunk", "hand and arm", "space")),
        ("movement", ("straight", "arc", "circle", "zigzag", "within the hand", "shape changes", "repeated", "none")),
    ):
        for name in names:
            cells = " | ".join(f"{100 * share(signs, name, of):.0f} %" for signs in groups.values())
            print(f"| {of}: {name} | {cells} |")
    lengths = [np.percentile(seconds(signs), (5, 50, 95)) for signs in groups.values()]
    print(
        "| length, s: median (5 to 95 %) | " + " | ".join(f"{b:.2f} ({a:.2f} to {c:.2f})" for a, b, c in lengths) + " |"
    )
    shapes = [len({s.strong.shape for sign in signs for s in sign.segments}) for signs in groups.values()]
    print("| different handshapes | " + " | ".join(map(str, shapes)) + " |")


if __name__ == "__main__":
    main()
