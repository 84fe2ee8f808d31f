"""How the words that ship move, measured on the signer's clips: arms in the way, steps of elbows, movement and holds,
wrists, touches that are written, head.

    python tests/word_measures.py [--seams 300] [--words GLOSS ...] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import signsplice as ss
from signing import SIGNS
from signsplice.body import collision
from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.roles import SIDES
from signsplice.signer import planner, pose
from signsplice.signer.phonology import IN_SPACE, Segment
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, STANDARD
from signsplice_workshop.corpora import sentences
from signsplice_workshop.measure.collisions import hand_penetration

MOVING_CM_S = 10.0
"""A frame moves where a wrist or a fingertip is faster from the chest than the first."""
_PART_KEYS = {
    "thumb": ("Thumb",),
    "index": ("Index",),
    "index-side": ("Index",),
    "middle": ("Middle",),
    "ring": ("Ring",),
    "pinky": ("Little",),
    "pinky-side": ("Little",),
    "tips": ("Index", "Middle"),
    "two-fingers": ("Index", "Middle"),
    "pinch": ("Index", "Thumb"),
    "fingertips": ("Index", "Middle", "Ring", "Little"),
    "middles": ("Index", "Middle", "Ring", "Little"),
}


def rows(body: BodyCapsules, side: str, *parts: str) -> list[int]:
    """Capsules of some parts of one side."""
    return [n for n, part in enumerate(body.parts) if body.sides[n] == side and part in parts]


def arm_in_arm(body: BodyCapsules, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Depth (T,) of a hand or an arm in the other arm, cm."""
    pairs = []
    for one, two in (SIDES, SIDES[::-1]):
        hand = list(body.groups.left if one == "left" else body.groups.right)
        pairs.append(([*hand, *rows(body, one, "cuff", "sleeve")], rows(body, two, "cuff", "sleeve")))
    return np.asarray(
        np.max([collision.overlap(starts, ends, body.radii, *pair)[0].max(axis=(1, 2)) for pair in pairs], axis=0)
    )


