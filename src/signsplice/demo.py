"""The demo: splices shipped words into a sentence, with pictures and a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, concatenate
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.render import film
from signsplice.splicing import report
from signsplice.splicing.engine import SpliceOptions, SpliceResult, splice

SENTENCE = ("HELLO", "I", "DEAF", "I", "SIGN", "THANK-YOU")
"""Words that the demo splices, chosen for their different locations and handshapes; not a grammatical sentence."""
_FILES = ("sentence.bvh", "sentence.gif", "sentence.png", "report.json", "avatar.glb")
_SYSTEM = "lptransformer"
"""System of the paper that splices the same words for comparison."""
_ARM = 0.85
"""Ratio of the avatar's arm length to the signer's."""


def run(out: Path, progress: Callable[[int, int], None] | None = None) -> list[str]:
    """Write words, the sentence, its report, a contact sheet, a film, an avatar, and the same words spliced by
    LpTransformer into the folder ``out``. Returns lines that describe them.
    """
    try:
        (out / "words").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be made ({error.strerror})") from error
    with open_shipped_lexicon() as words:
        clips = [words.clip(gloss) for gloss in SENTENCE]
    for clip in clips:
        save(clip, out / "words" / f"{clip.name}.bvh")
    result = splice(clips)
    marks = result.marks
    save(result.clip, out / "sentence.bvh")
    save(_avatar(clips[0]), out / "avatar.glb")
    report.write(report.describe(result), out / "report.json")
    film.write_pictures(result.clip, out / "sentence.png", marks)
    film.write_pictures(result.clip, out / "sentence.gif", marks, progress=progress)
    compared = splice(clips, SpliceOptions(system=_SYSTEM))
    save(compared.clip, out / f"{_SYSTEM}.bvh")
    film.write_pictures(compared.clip, out / f"{_SYSTEM}.gif", compared.marks, progress=progress)
    one_after_another = concatenate(clips)
    return [
        *seam_table(result),
        "",
        *seam_table(compared),
        "",
        f"{' '.join(SENTENCE)}: {result.clip.seconds:.2f} s, "
        f"played one after another {one_after_another.seconds:.2f} s",
        *(f"  {out / name}" for name in (*_FILES, f"{_SYSTEM}.bvh", f"{_SYSTEM}.gif", "words/")),
    ]


def _avatar(signer: Clip) -> Clip:
    """Return one frame of the signer with shorter arms; written as a GLB, it is an avatar with the figure as mesh."""
    offsets = signer.skeleton.offsets.copy()  # (J, 3)
    for joint, name in enumerate(signer.skeleton.names):
        if name.endswith(("Arm", "ForeArm", "Hand")):
            offsets[joint] *= _ARM
    skeleton = replace(signer.skeleton, offsets=offsets)
    at_rest = Face(ARKIT_CHANNELS, np.full((1, len(ARKIT_CHANNELS)), 1e-6))  # a channel of zeros gets no morph target
    return replace(signer[:1], skeleton=skeleton, channels=None, name="avatar", face=at_rest)


def seam_table(result: SpliceResult) -> list[str]:
    """Return a table of the seams as lines."""
    lines = [
        f"cutter {result.cutter}, transition {result.transition}",
        f"{'seam':24} {'leave':>5} {'enter':>5} {'new':>4} {'s':>6} {'jump m/s':>9} {'peak m/s':>9} {'jerk':>5}",
    ]
    for seam in result.seams:
        name = f"{seam.before} -> {seam.after}"
        lines.append(
            f"{name:24} {seam.pre_frame:5d} {seam.post_frame:5d} {seam.n_transition:4d} {seam.seconds:6.3f} "
            f"{seam.velocity_jump:9.3f} {seam.peak_speed_m_s:9.2f} {seam.jerk_ratio:5.2f}"
        )
    return lines
