"""Sound: joints within their limits, bones of one length, no body in another, no jump, over every pair of a corpus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip
from signsplice.synth import hand, planner, pose, running
from signsplice.synth.corpus import Pairs
from signsplice.synth.phonology import Sign
from signsplice.synth.rng import stream
from signsplice.synth.signer import JOINTS, skeleton

Float = NDArray[np.float64]
Progress = Callable[[int, int], None]

LIMIT_CM = 0.5
"""How deep hands may lie in head, trunk or one another."""
_ROUNDING = np.deg2rad(0.05)


@dataclass(frozen=True)
class CorpusChecks:
    """What was found over ``n_pairs`` pairs: deepest a hand lies in head, trunk or the other hand (cm; in words, in
    transitions) and how many pairs go beyond ``LIMIT_CM``; most over a joint limit (degrees); largest change of bone
    length (cm); largest step of any joint at a seam and within the words (cm a frame), largest change of a wrist's step
    at a seam (cm); pairs whose positions or transitions lie outside the stored frames.
    """

    n_pairs: int
    deepest_word_cm: float
    deepest_new_cm: float
    n_too_deep: int
    over_limit_deg: float
    bone_change_cm: float
    seam_step_cm: float
    word_step_cm: float
    seam_turn: float
    n_misplaced: int


def examine(pairs: Pairs, progress: Progress | None = None) -> CorpusChecks:
    """Look at every word and every transition of a corpus."""
    n_words = len(pairs.head["words"])
    half = n_words // 2
    words = [_PairPose(pairs.word_clip(k)) for k in range(n_words)]
    deepest_new = over = bones = seam_step = seam_turn = 0.0
    too_deep = misplaced = next_first = 0
    for number in range(len(pairs)):
        p, q, pre, post, first, count = pairs.index[number].tolist()
        who = pairs.signers[p // half]
        whole = slice(first, first + count)
        before, after = pairs.word(p, "rotations")[pre], pairs.word(q, "rotations")[post]
        rotations = np.concatenate([before[None], pairs.new["rotations"][whole], after[None]]).astype(np.float64)
        roots = np.concatenate(
            [pairs.word(p, "roots")[pre : pre + 1], pairs.new["roots"][whole], pairs.word(q, "roots")[post : post + 1]]
        ).astype(np.float64)
        look = _PairPose(Clip(skeleton(who), rotations, roots, pairs.head["fps"]))
        deepest = float(look.depth[1:-1].max())
        deepest_new, over = max(deepest_new, deepest), max(over, look.over_limit)
        bones = max(bones, look.bone_change)
        too_deep += max(deepest, float(words[p].depth[: pre + 1].max()), float(words[q].depth[post:].max())) > LIMIT_CM
        seam_step = max(seam_step, look.steps[0], look.steps[-1])
        seam_turn = max(seam_turn, *_rotations(words[p], look, words[q], pre, post))
        whole_index = 2 <= pre < len(words[p].depth) and 0 <= post < len(words[q].depth) - 2 and first == next_first
        misplaced += not whole_index
        next_first = first + count
        if progress is not None and number % 50 == 0:
            progress(number + 1, len(pairs))
    return CorpusChecks(
        n_pairs=len(pairs),
        deepest_word_cm=max(float(w.depth.max()) for w in words),
        deepest_new_cm=deepest_new,
        n_too_deep=too_deep,
        over_limit_deg=float(np.rad2deg(max(over, *(w.over_limit for w in words)))),
        bone_change_cm=max(bones, *(w.bone_change for w in words)),
        seam_step_cm=seam_step,
        word_step_cm=max(float(w.steps.max()) for w in words),
        seam_turn=seam_turn,
        n_misplaced=misplaced,
    )


class _PairPose:
    """A clip's globals and what is looked at in them."""

    def __init__(self, clip: Clip) -> None:
        turns, self.places = kinematics.forward(clip)
        self.depth = collision.hand_penetration(clip.skeleton, turns, self.places)[0]
        self.steps = np.linalg.norm(np.diff(self.places, axis=0), axis=-1).max(axis=-1)
        parents = clip.skeleton.parents[1:]
        lengths = np.linalg.norm(self.places[:, 1:] - self.places[:, parents], axis=-1)
        rest = np.linalg.norm(clip.skeleton.offsets[1:], axis=-1)
        self.bone_change = float(np.abs(lengths - rest).max())
        self.over_limit = over_limit(clip.local_rotations)


