"""Checks a corpus: joint limits, bone lengths, collisions, steps at the seams, and pairs planned anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from signsplice.body import collision
from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.roles import SIDES
from signsplice.signer import hand, planner, pose
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import JOINTS, stream
from signsplice_workshop.corpora import sentences
from signsplice_workshop.corpora.pairs import VERSION, Pairs
from signsplice_workshop.measure.collisions import hand_penetration
from signsplice_workshop.measure.measures import Progress

LIMIT_CM = 0.5
"""Greatest depth that a pair may have of a hand in head, trunk, the other arm or its hand, or of a forearm in the other
arm.
"""
_ROUNDING = np.deg2rad(0.05)
"""Angle beyond a limit that counts as rounding, radians."""
_WRISTS = [JOINTS["RightHand"], JOINTS["LeftHand"]]


@dataclass(frozen=True)
class CorpusChecks:
    """The worst values over all pairs.

    n_pairs: number of pairs examined.
    deepest_word_cm: greatest depth of a hand in head, trunk, the other arm or its hand, or of a forearm in the other
        arm, in the words.
    deepest_transition_cm: the same in the transitions.
    forearm_word_cm, forearm_transition_cm: greatest depth of a forearm in the trunk, in words and in transitions.
    n_too_deep: number of pairs with such a depth over ``LIMIT_CM`` in their kept frames or transition.
    over_limit_deg: largest angle by which a joint is beyond its limits.
    bone_change_cm: largest change of a bone's length.
    transition_step_cm: largest step of a joint from one frame to the next, in transitions and across their seams.
    word_step_cm: the same within the words.
    seam_wrist_change_cm: largest change of a wrist's step from one frame to the next at a seam.
    n_misplaced: number of pairs that are cut within two frames of the first word's start or the second one's end, or
        whose transition is not stored right after the one before.
    """

    n_pairs: int
    deepest_word_cm: float
    deepest_transition_cm: float
    forearm_word_cm: float
    forearm_transition_cm: float
    n_too_deep: int
    over_limit_deg: float
    bone_change_cm: float
    transition_step_cm: float
    word_step_cm: float
    seam_wrist_change_cm: float
    n_misplaced: int


def examine(pairs: Pairs, progress: Progress | None = None) -> CorpusChecks:
    """Checks every word and every transition of a corpus and returns the worst values."""
    words = [_PosedClip(pairs.word_clip(k)) for k in range(len(pairs.head["words"]))]
    n_misplaced = next_first = 0
    rows = []
    for number in range(len(pairs)):
        p, q, pre, post, first, count = pairs.index[number].tolist()
        # The transition with one kept frame on either side.
        seam = _PosedClip(pairs.clip(number)[pre : pre + count + 2])
        deepest = float(seam.depth[1:-1].max())
        rows.append(
            (
                deepest,
                max(deepest, float(words[p].depth[: pre + 1].max()), float(words[q].depth[post:].max())),
                seam.over_limit,
                seam.bone_change,
                float(seam.steps.max()),
                float(seam.forearm[1:-1].max()),
                _wrist_change(words[p], seam, words[q], pre, post),
            )
        )
        inside = 2 <= pre < len(words[p].depth) and 0 <= post < len(words[q].depth) - 2 and first == next_first
        n_misplaced += not inside
        next_first = first + count
        if progress is not None and number % 50 == 0:
            progress(number + 1, len(pairs))
    values = np.array(rows)  # (P, 7)
    deepest, _, over_limit_rad, bone_change, step, forearm, wrist_change = values.max(axis=0).tolist()
    return CorpusChecks(
        n_pairs=len(pairs),
        deepest_word_cm=max(float(word.depth.max()) for word in words),
        deepest_transition_cm=deepest,
        forearm_word_cm=max(float(word.forearm.max()) for word in words),
        forearm_transition_cm=forearm,
        n_too_deep=int((values[:, 1] > LIMIT_CM).sum()),
        over_limit_deg=float(np.rad2deg(max(over_limit_rad, *(word.over_limit for word in words)))),
        bone_change_cm=max(bone_change, *(word.bone_change for word in words)),
        transition_step_cm=step,
        word_step_cm=max(float(word.steps.max()) for word in words),
        seam_wrist_change_cm=wrist_change,
        n_misplaced=n_misplaced,
    )


class _PosedClip:
    """Values of one clip that are checked.

    positions: (T, J, 3) global joint positions, cm.
    depth: (T, 2) depth of the left and the right hand in the body, or of its forearm in the other arm if that is
        deeper, cm; negative: the distance.
    forearm: (T,) depth of the deeper forearm in the trunk, cm.
    steps: (T - 1,) largest step of a joint between two frames, cm.
    bone_change: largest change of a bone's length, cm.
    over_limit: see ``over_limit``, radians.
    """

    def __init__(self, clip: Clip) -> None:
        rotations, self.positions = kinematics.forward(clip)
        self.depth = hand_penetration(clip.skeleton, rotations, self.positions, forearms=True)[0]
        self.forearm = collision.forearm_penetration(clip.skeleton, rotations, self.positions).max(axis=1)
        self.steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=-1).max(axis=-1)
        parents = clip.skeleton.parents[1:]
        lengths = np.linalg.norm(self.positions[:, 1:] - self.positions[:, parents], axis=-1)
        rest = np.linalg.norm(clip.skeleton.offsets[1:], axis=-1)
        self.bone_change = float(np.abs(lengths - rest).max())
        self.over_limit = over_limit(clip.local_rotations)


def _wrist_change(p: _PosedClip, seam: _PosedClip, q: _PosedClip, pre: int, post: int) -> float:
    """Returns the largest change of the wrists' step (cm a frame, from one frame to the next) at both seams."""
    leaving = np.concatenate([p.positions[pre - 1 : pre, _WRISTS], seam.positions[:2, _WRISTS]])  # (3, 2, 3)
    entering = np.concatenate([seam.positions[-2:, _WRISTS], q.positions[post + 1 : post + 2, _WRISTS]])
    return max(
        float(np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1).max()) for positions in (leaving, entering)
    )


