"""How the hands of a written sign work together, by all that is written of them."""

from __future__ import annotations

from signsplice.written.tree import Motion, WrittenPosture, WrittenSign


def alternates(motions: tuple[Motion, ...]) -> bool:
    """Whether any of some motions alternates."""
    return any(motion.alternating or alternates(motion.parts) for motion in motions)


def is_two_handed(sign: WrittenSign) -> bool:
    """Whether the weak hand takes part in a sign."""
    postures = [sign.posture, *_targets(sign.motions)]
    arm = any(_at_weak_arm(posture) for posture in postures)
    return sign.hands != "one" or sign.holdover or arm or splits(sign.motions)


def _at_weak_arm(posture: WrittenPosture) -> bool:
    names = ("upperarm", "elbow", "elbowinside", "lowerarm", "wristback", "wristpulse")
    pair = posture.pair is not None and (posture.pair.weak is not None)
    return pair or posture.weak is not None or (posture.place is not None and posture.place.name in names)


def is_symmetric(sign: WrittenSign) -> bool:
    """Whether both hands mirror one another in all that is written."""
    if sign.hands != "mirrored" or sign.holdover or splits(sign.motions):
        return False
    return all(_alike(posture) for posture in (sign.posture, *_targets(sign.motions)))


def _alike(posture: WrittenPosture) -> bool:
    pair = posture.pair
    meets = pair is None or (pair.weak == pair.strong and (pair.place is None or pair.place.contact != "touch"))
    sides = posture.place is None or posture.place.name not in (
        "lowerarm",
        "wristback",
        "elbow",
        "upperarm",
        "wristpulse",
    )
    return posture.weak is None and meets and sides


def _targets(motions: tuple[Motion, ...]) -> list[WrittenPosture]:
    found = []
    for motion in motions:
        found += [motion.target] if motion.target is not None else []
        pair = motion.brushing_pair
        found += [WrittenPosture(pair=pair)] if pair is not None else []
        found += _targets(motion.parts)
    return found


def splits(motions: tuple[Motion, ...]) -> bool:
    """Whether any of some motions is written for each hand."""
    return any(m.kind in ("split", "swap") or m.repeat == "swap" or splits(m.parts) for m in motions)
