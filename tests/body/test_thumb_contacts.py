"""Thumbs on hands of other proportions: what they touch within their hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice.body import thumb_contacts
from signsplice.body.capsules import BodyShape, build_capsules
from signsplice.body.collision import clearances
from signsplice.body.contacts import PosedBody, pose_body
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, Skeleton, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS


def with_hands(skeleton: Skeleton, thumb: float, fingers: float) -> Skeleton:
    """The skeleton with longer or shorter phalanges; knuckles stay where they are."""
    offsets = np.array(skeleton.offsets)
    for role, joint in rig_info(skeleton).roles.joints.items():
        if "Thumb" in role and not role.endswith("Metacarpal"):
            offsets[joint] *= thumb
        elif any(f in role for f in FINGERS) and role.endswith(("Intermediate", "Distal")):
            offsets[joint] *= fingers
    return Skeleton(skeleton.names, skeleton.parents, offsets, skeleton.end_sites, skeleton.roles)


def thumb_clearances(posed: PosedBody) -> np.ndarray:
    """Skin distances (T, K), m, of the right thumb's last two bones and all other bones of its hand."""
    keys = posed.body.keys
    own = [keys.index(f"rightThumb{part}") for part in ("Proximal", "Distal")]
    other = [keys.index(f"right{f}{s}") for f in FINGERS[1:] for s in ("Palm", "Proximal", "Intermediate", "Distal")]
    a, b = np.repeat(own, len(other)), np.tile(other, len(own))
    n = len(posed.starts)
    p, u, q, v = (x.reshape(-1, 3) for r in (a, b) for x in (posed.starts[:, r], (posed.ends - posed.starts)[:, r]))
    radii = (np.tile(posed.radii[rows], (n, 1)) for rows in (a, b))
    return clearances(p - q, u, v, *radii).distance.reshape(n, -1)


def carried(clip: Clip, skeleton: Skeleton) -> Clip:
    return Clip(skeleton, clip.local_rotations, clip.root_positions, clip.fps)


@pytest.mark.parametrize(("thumb", "fingers"), [(0.93, 1.05), (1.07, 0.95)])
def test_a_thumb_touches_on_other_hands_what_it_touched(thumb: float, fingers: float) -> None:
    errors: list[list[np.ndarray]] = [[], []]
    for letter in ("fs-D", "fs-E", "fs-F", "fs-O", "fs-S"):
        clip = open_shipped_lexicon().clip(letter)
        other = with_hands(clip.skeleton, thumb, fingers)
        body, its = (build_capsules(skeleton, BodyShape()) for skeleton in (clip.skeleton, other))
        copied = carried(clip, other)
        made = thumb_contacts.keep_thumb_contacts(clip, body, copied, its)
        before = thumb_clearances(pose_body(clip, body))
        touching = before < 0.005
        assert touching.any(axis=1).sum() > 10
        for found, c in zip(errors, (copied, made), strict=True):
            found.append(np.abs(thumb_clearances(pose_body(c, its)) - before)[touching])
    without, kept = (float(np.mean(np.concatenate(found) < 0.003)) for found in errors)
    assert without < 0.72
    assert kept > 0.97


def test_first_joints_turn_little_and_smoothly_and_others_not() -> None:
    clip = open_shipped_lexicon().clip("fs-F")
    other = with_hands(clip.skeleton, 0.85, 1.1)
    bodies = [build_capsules(skeleton, BodyShape()) for skeleton in (clip.skeleton, other)]
    made = thumb_contacts.keep_thumb_contacts(clip, bodies[0], carried(clip, other), bodies[1])
    turns = rotation.multiply(rotation.inverse(clip.local_rotations), made.local_rotations)
    degrees = np.rad2deg(2.0 * np.arccos(np.clip(np.abs(turns[..., 3]), 0.0, 1.0)))
    joints = rig_info(clip.skeleton).roles.joints
    first = [j for r, j in joints.items() if r.endswith("ThumbMetacarpal")]
    first += [j for r, j in joints.items() if r.endswith("Proximal") and "Thumb" not in r]
    others = np.setdiff1d(np.arange(degrees.shape[1]), first)
    assert degrees[:, first].max() > 3.0
    assert degrees.max() < 15.0 + 1e-3
    assert degrees[:, others].max() < 1e-4
    assert np.abs(np.diff(degrees, axis=0)).max() < 6.0


def test_hands_of_the_same_proportions_keep_their_bits() -> None:
    clip = open_shipped_lexicon().clip("fs-F")
    body = build_capsules(clip.skeleton, BodyShape())
    assert thumb_contacts.keep_thumb_contacts(clip, body, clip, body) is clip
    sites = tuple(replace(site, offset=1.2 * site.offset) for site in clip.skeleton.end_sites)
    larger = Skeleton(clip.skeleton.names, clip.skeleton.parents, 1.2 * clip.skeleton.offsets, sites)
    copied = carried(clip, larger)
    assert thumb_contacts.keep_thumb_contacts(clip, body, copied, build_capsules(larger, BodyShape())) is copied
