"""Kinds of signs, and how repeated movements differ, beside figures of real signing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from signsplice.evaluation.hands import strong_side
from signsplice.evaluation.tables import Quantity, percentiles
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.info import rig_info
from signsplice.signer import notation
from signsplice.signer.phonology import ON_BASE, Sign
from signsplice.synth import pseudo
from signsplice.synth.corpus import Pairs

N_PSEUDO = 300
"""Pseudo-signs that are counted: the first ones by seed."""
ASL_LEX = "ASL-LEX 2.0, 2,723 signs"
AIMED = "range aimed at"
"""Source of ranges that no published table stands behind."""
_SHORTEST_PASS_M = 0.015


_KINDS: dict[str, tuple[Callable[[Sign], bool], float]] = {
    "one-handed": (lambda sign: sign.hands == "one", 0.39),
    "symmetric or alternating": (lambda sign: sign.hands in ("symmetric", "alternating"), 0.35),
    "first place at the other hand": (lambda sign: sign.segments[0].strong.location in ON_BASE, 0.25),
    "first place in neutral space": (lambda sign: sign.segments[0].strong.location.startswith("space"), 0.36),
}
"""Kind -> whether a sign is of it, and its share in ASL-LEX 2.0. Space next to or before the face belongs to the face,
as there.
"""


def kinds(signs: Sequence[Sign], whose: str) -> list[Quantity]:
    """Shares of kinds of signs beside those of ASL-LEX 2.0 (Sehyr et al. 2021); whose: text behind the kind's name."""
    return [
        Quantity(f"{kind}, {whose}", "", (float(np.mean([of(sign) for sign in signs])),), (share,), ASL_LEX)
        for kind, (of, share) in _KINDS.items()
    ]


def known_kinds() -> list[Quantity]:
    """Shares of kinds among the words that ship (without letters and digits) and among pseudo-signs."""
    pseudo_signs = [pseudo.sign(seed) for seed in range(N_PSEUDO)]
    return kinds(list(notation.everyday().values()), "words that ship") + kinds(pseudo_signs, "pseudo-signs")


def second_passes(pairs: Pairs) -> list[Quantity]:
    """Size and time of the second pass of a word's last movement over those of the first, words of the first signer.

    Size: the largest distance of the strong wrist, seen from the chest, from where the pass begins. Movements whose
    first pass is smaller than 1.5 cm are left out. Empty where no word has two passes.
    """
    strong = strong_side(pairs)
    sizes, times = [], []
    for k in range(len(pairs.head["words"]) // 2):
        passes = pairs.events(k).passes
        if len(passes) < 2:
            continue
        wrist = _from_chest(pairs.word_clip(k), strong)
        paths = [wrist[begin : end + 1] - wrist[begin] for begin, end in passes[:2]]
        first, second = (float(np.linalg.norm(path, axis=-1).max()) for path in paths)
        if first >= _SHORTEST_PASS_M:
            sizes.append(second / first)
            times.append((passes[1][1] - passes[1][0]) / (passes[0][1] - passes[0][0]))
    if not sizes:
        return []
    return [
        Quantity("second pass over the first, size", "", percentiles(sizes), (0.6, 1.0), AIMED, spread=True),
        Quantity("second pass over the first, time", "", percentiles(times), (0.85, 1.15), AIMED, spread=True),
    ]


def _from_chest(clip: Clip, strong: str) -> FloatArray:
    """Positions (T, 3) of the strong wrist in the axes of the joint that carries the shoulders, m."""
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    chest = int(clip.skeleton.parents[joints[f"{strong}Shoulder"]])
    rotations, positions = kinematics.forward(clip, [chest, joints[f"{strong}Hand"]])
    return (
        np.asarray(np.einsum("tba,tb->ta", rotations[:, 0], positions[:, 1] - positions[:, 0])) * info.sizes.unit.metres
    )


def symmetric_words(pairs: Pairs, signs: Mapping[str, Sign]) -> list[int]:
    """Numbers of the first signer's words whose signs are symmetric."""
    glosses = [row["gloss"] for row in pairs.head["words"]][: len(pairs.head["words"]) // 2]
    return [k for k, gloss in enumerate(glosses) if gloss in signs and signs[gloss].hands == "symmetric"]