def finger_in_thumb(body: BodyCapsules, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Depth (T,) of a finger in the last two bones of its own hand's thumb, cm."""
    deepest = []
    for side in SIDES:
        fingers = [
            n
            for n, key in enumerate(body.keys)
            if key.startswith(side)
            and key.removeprefix(side).startswith(("Index", "Middle", "Ring", "Little"))
            and not key.endswith("Palm")
        ]
        thumb = [n for n, key in enumerate(body.keys) if key in (f"{side}ThumbProximal", f"{side}ThumbDistal")]
        deepest.append(collision.overlap(starts, ends, body.radii, fingers, thumb)[0].max(axis=(1, 2)))
    return np.asarray(np.max(deepest, axis=0))


def elbow_steps(clip: Clip) -> FloatArray:
    """Steps (T - 1,) of the faster elbow from frame to frame, cm."""
    positions = kinematics.forward(clip, [JOINTS["LeftForeArm"], JOINTS["RightForeArm"]])[1]
    return np.asarray(np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(axis=-1))


def swivel_steps(clip: Clip) -> FloatArray:
    """By how far (T - 1,) the faster elbow turns about the line from shoulder to wrist from frame to frame, cm."""
    steps = []
    for side in ("Left", "Right"):
        rotations, positions = kinematics.forward(
            clip, [JOINTS["Spine2"], *(JOINTS[side + name] for name in ("Arm", "ForeArm", "Hand"))]
        )
        s, e, w = np.einsum("tba,tkb->kta", rotations[:, 0], positions[:, 1:] - positions[:, :1])
        axis = (w - s) / np.linalg.norm(w - s, axis=-1, keepdims=True)
        out = e - s - ((e - s) * axis).sum(-1, keepdims=True) * axis
        carried = rotation.rotate(rotation.between_vectors(axis[:-1], axis[1:]), out[:-1])
        sine, cosine = (np.cross(carried, out[1:]) * axis[1:]).sum(-1), (carried * out[1:]).sum(-1)
        radius = np.linalg.norm(out, axis=-1)
        steps.append(np.abs(np.arctan2(sine, cosine)) * np.minimum(radius[:-1], radius[1:]))
    return np.asarray(np.max(steps, axis=0))


def wrist_bend(positions: FloatArray) -> FloatArray:
    """Angles (T, 2) between forearm and hand, degrees."""
    bends = []
    for side in ("Left", "Right"):
        elbow, wrist, knuckle = (positions[:, JOINTS[side + name]] for name in ("ForeArm", "Hand", "HandMiddle1"))
        a, b = wrist - elbow, knuckle - wrist
        cosine = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
        bends.append(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.stack(bends, axis=-1)


def moving(one: IsolatedWord) -> FloatArray:
    """Whether the hands move at each frame step of the sign (n,): a wrist or a fingertip, from the chest."""
    rotations, positions = kinematics.forward(one.clip)
    tips = [
        JOINTS[f"{side}Hand{f}3"] for side in ("Left", "Right") for f in ("Thumb", "Index", "Middle", "Ring", "Pinky")
    ]
    joints = [JOINTS["LeftHand"], JOINTS["RightHand"], *tips]
    chest = JOINTS["Spine2"]
    seen = np.einsum("tba,tkb->tka", rotations[:, chest], positions[:, joints] - positions[:, chest, None])
    speed = np.linalg.norm(np.diff(seen, axis=0), axis=-1).max(axis=-1) * one.clip.fps
    return np.asarray(speed[one.events.start : one.events.end] > MOVING_CM_S)


def missed_touches(one: IsolatedWord) -> float:
    """How far the part that is written to touch is from what it touches in the worst posture, cm; 0 without one."""
    body = body_capsules(one.clip.skeleton)
    worst = 0.0
    for n, timed in enumerate(one.segments):
        if timed.segment.kind == "H" and n and timed.segment.strong == one.sign.segments[n - 1].strong:
            continue
        frame = timed.passes[0][1] if timed.passes else timed.begin
        worst = max(worst, _missed(one, timed.segment, frame, body))
    return worst


def _missed(one: IsolatedWord, segment: Segment, frame: int, body: BodyCapsules) -> float:
    posture = segment.strong
    if posture.location in IN_SPACE or posture.off >= 1.0 or one.sign.hands == "alternating":
        return 0.0
    starts, ends = capsule_ends(body, *kinematics.forward(one.clip[frame : frame + 1]))
    fingers = _PART_KEYS.get(posture.part)
    own = [n for n in body.groups.right if fingers is None or body.keys[n].removeprefix("right").startswith(fingers)]
    other = [*body.groups.head, *body.groups.trunk, *body.groups.left, *rows(body, "left", "cuff", "sleeve")]
    return -float(collision.overlap(starts, ends, body.radii, own, other)[0].max())


def measure(gloss: str) -> dict[str, float]:
    """All figures of one word, by name."""
    one = planner.synthesize_word(SIGNS[gloss], STANDARD)
    e, fps = one.events, one.clip.fps
    body = body_capsules(one.clip.skeleton)
    rotations, positions = kinematics.forward(one.clip)
    starts, ends = capsule_ends(body, rotations, positions)
    sign = slice(e.start, e.end + 1)
    moves = moving(one).astype(int)
    hands = slice(1, 2) if one.sign.hands == "one" else slice(0, 2)
    head = np.rad2deg(one.states[e.up : e.down + 1, pose.HEAD])
    trunk = np.rad2deg(one.states[e.up : e.down + 1, pose.TRUNK])
    return {
        "arm_in_arm_cm": float(arm_in_arm(body, starts, ends).max()),
        "elbow_in_trunk_cm": float(collision.forearm_penetration(one.clip.skeleton, rotations, positions).max()),
        "hand_in_body_cm": float(hand_penetration(one.clip.skeleton, rotations, positions)[0].max()),
        "finger_in_thumb_cm": float(finger_in_thumb(body, starts, ends)[e.up : e.down].max()),
        "elbow_step_cm": float(elbow_steps(one.clip).max()),
        "elbow_turn_cm": float(swivel_steps(one.clip).max()),
        "moves_s": float(moves.sum() / fps),
        "holds_s": float((1 - moves).sum() / fps),
        "lasts_s": float((e.end - e.start + 1) / fps),
        "wrist_deg": float(wrist_bend(positions)[sign, hands].max()),
        "missed_cm": missed_touches(one),
        "head_yaw_rms": float(np.sqrt(np.mean(head[:, 1] ** 2))),
        "head_yaw_peak": float(np.abs(head[:, 1]).max()),
        "head_nod_rms": float(np.sqrt(np.mean(head[:, 0] ** 2))),
        "head_nod_peak": float(np.abs(head[:, 0]).max()),
        "trunk_peak": float(np.abs(trunk).max()),
    }


def seams(number: int, seed: int = 0) -> list[tuple[str, str]]:
    """Pairs of words of the package, drawn once."""
    glosses = sorted(SIGNS)
    drawn = np.random.default_rng(seed).integers(0, len(glosses), (number, 2))
    return [("FROG", "WALK"), ("NOT", "STAND"), *((glosses[a], glosses[b]) for a, b in drawn.tolist())]


def measure_seam(pair: tuple[str, str]) -> dict[str, float]:
    """The greatest steps and turns of an elbow in a pair, joined by default and by the signer, cm, over the frames of
    the transition; and the turn of the head there.
    """
    words = [planner.synthesize_word(SIGNS[gloss], STANDARD) for gloss in pair]
    result = ss.splice([word.clip for word in words])
    first = next(span for span in result.spans if span.kind == "transition").output
    clip = result.clip[first[0] - 1 : first[1] + 1]
    head = kinematics.forward(clip, [JOINTS["Head"]])[0][:, 0]
    cosine = 0.5 * (np.einsum("tab,tab->t", head[1:], head[:-1]) - 1.0)
    truth = sentences.utter(words, changes=False)
    signed = truth.clip[truth.stretches[1].start - 1 : truth.stretches[1].stop + 1]
    body = body_capsules(signed.skeleton)
    rotations, positions = kinematics.forward(signed)
    ends = capsule_ends(body, rotations, positions)
    return {
        "default_step_cm": float(elbow_steps(clip).max()),
        "default_turn_cm": float(swivel_steps(clip).max()),
        "head_deg_s": float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).max() * clip.fps),
        "default_arm_in_arm_cm": float(arm_in_arm(body, *capsule_ends(body, *kinematics.forward(clip))).max()),
        "true_step_cm": float(elbow_steps(signed).max()),
        "true_turn_cm": float(swivel_steps(signed).max()),
        "true_arm_in_arm_cm": float(arm_in_arm(body, *ends).max()),
        "true_hand_in_body_cm": float(hand_penetration(signed.skeleton, rotations, positions)[0].max()),
    }


