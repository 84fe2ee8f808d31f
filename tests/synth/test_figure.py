"""A body whose arms alone are posed again, and its nearest skins, beside forward kinematics and all pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signing import sign
from signsplice.body import capsules, collision
from signsplice.motion import kinematics
from signsplice.signer import planner, pose
from signsplice.signer.figure import ARMS, Figure
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, STANDARD, draw_signer


def made(gloss: str, seed: int | None) -> IsolatedWord:
    signer = STANDARD if seed is None else replace(draw_signer(seed), left_handed=False)
    return planner.synthesize_word(sign(gloss), signer)


@pytest.mark.parametrize(("gloss", "seed"), [("MOTHER", None), ("WORK", 3), ("PLEASE", 8)])
def test_a_figure_is_the_body_of_its_clip_in_the_chests_axes(gloss: str, seed: int | None) -> None:
    word = made(gloss, seed)
    rotations, positions = kinematics.forward(word.clip)
    chest, origin = rotations[:, JOINTS["Spine2"]], positions[:, JOINTS["Spine2"], None]
    ends = np.stack(capsules.capsule_ends(capsules.body_capsules(word.clip.skeleton), rotations, positions))
    figure = Figure(word.states, word.signer)
    posed = figure.pose_arms(word.states)
    legs = [n for n, part in enumerate(figure.body.parts) if part in ("leg", "shoe")]
    found = np.stack([posed.capsules.starts, posed.capsules.ends])
    error = np.linalg.norm((ends - origin) @ chest - found, axis=-1)
    assert np.delete(error, legs, axis=2).max() < 1e-9
    seen = np.einsum("tba,tskb->tska", chest, positions[:, ARMS] - origin[:, None])
    assert np.abs(seen - posed.positions).max() < 1e-9
    assert np.abs(np.einsum("tba,tskbc->tskac", chest, rotations[:, ARMS]) - posed.rotations).max() < 1e-9


def test_some_frames_are_posed_as_among_all_and_arms_may_be_given() -> None:
    word = made("WORK", None)
    figure, some = Figure(word.states, STANDARD), np.arange(0, len(word), 7)
    turned = word.states[some].copy()
    turned[:, pose.TURNS] += 0.5  # of no effect where arms are given
    whole = figure.pose_arms(word.states).capsules.ends
    part = figure.pose_arms(turned, some, pose.solve_arms_and_angles(word.states[some], STANDARD)).capsules.ends
    assert np.abs(whole[some] - part).max() < 1e-9


@pytest.mark.parametrize("gloss", ["MOTHER", "WORK"])
def test_the_nearest_skins_are_those_of_all_pairs(gloss: str) -> None:
    word = made(gloss, None)
    posed = Figure(word.states, STANDARD).pose_arms(word.states).capsules
    groups = posed.body.groups
    parts = (groups.head, groups.trunk, groups.left)
    distance, out = posed.nearest(groups.right, parts)
    for n, part in enumerate(parts):
        depth, normals = collision.overlap(posed.starts, posed.ends, posed.body.radii, groups.right, part)
        flat = depth.reshape(len(depth), -1)
        assert np.abs(distance[:, n] + flat.max(axis=1)).max() < 1e-9
        best = normals.reshape(len(depth), -1, 3)[np.arange(len(depth)), flat.argmax(axis=1)]
        assert np.abs(out[:, n] - best).max() < 1e-9
    near = posed.nearest(groups.right, parts, 4.0)[0]
    close = distance.min(axis=1) < 4.0
    assert close.any()
    assert not close.all()
    assert np.array_equal(near[close], distance[close])
    assert near[~close].min() >= 4.0