def over_limit(local_rotations: FloatArray) -> float:
    """Returns the largest angle (radians) by which an elbow, wrist or finger joint is beyond its limits, 0 if none is.

    local_rotations: (T, 53, 4), joints of the synthetic signer.
    """
    worst = 0.0
    for side, mirror in (("Right", 1.0), ("Left", np.array([1.0, -1.0, -1.0, 1.0]))):
        forearm = local_rotations[:, JOINTS[f"{side}ForeArm"]] * mirror
        wrist = local_rotations[:, JOINTS[f"{side}Hand"]] * mirror
        forearm_twist = rotation.twist_angle(forearm, [1.0, 0.0, 0.0])
        bend = rotation.log(rotation.multiply(forearm, rotation.exp(-forearm_twist[:, None] * [1.0, 0.0, 0.0])))
        twist = rotation.twist_angle(wrist, [1.0, 0.0, 0.0])
        swing = rotation.log(rotation.multiply(rotation.exp(-twist[:, None] * [1.0, 0.0, 0.0]), wrist))
        (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
        excesses = [
            np.abs(twist + forearm_twist) - pose.FOREARM_LIMIT,
            np.linalg.norm(bend, axis=-1) - pose.ELBOW_LIMIT,
            *(swing[:, 1] - high_side, low_side - swing[:, 1], swing[:, 2] - high_bent, low_bent - swing[:, 2]),
        ]
        first = JOINTS[f"{side}HandIndex1"]
        fingers = local_rotations[:, first : first + 12].reshape(-1, 4, 3, 4) * mirror  # (T, finger, joint, 4)
        flexion = 2.0 * np.arctan2(fingers[..., 2], fingers[..., 3])
        limits = hand.LIMITS[:16].reshape(4, 4, 2)[:, 1:]
        excesses += [(flexion - limits[..., 1]).ravel(), (limits[..., 0] - flexion).ravel()]
        worst = max([worst, *(float(excess.max()) for excess in excesses)])
    return float(max(0.0, worst - _ROUNDING))


def check_version(pairs: Pairs) -> None:
    """Raises ``InputError`` for a corpus of another version than ``pairs.VERSION``."""
    if pairs.version != VERSION:
        raise InputError(
            f"{pairs.folder}: is a corpus of version {pairs.version}, which an earlier commit makes "
            "(workshop/docs/corpus.md); only there can it be planned anew"
        )


def replan(pairs: Pairs, signs: Mapping[str, Sign], n_pairs: int = 400) -> tuple[int, int]:
    """Returns the number of drawn pairs of the first signer planned anew from their signs, and the number that differ.

    A pair differs if any bit of its utterance's rotations or roots is not the stored one. Pairs with a word that
    ``signs`` lacks are left out. Raises the error of ``check_version``.
    """
    check_version(pairs)
    words = pairs.head["words"]
    has_sign = np.array([row["gloss"] in signs for row in words])
    candidates = np.flatnonzero((pairs.index[:, 0] < len(words) // 2) & has_sign[pairs.index[:, :2]].all(axis=1))
    chosen = stream("signed-anew", len(candidates)).choice(candidates, min(n_pairs, len(candidates)), replace=False)
    planned: dict[int, planner.IsolatedWord] = {}
    n_different = 0
    for number in sorted(chosen.tolist()):
        word_numbers = pairs.index[number, :2].tolist()
        for k in word_numbers:
            if k not in planned:
                planned[k] = planner.synthesize_word(signs[words[k]["gloss"]], pairs.signers[0], fps=pairs.head["fps"])
        clip = sentences.utter([planned[k] for k in word_numbers], changes=False, partner=pairs.by_partner).clip
        stored = (pairs.utterance(number, "rotations"), pairs.utterance(number, "roots"))
        replanned = (clip.local_rotations.astype(np.float32), clip.root_positions.astype(np.float32))
        n_different += not all(np.array_equal(a, b) for a, b in zip(stored, replanned, strict=True))
    return len(chosen), n_different


TOUCH_CM = 0.5
"""Largest skin distance of a hand that is seen to touch."""
_MIRRORED = ("symmetric", "alternating")


@dataclass(frozen=True)
class TouchAgreement:
    """Numbers of first and last postures of words, by flags of their events and by measured distances.

    n_postures: postures compared.
    n_touching: postures that are seen to touch.
    n_missed: postures that are seen to touch, but not flagged.
    n_false: postures that are flagged, but not seen to touch.
    """

    n_postures: int
    n_touching: int
    n_missed: int
    n_false: int


def score_touches(pairs: Pairs) -> TouchAgreement:
    """Returns the agreement of flagged and seen touches in all words of a corpus. Distances are measured anew, on the
    stored rotations, with the capsules that tell collisions. Version 1 does not say which hands a sign has; there
    the strong hand alone counts.
    """
    flags, distances = [], []
    for k, row in enumerate(pairs.head["words"]):
        events = pairs.events(k)
        signer = pairs.signers[0 if k < len(pairs.head["words"]) // 2 else 1]
        sides = SIDES if row.get("hands") in _MIRRORED else ("left" if signer.left_handed else "right",)
        flags += [events.touches_first, events.touches_last]
        distances += [skin_distance(pairs.word_clip(k), frame, sides) for frame in (events.start, events.end)]
    flagged, seen = np.array(flags, bool), np.array(distances) <= TOUCH_CM
    return TouchAgreement(
        len(seen), int(seen.sum()), n_missed=int((seen & ~flagged).sum()), n_false=int((flagged & ~seen).sum())
    )


def skin_distance(clip: Clip, frame: int, sides: tuple[str, ...]) -> float:
    """Returns the least distance, clip units, from the skin of the hands of ``sides`` to head, neck, trunk, other hand
    and other arm.
    """
    body = body_capsules(clip.skeleton)
    starts, ends = capsule_ends(body, *kinematics.forward(clip[frame : frame + 1]))
    return -max(
        float(collision.overlap(starts, ends, body.radii, *_select_capsules(body, side))[0].max()) for side in sides
    )


def _select_capsules(body: BodyCapsules, side: str) -> tuple[list[int], list[int]]:
    """Returns the capsules of a hand and the capsules that it can meet."""
    groups = body.groups
    hand_capsules, opposite_capsules = (groups.left, (*groups.right, *groups.right_arm))
    if side == "right":
        hand_capsules, opposite_capsules = (groups.right, (*groups.left, *groups.left_arm))
    return list(hand_capsules), [*groups.head, *groups.trunk, *opposite_capsules]