def _rotations(p: _PairPose, new: _PairPose, q: _PairPose, pre: int, post: int) -> tuple[float, float]:
    """Change of the wrists' velocity (cm a frame, a frame) at both seams."""
    hands = [JOINTS["RightHand"], JOINTS["LeftHand"]]
    first = np.concatenate([p.places[pre - 1 : pre, hands], new.places[:2, hands]])
    last = np.concatenate([new.places[-2:, hands], q.places[post + 1 : post + 2, hands]])
    one, two = (float(np.linalg.norm(np.diff(x, n=2, axis=0), axis=-1).max()) for x in (first, last))
    return one, two


def over_limit(local_rotations: Float) -> float:
    """Most (radians, 0 where none is) by which elbow, wrist or a finger joint of (T, 53, 4) goes beyond its limits."""
    worst = 0.0
    for side, mirror in (("Right", 1.0), ("Left", np.array([1.0, -1.0, -1.0, 1.0]))):
        fore = local_rotations[:, JOINTS[f"{side}ForeArm"]] * mirror
        wrist = local_rotations[:, JOINTS[f"{side}Hand"]] * mirror
        twist_fore = rotation.twist_angle(fore, [1.0, 0.0, 0.0])
        bend = rotation.log(rotation.multiply(fore, rotation.exp(-twist_fore[:, None] * [1.0, 0.0, 0.0])))
        twist = rotation.twist_angle(wrist, [1.0, 0.0, 0.0])
        swing = rotation.log(rotation.multiply(rotation.exp(-twist[:, None] * [1.0, 0.0, 0.0]), wrist))
        (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
        beyond = [
            np.abs(twist + twist_fore) - pose.FOREARM_LIMIT,
            np.linalg.norm(bend, axis=-1) - pose.ELBOW_LIMIT,
            *(swing[:, 1] - high_side, low_side - swing[:, 1], swing[:, 2] - high_bent, low_bent - swing[:, 2]),
        ]
        first = JOINTS[f"{side}HandIndex1"]
        fingers = local_rotations[:, first : first + 12].reshape(-1, 4, 3, 4) * mirror
        flexion = 2.0 * np.arctan2(fingers[..., 2], fingers[..., 3])
        limits = hand.LIMITS[:16].reshape(4, 4, 2)[:, 1:]
        beyond += [(flexion - limits[..., 1]).ravel(), (limits[..., 0] - flexion).ravel()]
        worst = max([worst, *(float(b.max()) for b in beyond)])
    return float(max(0.0, worst - _ROUNDING))


def n_misplaced(pairs: Pairs, signs: Mapping[str, Sign], n_pairs: int = 400) -> tuple[int, int]:
    """How many of some drawn pairs were planned anew from their signs, and how many then differ from what is stored:
    the sentence of both words, its rotations and roots, in any bit. Pairs of words that ``signs`` has not are passed.
    """
    half = len(pairs.head["words"]) // 2
    known = np.array([row["gloss"] in signs for row in pairs.head["words"]])
    own = np.flatnonzero((pairs.index[:, 0] < half) & known[pairs.index[:, :2]].all(axis=1))
    chosen = stream("signed-anew", len(own)).choice(own, min(n_pairs, len(own)), replace=False)
    words: dict[int, planner.IsolatedWord] = {}
    wrong = 0
    for number in sorted(chosen.tolist()):
        both = pairs.index[number, :2].tolist()
        for k in both:
            if k not in words:
                sign = signs[pairs.head["words"][k]["gloss"]]
                words[k] = planner.isolated(sign, pairs.signers[0], fps=pairs.head["fps"])
        said = running.utter([words[k] for k in both], changes=False).clip
        stored = (pairs.utterance(number, "rotations"), pairs.utterance(number, "roots"))
        anew = (said.local_rotations.astype(np.float32), said.root_positions.astype(np.float32))
        wrong += not all(np.array_equal(a, b) for a, b in zip(stored, anew, strict=True))
    return len(chosen), wrong
