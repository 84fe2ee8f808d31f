"""A synthetic signer: body proportions and manner of moving, drawn by seed, and the skeleton that follows from them.

A manner holds the traits in which people differ from plain minimum-jerk motion, beyond tempo and size. Networks can
learn from signing with some traits alone (``synth endless --traits``), which shows the value of each trait.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields

import numpy as np

from signsplice.motion import EndSite, FloatArray, Skeleton
from signsplice.motion.cache import CACHE
from signsplice.signer import hand


def stream(*names: str | int) -> np.random.Generator:
    """A generator (PCG64) seeded by the names alone: equal on every machine and in every order of draws."""
    digest = hashlib.sha256("\x1f".join(map(str, names)).encode("utf-8", "surrogatepass")).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


@dataclass(frozen=True)
class Manner:
    """Traits of a signer's motion. Each is 0 for plain motion, 1 at its usual strength.

    low_pass_frames: standard deviation of the Gaussian by which motion is smoothed in time, frames of 30 a second
    off_frame: how far from a frame stops may fall, 0 on frames to 1 anywhere
    tempo_spread: how much longer holds of words alone are, and how far words differ in tempo
    low_elbows: how low elbows hang, and how steadily and clear of the trunk they move; wrists bend instead
    head_to_hand: how far the head goes to meet a hand at face or chin
    body_motion: how far the trunk turns and leans with the reach of the hands
    hand_difference: how far the hands of a symmetric sign differ in place and time
    pass_difference: how far later passes of a repeated movement are smaller than the first and differ in time
    finger_stagger: how far each finger moves in a time of its own
    undershoot: how far short of their place, and how much lower, hasty movements stay
    hesitation: how often holds, and transitions in sentences made without ``--exact``, take longer
    base_lag: how far a base hand (a weak hand that is touched or acted on) arrives in a time of its own
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
"""Motion with every trait at its usual strength."""
TRAITS = tuple(f.name for f in fields(Manner))


def draw_manner(rng: np.random.Generator) -> Manner:
    """A random manner: a smoothing of 0 to 2.5 frames, every other trait from 0.5 to 1.5 times its usual strength."""
    return Manner(float(rng.uniform(0.0, 2.5)), *rng.uniform(0.5, 1.5, len(TRAITS) - 1).tolist())


STATURE_CM = 170.0
"""Stature of the standard body. Positions and lengths in this folder are given for it; other bodies scale them."""


HANGING = "hanging"
RESTS = (HANGING, "folded", "bent", "low")
"""Rest poses: arms hang; hands lie on one another in front of the belly; forearms are held in front of the waist; hands
meet low in front of the body."""


@dataclass(frozen=True)
class Signer:
    """A signer's body and manner of moving. The defaults are the standard signer.

    name: seed of this signer's random streams
    stature_cm: stature
    arms: length of upper arm and forearm, over the usual one for the stature
    hands: size of the hands, over the usual one for the stature
    shoulders: width of the shoulders, over the usual one for the stature
    left_handed: whether the left hand is the strong one
    tempo: speed, over the usual one
    amplitude: size of movements in space, over the usual one
    arch: how far a reach bows outwards, as a fraction of its length
    elbow_deg: how far the elbows are held out, degrees
    rest_out_cm: how far out from the thighs hanging hands are; other rests are held twice this much higher
    rest_fwd_cm: how far in front of the thighs hanging hands are
    breath_deg, breath_hz: amplitude and frequency of trunk rotation by breathing (12 to 20 breaths a minute)
    sway_cm, sway_hz: of the postural sway of the hips
    tremor_cm, tremor_hz: of the physiological tremor of the hands (8 to 12 Hz, Elble and Koller 1990)
    lag: how much less than usual the fingers lead the wrist half way, as a fraction of the reach; negative: more
    rest: rest pose between signs, one of ``RESTS``
    manner: further traits of motion
    """

    name: str = "standard"
    stature_cm: float = STATURE_CM
    arms: float = 1.0
    hands: float = 1.0
    shoulders: float = 1.0
    left_handed: bool = False
    tempo: float = 1.0
    amplitude: float = 1.0
    arch: float = 0.07
    elbow_deg: float = 0.0
    rest_out_cm: float = 0.0
    rest_fwd_cm: float = 0.0
    breath_deg: float = 0.5
    breath_hz: float = 0.28
    sway_cm: float = 0.35
    sway_hz: float = 0.23
    tremor_cm: float = 0.012
    tremor_hz: float = 9.0
    lag: float = 0.0
    rest: str = HANGING
    manner: Manner = USUAL

    @property
    def scale(self) -> float:
        """Stature over that of the standard body."""
        return self.stature_cm / STATURE_CM


@dataclass(frozen=True)
class HangingElbowSigner(Signer):
    """A signer whose states (``pose``) measure elbow turns from hanging elbows instead of from those that are easiest
    for forearm and wrist (``arms.from_hanging``).
    """


STANDARD = Signer()


