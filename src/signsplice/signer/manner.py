"""How a signer moves, beyond tempo and size: the traits in which people differ from plain minimum-jerk motion.

Every trait is a number, 0 where the motion is plain. Signers draw theirs by seed; networks can learn from signing with
some traits alone (``only``), which shows what each one is worth.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from signsplice.errors import InputError


@dataclass(frozen=True)
class Manner:
    """Traits of a signer's motion. Each is 0 for plain motion; where no unit is named, 1 is usual.

    low_pass_frames: standard deviation of the Gaussian by which motion is smoothed in time, frames of 30 a second
    off_frame: how far from a frame stops may fall, 0 on frames to 1 anywhere
    tempo_spread: how much longer holds of words alone are, and how far words differ in tempo
    low_elbows: how low elbows hang, the wrists bending instead; they then move steadily and clear of the trunk too
    head_to_hand: how far the head goes to meet a hand at face or chin
    body_motion: how far the trunk turns and leans with the reach of the hands
    hand_difference: how far the hands of a symmetric sign differ in place and time
    pass_difference: how far later passes of a repeated movement are smaller than the first and differ in time
    finger_stagger: how far each finger moves in a time of its own
    undershoot: how far short of their place, and how much lower, hasty movements stay
    hesitation: how often holds, and transitions in sentences with changes, take longer
    base_lag: how far a base hand arrives in a time of its own
    """

    low_pass_frames: float = 0.0
    off_frame: float = 0.0
    tempo_spread: float = 0.0
    low_elbows: float = 0.0
    head_to_hand: float = 0.0
    body_motion: float = 0.0
    hand_difference: float = 0.0
    pass_difference: float = 0.0
    finger_stagger: float = 0.0
    undershoot: float = 0.0
    hesitation: float = 0.0
    base_lag: float = 0.0


PLAIN = Manner()
"""Motion without any trait."""
USUAL = Manner(*[1.0] * len(fields(Manner)))
"""Motion with every trait as strong as is usual."""
TRAITS = tuple(f.name for f in fields(Manner))


def draw_manner(rng: np.random.Generator) -> Manner:
    """A manner drawn at random: a smoothing of 0 to 2.5 frames, and every other trait from half to one and a half of
    what is usual.
    """
    return Manner(float(rng.uniform(0.0, 2.5)), *rng.uniform(0.5, 1.5, len(TRAITS) - 1).tolist())


def only(manner: Manner, traits: tuple[str, ...]) -> Manner:
    """A manner with some of its traits, the others 0. Raises ``InputError`` for an unknown name."""
    for name in traits:
        if name not in TRAITS:
            raise InputError(f"no trait {name!r}, expected some of {', '.join(TRAITS)}")
    return Manner(**{name: getattr(manner, name) for name in traits})