_SEAM_LIMITS = {
    "default_step_cm": 8.0,
    "default_turn_cm": 8.0,
    "head_deg_s": 40.0,
    "default_arm_in_arm_cm": 1.0,
    "true_step_cm": 8.0,
    "true_turn_cm": 8.0,
    "true_arm_in_arm_cm": 1.0,
    "true_hand_in_body_cm": 0.5,
}
_TABLE: list[tuple[str, str, Callable[[FloatArray], object]]] = [
    ("arm in arm over 1 cm", "arm_in_arm_cm", lambda x: int((x > 1.0).sum())),
    ("elbow in trunk over 1 cm", "elbow_in_trunk_cm", lambda x: int((x > 1.0).sum())),
    ("hand in the body over .5 cm", "hand_in_body_cm", lambda x: int((x > 0.5).sum())),
    ("finger in its own thumb over .5 cm", "finger_in_thumb_cm", lambda x: int((x > 0.5).sum())),
    ("elbow steps over 8 cm", "elbow_step_cm", lambda x: int((x > 8.0).sum())),
    ("elbow turns over 3 cm a frame", "elbow_turn_cm", lambda x: int((x > 3.0).sum())),
    ("moves for under .2 s", "moves_s", lambda x: int((x < 0.1999).sum())),
    ("movement, median s", "moves_s", lambda x: round(float(np.median(x)), 3)),
    ("hold, median s", "holds_s", lambda x: round(float(np.median(x)), 3)),
    ("sign, median s", "lasts_s", lambda x: round(float(np.median(x)), 3)),
    ("wrists over 75 degrees", "wrist_deg", lambda x: int((x > 75.0).sum())),
    ("touches missed by over 1 cm", "missed_cm", lambda x: int((x > 1.0).sum())),
    ("head yaw, rms degrees", "head_yaw_rms", lambda x: round(float(np.sqrt(np.mean(x**2))), 2)),
    ("head yaw, peak degrees", "head_yaw_peak", lambda x: round(float(x.max()), 1)),
    ("head nod, rms degrees", "head_nod_rms", lambda x: round(float(np.sqrt(np.mean(x**2))), 2)),
    ("head nod, peak degrees", "head_nod_peak", lambda x: round(float(x.max()), 1)),
    ("trunk, peak degrees", "trunk_peak", lambda x: round(float(x.max()), 1)),
]
_LEAST = {"moves_s"}


def report(words: dict[str, dict[str, float]]) -> None:
    """Print the table of the words, each line with the worst."""
    for text, key, figure in _TABLE:
        values = np.array([one[key] for one in words.values()])
        order = np.argsort(values)[:: 1 if key in _LEAST else -1]
        worst = ", ".join(f"{list(words)[k]} {values[k]:.2f}" for k in order[:12])
        print(f"{text:36s} {figure(values)!s:>7}   {worst}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seams", type=int, default=300)
    parser.add_argument("--words", nargs="*")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    glosses = options.words or [g for g, one in SIGNS.items()]
    with ProcessPoolExecutor(2) as pool:
        words = dict(zip(glosses, pool.map(measure, glosses, chunksize=8), strict=True))
        report({gloss: one for gloss, one in words.items() if SIGNS[gloss].kind == "sign"})
        print("with letters:")
        report(words)
        pairs = seams(options.seams)
        found = dict(zip(pairs, pool.map(measure_seam, pairs, chunksize=8), strict=True)) if pairs else {}
    for key, most in _SEAM_LIMITS.items():
        if found:
            values = np.array([one[key] for one in found.values()])
            worst = ", ".join(f"{'>'.join(pairs[k])} {values[k]:.1f}" for k in np.argsort(values)[::-1][:8])
            count = int((values > most).sum())
            print(f"seams: {key:22s} median {np.median(values):.2f}, over {most:g}: {count}   {worst}")
    if options.json:
        options.json.write_text(
            json.dumps({"words": words, "seams": {">".join(k): v for k, v in found.items()}}, indent=1)
        )


if __name__ == "__main__":
    main()
