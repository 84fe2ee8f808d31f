"""Compares the handshapes of letters with recorded ones: how far each finger is stretched.

    python workshop/runs/recorded_letters.py FOLDER     # index.csv and files of pose-format 0.2 with MediaPipe's hands

A finger's stretch is the distance from its first joint to its tip over the length of its bones: 1 if straight, about
0.4 in a fist. Recorded letters are the median of the stiller half of the frames in which a hand is seen; their depth
is MediaPipe's estimate. American letters are compared with those of alphabet.signs, Greek ones, which are not written
here, with every handshape that a letter has.
"""

from __future__ import annotations

import csv
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.motion import FloatArray
from signsplice.signer import hand, notation
from signsplice.signer.handshapes import handshape

DIFFERENT = 0.3
"""Difference in stretch from which on a finger counts as different."""
FINGERS = ("thumb", "index", "middle", "ring", "little")


def read_hands(path: Path) -> FloatArray:
    """Returns the landmarks (T, 21, 3) of the hand that is seen most, in frames in which it is seen."""
    content, offset = path.read_bytes(), 0

    def take(form: str) -> tuple[Any, ...]:
        nonlocal offset
        values = struct.unpack_from(f"<{form}", content, offset)
        offset += struct.calcsize(f"<{form}")
        return values

    def text() -> str:
        return str(take(f"{take('H')[0]}s")[0], "utf-8")

    take("fHHH")  # version, width, height, depth
    parts: list[tuple[str, int]] = []
    for _ in range(int(take("H")[0])):
        name, _ = text(), text()
        n_points, n_limbs, n_colours = map(int, take("HHH"))
        for _ in range(n_points):
            text()
        take("HH" * n_limbs + "HHH" * n_colours)
        parts.append((name, n_points))
    _, n_frames, n_people = (int(value) for value in take("fIH"))
    shape = n_frames, n_people, sum(n for _, n in parts)
    points = np.frombuffer(content, "<f4", 3 * int(np.prod(shape)), offset).reshape(*shape, 3)[:, 0]
    seen = np.frombuffer(content, "<f4", int(np.prod(shape)), offset + points.nbytes * n_people).reshape(shape)[:, 0]
    starts = np.cumsum([0, *(n for _, n in parts)])
    hands = [slice(starts[n], starts[n + 1]) for n, (name, _) in enumerate(parts) if "HAND" in name]
    best = max(hands, key=lambda part: float(seen[:, part].mean()))
    return np.asarray(points[seen[:, best].min(axis=1) > 0, best], float)


def stretch(chains: FloatArray) -> FloatArray:
    """Returns how far fingers (..., 5, 4, 3), from first joint to tip, are stretched (..., 5)."""
    bones = np.linalg.norm(np.diff(chains, axis=-2), axis=-1).sum(axis=-1)
    return np.asarray(np.linalg.norm(chains[..., -1, :] - chains[..., 0, :], axis=-1) / bones)


def recorded_stretch(path: Path) -> FloatArray:
    """Returns the stretch (5,) of the fingers of a recorded letter."""
    points = read_hands(path)
    speed = np.linalg.norm(np.gradient(points[:, [0, 8, 20]], axis=0), axis=-1).max(axis=1)
    still = points[speed <= np.median(speed)]
    return np.asarray(np.median(stretch(still[:, 1:].reshape(-1, 5, 4, 3)), axis=0))


def written_stretch(shape: str) -> FloatArray:
    """Returns the stretch (5,) of the fingers of a handshape."""
    points = hand.points(handshape(shape).angles)
    return stretch(np.concatenate([points[:15].reshape(5, 3, 3), points[15:, None]], axis=1))


def main() -> None:
    """Prints the letters that differ."""
    folder = Path(sys.argv[1])
    shapes = {gloss[3:]: sign.segments[0].strong.shape for gloss, sign in notation.alphabet().items()}
    with (folder / "index.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["signed_language"] in ("ase", "gss")]
    written = {letter: written_stretch(shape) for letter, shape in shapes.items() if letter.isalpha()}
    nearest, all_errors = [], []
    for row in rows:
        letter, recorded = row["glosses"], recorded_stretch(folder / row["path"])
        if row["signed_language"] == "ase":
            error = written[letter] - recorded
            all_errors.append(error)
            far = np.flatnonzero(abs(error) > DIFFERENT)
            differing = [f"{FINGERS[n]} {written[letter][n]:.2f}/{recorded[n]:.2f}" for n in far]
            print(letter, "differs, ours/recorded: " + ", ".join(differing) if differing else "agrees")
        else:
            errors = {name: float(abs(value - recorded).max()) for name, value in written.items()}
            best = min(errors, key=lambda name: errors[name])
            nearest.append((letter, best, errors[best]))
    fractions = np.mean(np.abs(all_errors) <= DIFFERENT, axis=0)
    shares = dict(zip(FINGERS, fractions.round(2).tolist(), strict=True))
    print(f"fingers that agree: {shares}, median difference {np.median(np.abs(all_errors)):.2f}")
    print("Greek:", ", ".join(f"{letter} {best} {error:.2f}" for letter, best, error in nearest))
    print(f"{sum(error <= DIFFERENT for *_, error in nearest)} of {len(nearest)} Greek letters have an American shape")


if __name__ == "__main__":
    main()
