"""Mutated written signs through the whole way to motion: ``python attacks/signed.py FOLDER [N] [SEED]``.

A sign of the .sigml files in FOLDER, a row of the constructed HamNoSys of ``tests/synth``, or a sign of the notation
that ships, with one to three mutations: mostly a value that another of its kind replaces, else what ``fuzz_written``
does. Each is refused in one line, or becomes a clip that is sound: every number finite, at most 60 s, no joint that
turns by 90 degrees in a frame unless a note names the frame, wrists and elbows within their limits. Anything else is
a finding, and the exit status is 1. Printed: counts by kind, the processor time, and how many clips have a hand deeper
than 5 mm anywhere.

A written sign whose hand lies deeper than 5 mm is a finding too where no note of its clip says so, and so is one that
takes over 2 s of processor time.

N: with no finding in N inputs, 3 / N of such inputs at most fail (95 % confidence; 30,000: one in 10,000). SEED and the
input's number choose everything about it, so that a finding is made again alone: ``N`` as ``K:K+1``.
"""

from __future__ import annotations

import random
import re
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

import fuzz_written
from signsplice.body import collision
from signsplice.errors import InputError
from signsplice.motion import Clip, rotation
from signsplice.signer import notation, planner
from signsplice.signer.pose import ELBOW_LIMIT, FOREARM_LIMIT, WRIST_LIMITS
from signsplice.signer.signer import JOINTS
from signsplice.written import signing, symbols

DEEP_CM, SLACK_DEG, MOST_S = 0.5, 1.0, 2.0
VALUE = {"SiGML": r'(\w+)="[^"]*"', "notation": r"(\w+)=\S+"}
"""A value and its name."""
NOTATION = Path(notation.__file__).parent / "words" / "everyday.signs"


def sources(folder: Path) -> dict[str, list[str]]:
    """Texts by kind: files of SiGML, rows of HamNoSys after their header, blocks of the notation."""
    sigml = [path.read_text(encoding="utf-8", errors="replace") for path in sorted(folder.glob("*.sigml"))]
    header, *rows = (fuzz_written.TESTS / "hamnosys_signs.csv").read_text(encoding="utf-8").splitlines()
    blocks = [block for block in NOTATION.read_text(encoding="utf-8").split("\n\n") if "hands=" in block]
    return {"SiGML": sigml, "HamNoSys": [f"{header}\n{row}\n" for row in rows], "notation": blocks}


def mutated(kind: str, text: str, others: list[str], rng: random.Random) -> str:
    """A text in which a value is another one of its kind; in one of five cases what ``fuzz_written`` makes of it."""
    if rng.random() < 0.2:
        content = fuzz_written.mutated(text.encode("utf-8", "surrogateescape"), rng)
        return content.decode("utf-8", "surrogateescape")
    if kind == "HamNoSys":
        at = [k for k, character in enumerate(text) if character in symbols.SYMBOLS]
        if not at:
            return text
        k = rng.choice(at)
        family = symbols.SYMBOLS[text[k]][:4]
        alike = [character for character, name in symbols.SYMBOLS.items() if name.startswith(family)]
        return text[:k] + rng.choice(alike) * rng.choice((0, 1, 1, 1, 2)) + text[k + 1 :]
    values = list(re.finditer(VALUE[kind], text))
    if not values:
        return text
    one = rng.choice(values)
    alike = [other[0] for other in re.finditer(VALUE[kind], rng.choice(others)) if other[1] == one[1]]
    return text[: one.start()] + rng.choice([*alike, *alike, ""]) + text[one.end() :]


def clips(kind: str, text: str) -> list[Clip]:
    """The clips of all signs of a text. Raises ``InputError`` for what is refused."""
    if kind == "notation":
        return [planner.synthesize_word(sign).clip for sign in notation.parse(text).values()]
    suffix = "sigml" if kind == "SiGML" else "csv"
    return list(signing.clips(text.encode("utf-8", "surrogateescape"), f"case.{suffix}", 3))