def draw_signer(seed: int) -> Signer:
    """The signer of a seed. Statures and proportions are normally distributed (standard deviations after Drillis and
    Contini 1966 and NHANES statures, cut at 2.5 of them); one signer in ten is left-handed (Papadatou-Pastou et al.
    2020).
    """
    rng = stream("signer", seed)

    def normal(mean: float, spread: float) -> float:
        return mean + spread * float(np.clip(rng.standard_normal(), -2.5, 2.5))

    return Signer(
        name=f"signer-{seed}",
        stature_cm=normal(168.0, 9.0),
        arms=normal(1.0, 0.03),
        hands=normal(1.0, 0.04),
        shoulders=normal(1.0, 0.04),
        left_handed=bool(rng.random() < 0.1),
        tempo=float(np.exp(normal(0.0, 0.10))),
        amplitude=float(np.exp(normal(0.0, 0.10))),
        arch=normal(0.07, 0.02),
        elbow_deg=normal(4.0, 6.0),
        rest_out_cm=normal(0.0, 1.5),
        rest_fwd_cm=normal(0.0, 2.0),
        breath_deg=normal(0.5, 0.12),
        breath_hz=normal(0.28, 0.04),
        sway_cm=normal(0.35, 0.1),
        sway_hz=normal(0.23, 0.05),
        tremor_cm=normal(0.012, 0.003),
        tremor_hz=normal(9.0, 0.8),
        lag=normal(0.0, 0.03),
        manner=draw_manner(rng),
    )


# Joint centres of the standard body in the T-pose, cm, facing +Z, left +X; proportions after Drillis and Contini 1966.
_SPINE = (
    ("Spine", "Hips", (0.0, 10.0, -1.0)),
    ("Spine1", "Spine", (0.0, 12.0, -0.5)),
    ("Spine2", "Spine1", (0.0, 13.0, 0.0)),
    ("Neck", "Spine2", (0.0, 16.0, 0.5)),
    ("Head", "Neck", (0.0, 9.0, 2.0)),
    ("HeadTop_End", "Head", (0.0, 18.0, 1.0)),
)
HIPS_CM = 92.0
COLLAR = np.array([5.0, 10.0, 1.0])  # from the chest joint, left
SHOULDER = np.array([13.0, 2.0, -0.5])  # from the collar joint, left
UPPER_ARM = 29.5
"""Length of the upper arm of the standard body, cm."""
FOREARM = 25.5
"""Length of the forearm of the standard body, cm."""
_LEG = (
    ("UpLeg", "Hips", (9.0, -4.0, 0.0)),
    ("Leg", "UpLeg", (0.0, -41.0, 0.5)),
    ("Foot", "Leg", (0.0, -40.0, -1.5)),
    ("ToeBase", "Foot", (1.0, -6.0, 12.0)),
)
_JOINT_SIDES = ("Left", "Right")


def skeleton(signer: Signer = STANDARD) -> Skeleton:
    """A signer's 53 joints with Mixamo's names, depth first, in cm; the rest pose is the T-pose. The cache keeps
    the last 64 skeletons.
    """
    return CACHE.recent(_skeleton, signer, most=64)


def _skeleton(signer: Signer) -> Skeleton:
    scale = signer.scale
    rows: list[tuple[str, str, FloatArray]] = [("Hips", "", np.array([0.0, HIPS_CM, 0.0]) * scale)]
    tips: list[tuple[str, FloatArray]] = []
    rows += [(name, parent, np.array(offset) * scale) for name, parent, offset in _SPINE]
    for side in _JOINT_SIDES:
        mirror = np.array([1.0 if side == "Left" else -1.0, 1.0, 1.0]) * scale
        broad = np.array([signer.shoulders, 1.0, 1.0])
        rows += [
            (f"{side}Shoulder", "Spine2", COLLAR * broad * mirror),
            (f"{side}Arm", f"{side}Shoulder", SHOULDER * broad * mirror),
            (f"{side}ForeArm", f"{side}Arm", np.array([UPPER_ARM * signer.arms, 0.0, 0.0]) * mirror),
            (f"{side}Hand", f"{side}ForeArm", np.array([FOREARM * signer.arms, 0.0, 0.0]) * mirror),
        ]
        flip = np.array([-1.0, 1.0, 1.0]) * mirror * signer.hands  # ``hand`` describes a right hand
        for finger in hand.FINGERS:
            direction = hand.THUMB_DIRECTION if finger == "Thumb" else np.array([-1.0, 0.0, 0.0])
            first, second, last = (length * direction * flip for length in hand.PHALANGES[finger])
            rows += [
                (f"{side}Hand{finger}1", f"{side}Hand", hand.KNUCKLES[finger] * flip),
                (f"{side}Hand{finger}2", f"{side}Hand{finger}1", first),
                (f"{side}Hand{finger}3", f"{side}Hand{finger}2", second),
            ]
            tips.append((f"{side}Hand{finger}3", last))
    for side in _JOINT_SIDES:
        mirror = np.array([1.0 if side == "Left" else -1.0, 1.0, 1.0]) * scale
        rows += [
            (side + name, side + parent if parent != "Hips" else parent, np.array(o) * mirror)
            for name, parent, o in _LEG
        ]
    index = {name: n for n, (name, _, _) in enumerate(rows)}
    return Skeleton(
        names=tuple(f"mixamorig:{name}" for name in index),
        parents=np.array([index.get(parent, -1) for _, parent, _ in rows]),
        offsets=np.array([offset for _, _, offset in rows]),
        end_sites=tuple(EndSite(index[name], offset) for name, offset in tips),
    )


def shoulder(signer: Signer) -> FloatArray:
    """The right shoulder (3,) of the standard body with a signer's width, from the chest joint, arms hanging, cm."""
    return np.asarray((COLLAR + SHOULDER) * np.array([-signer.shoulders, 1.0, 1.0]))


ARM_JOINTS = ("Shoulder", "Arm", "ForeArm", "Hand")
"""Names of an arm's joints without their side, from the chest on."""
JOINTS: dict[str, int] = {name.removeprefix("mixamorig:"): n for n, name in enumerate(skeleton().names)}
"""Joint name, without Mixamo's prefix, -> its index."""
