"""Mutates written signs and makes their motion: ``python attacks/signed.py FOLDER [N] [SEED]``.

A sign of the .sigml files in FOLDER, a row of the constructed HamNoSys of ``tests/synth``, or a sign of the notation
that ships, gets one to three mutations: mostly a value that another of its kind replaces, else one of ``fuzz_written``.
Each is refused in one line, or becomes a sound clip: every number finite, at most 60 s, no joint that turns by 90
degrees in a frame unless a note names the frame, wrists and elbows within their limits. Anything else is a finding, and
the exit status is 1. Prints counts by kind, the processor time, and how many clips have a hand deeper than 5 mm
anywhere.

A written sign whose hand lies deeper than 5 mm is a finding too if no note of its clip says so, and so is one that
takes over 2 s of processor time.

N: with no finding in N inputs, 3 / N of such inputs at most fail (95 % confidence; 30,000: one in 10,000). SEED and the
input's number choose everything about it, so that a finding can be made again alone: ``N`` as ``K:K+1``.
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

DEEP_CM, SLACK_DEG, MAX_S = 0.5, 1.0, 2.0
VALUE = {"SiGML": r'(\w+)="[^"]*"', "notation": r"(\w+)=\S+"}
"""Kind -> regular expression of a value and its name."""
NOTATION = Path(notation.__file__).parent / "words" / "everyday.signs"


def read_sources(folder: Path) -> dict[str, list[str]]:
    """Returns texts by kind: files of SiGML, rows of HamNoSys after their header, blocks of the notation."""
    sigml = [path.read_text(encoding="utf-8", errors="replace") for path in sorted(folder.glob("*.sigml"))]
    header, *rows = (fuzz_written.TESTS / "hamnosys_signs.csv").read_text(encoding="utf-8").splitlines()
    blocks = [block for block in NOTATION.read_text(encoding="utf-8").split("\n\n") if "hands=" in block]
    return {"SiGML": sigml, "HamNoSys": [f"{header}\n{row}\n" for row in rows], "notation": blocks}


def mutate_text(kind: str, text: str, texts: list[str], rng: random.Random) -> str:
    """Returns a text with a value replaced by another of its kind; in one of five cases a mutation of
    ``fuzz_written``.
    """
    if rng.random() < 0.2:
        content = fuzz_written.mutate_signs(text.encode("utf-8", "surrogateescape"), rng)
        return content.decode("utf-8", "surrogateescape")
    if kind == "HamNoSys":
        positions = [k for k, character in enumerate(text) if character in symbols.SYMBOLS]
        if not positions:
            return text
        k = rng.choice(positions)
        family = symbols.SYMBOLS[text[k]][:4]
        alike = [character for character, name in symbols.SYMBOLS.items() if name.startswith(family)]
        return text[:k] + rng.choice(alike) * rng.choice((0, 1, 1, 1, 2)) + text[k + 1 :]
    values = list(re.finditer(VALUE[kind], text))
    if not values:
        return text
    value = rng.choice(values)
    alike = [match[0] for match in re.finditer(VALUE[kind], rng.choice(texts)) if match[1] == value[1]]
    return text[: value.start()] + rng.choice([*alike, *alike, ""]) + text[value.end() :]


def make_clips(kind: str, text: str) -> list[Clip]:
    """Returns the clips of all signs of a text. Raises ``InputError`` if a sign is refused."""
    if kind == "notation":
        return [planner.synthesize_word(sign).clip for sign in notation.parse(text).values()]
    suffix = "sigml" if kind == "SiGML" else "csv"
    return list(signing.clips(text.encode("utf-8", "surrogateescape"), f"case.{suffix}", 3))


def find_fault(clip: Clip) -> str:
    """Returns the fault of a clip; empty if it is sound."""
    quats = clip.local_rotations
    if not (np.isfinite(quats).all() and np.isfinite(clip.root_positions).all()):
        return "not finite"
    if not 2 <= len(clip) <= fuzz_written.MAX_SECONDS * clip.fps:
        return f"{len(clip)} frames"
    step_deg = np.rad2deg(rotation.angle_between(quats[1:], quats[:-1])).max()
    if step_deg > fuzz_written.MAX_STEP_DEG:
        return f"a joint turns by {step_deg:.0f} degrees in a frame"
    twist, bend = 0.5 * FOREARM_LIMIT, float(np.linalg.norm(np.abs(WRIST_LIMITS).max(axis=1)))
    limits = (("ForeArm", ELBOW_LIMIT + twist), ("Hand", bend + twist))
    for side in ("Left", "Right"):
        for name, limit in limits:
            angle = rotation.angle_between(quats[:, JOINTS[side + name]], rotation.IDENTITY).max()
            if angle > limit + np.deg2rad(SLACK_DEG):
                return f"{side}{name} turns by {np.rad2deg(angle):.0f} degrees"
    return ""


def attack(folder: Path, cases: range, seed: int) -> int:
    """Returns the number of findings among these cases; prints each, and the counts."""
    texts, counts, attack_start = read_sources(folder), Counter[str](), time.process_time()
    for n in cases:
        rng = random.Random(f"{seed} {n}")
        kind = rng.choice(list(texts))
        text = rng.choice(texts[kind])
        for _ in range(rng.choice((1, 1, 2, 3))):
            text = mutate_text(kind, text, texts[kind], rng)
        counts[f"{kind}: inputs"] += 1
        finding, start = "", time.process_time()
        try:
            made_clips = make_clips(kind, text)
        except InputError as error:
            counts[f"{kind}: refused"] += 1
            finding = "" if len(str(error).splitlines()) == 1 else f"an error of several lines: {str(error)[:200]!r}"
            made_clips = []
        except Exception as error:  # errors that the program does not handle
            finding, made_clips = f"{type(error).__name__}: {str(error)[:200]}", []
        clip_s = (time.process_time() - start) / max(1, len(made_clips))
        if clip_s > MAX_S:
            finding = finding or f"takes {clip_s:.1f} s"
        for clip in made_clips:
            counts[f"{kind}: clips"] += 1
            fault = find_fault(clip)
            has_warning = bool(fault) and next(signing.jumps(clip), "") != ""
            counts[f"{kind}: {fault.partition(' by ')[0]}, warned of"] += has_warning
            finding = finding or ("" if has_warning else fault)
            depth = 0.0 if fault else float(collision.hand_depths(clip).max())
            counts[f"{kind}: deeper than 5 mm"] += depth > DEEP_CM
            counts[f"{kind}: deeper than 20 mm"] += depth > 4 * DEEP_CM
            if depth > DEEP_CM and kind != "notation" and not any("deep in the body" in note for note in clip.notes):
                finding = finding or f"a hand lies {10.0 * depth:.0f} mm deep and no note says so"
        if finding:
            counts["findings"] += 1
            print(f"case {n} ({kind}): {finding}", flush=True)
        if (n + 1) % 200 == 0 or n + 1 == cases.stop:
            print(f"{n + 1}, {time.process_time() - attack_start:.0f} s: {dict(sorted((+counts).items()))}", flush=True)
    return counts["findings"]


def main() -> None:
    """Reads the arguments and attacks."""
    folder, cases, seed = Path(sys.argv[1]), *(sys.argv[2:] + ["30000", "1"][len(sys.argv) - 2 :])[:2]
    first, _, stop = cases.rpartition(":")
    sys.exit(1 if attack(folder, range(int(first or 0), int(stop)), int(seed)) else 0)


if __name__ == "__main__":
    main()