def unsound(clip: Clip) -> str:
    """What is wrong with a clip; empty where it is sound."""
    quats = clip.local_rotations
    if not (np.isfinite(quats).all() and np.isfinite(clip.root_positions).all()):
        return "not finite"
    if not 2 <= len(clip) <= fuzz_written.MOST_SECONDS * clip.fps:
        return f"{len(clip)} frames"
    step_deg = np.rad2deg(rotation.angle_between(quats[1:], quats[:-1])).max()
    if step_deg > fuzz_written.MOST_STEP_DEG:
        return f"a joint turns by {step_deg:.0f} degrees in a frame"
    twist, bent = 0.5 * FOREARM_LIMIT, float(np.linalg.norm(np.abs(WRIST_LIMITS).max(axis=1)))
    limits = (("ForeArm", ELBOW_LIMIT + twist), ("Hand", bent + twist))
    for side in ("Left", "Right"):
        for name, most in limits:
            angle = rotation.angle_between(quats[:, JOINTS[side + name]], rotation.IDENTITY).max()
            if angle > most + np.deg2rad(SLACK_DEG):
                return f"{side}{name} turns by {np.rad2deg(angle):.0f} degrees"
    return ""


def attack(folder: Path, cases: range, seed: int) -> int:
    """The number of findings among these cases; prints each, and the counts."""
    texts, count, begin = sources(folder), Counter[str](), time.process_time()
    for n in cases:
        rng = random.Random(f"{seed} {n}")
        kind = rng.choice(list(texts))
        text = rng.choice(texts[kind])
        for _ in range(rng.choice((1, 1, 2, 3))):
            text = mutated(kind, text, texts[kind], rng)
        count[f"{kind}: inputs"] += 1
        finding, start = "", time.process_time()
        try:
            made = clips(kind, text)
        except InputError as error:
            count[f"{kind}: refused"] += 1
            finding = "" if len(str(error).splitlines()) == 1 else f"an error of several lines: {str(error)[:200]!r}"
            made = []
        except Exception as error:  # what the program did not foresee
            finding, made = f"{type(error).__name__}: {str(error)[:200]}", []
        took_s = (time.process_time() - start) / max(1, len(made))
        if took_s > MOST_S:
            finding = finding or f"takes {took_s:.1f} s"
        for clip in made:
            count[f"{kind}: clips"] += 1
            wrong = unsound(clip)
            warned = bool(wrong) and next(signing.jumps(clip), "") != ""
            count[f"{kind}: {wrong.partition(' by ')[0]}, warned of"] += warned
            finding = finding or ("" if warned else wrong)
            deep = 0.0 if wrong else float(collision.hand_depths(clip).max())
            count[f"{kind}: deeper than 5 mm"] += deep > DEEP_CM
            count[f"{kind}: deeper than 20 mm"] += deep > 4 * DEEP_CM
            if deep > DEEP_CM and kind != "notation" and not any("deep in the body" in note for note in clip.notes):
                finding = finding or f"a hand lies {10.0 * deep:.0f} mm deep and no note says so"
        if finding:
            count["findings"] += 1
            print(f"case {n} ({kind}): {finding}", flush=True)
        if (n + 1) % 200 == 0 or n + 1 == cases.stop:
            print(f"{n + 1}, {time.process_time() - begin:.0f} s: {dict(sorted((+count).items()))}", flush=True)
    return count["findings"]


def main() -> None:
    """Read the arguments and attack."""
    folder, cases, seed = Path(sys.argv[1]), *(sys.argv[2:] + ["30000", "1"][len(sys.argv) - 2 :])[:2]
    first, _, stop = cases.rpartition(":")
    sys.exit(1 if attack(folder, range(int(first or 0), int(stop)), int(seed)) else 0)


if __name__ == "__main__":
    main()
