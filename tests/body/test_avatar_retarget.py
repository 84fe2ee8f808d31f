"""Clips on avatars: hands meet the mesh, not only the capsules under it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import avatars
import signsplice as ss
from signsplice.body import skin_surface
from signsplice.body.capsules import Avatar, body_capsules
from signsplice.body.contacts import pose_body
from signsplice.body.skin_surface import SkinPoints
from signsplice.cli.commands import app
from signsplice.lexicon import open_shipped_lexicon
from signsplice.rig.align import copy_rotations, reference
from signsplice_workshop.measure import avatars as avatar_measures


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("avatars")
    for name in ("narrow", "big head"):
        avatar = avatars.body(name)
        avatars.write(made / f"{name}.vrm", avatar, avatars.tubes(avatar), "0.x" if name == "narrow" else "1.0")
    ss.save(open_shipped_lexicon().clip("NAME"), made / "NAME.bvh")
    ss.save(open_shipped_lexicon().clip("MOTHER"), made / "MOTHER.bvh")
    return made


@pytest.mark.parametrize(("gloss", "name"), [("NAME", "narrow"), ("MOTHER", "big head"), ("MY", "narrow")])
def test_contacts_are_kept_on_avatars(folder: Path, gloss: str, name: str) -> None:
    clip, avatar = open_shipped_lexicon().clip(gloss), ss.read_avatar(folder / f"{name}.vrm")
    done = ss.retarget(clip, avatar)
    assert done.clip.skeleton is avatar
    assert done.contacts
    assert all(one.is_kept for one in done.contacts), done.contacts
    carried = copy_rotations(clip, reference(done.clip))[0]
    moved = np.abs(carried.local_rotations - done.clip.local_rotations).max()
    assert moved > 0.01, "rotations alone would not do"


def test_convert_says_that_contacts_without_skin_are_not_measured(folder: Path, tmp_path: Path) -> None:
    avatar, report, out = (tmp_path / name for name in ("bare.vrm", "r.json", "out.vrma"))
    avatar.write_bytes((folder / "narrow.vrm").read_bytes())
    avatars.edited(avatar, lambda document: [node.pop("mesh", None) for node in document["nodes"]])
    clip = str(folder / "NAME.bvh")
    run = CliRunner().invoke(app, ["convert", clip, str(out), "--avatar", str(avatar), "--report", str(report)])
    assert run.exit_code == 0, run.output
    assert "contacts not measured" in run.output
    assert "kept" not in run.output
    contacts = json.loads(report.read_text())["contacts"]
    assert {(row["is_kept"], row["after_mm"]) for row in contacts} == {(None, None)}


def test_an_avatar_of_the_same_bones_has_its_own_skin(folder: Path) -> None:
    avatar = ss.read_avatar(folder / "big head.vrm")
    clip = ss.retarget(open_shipped_lexicon().clip("MOTHER"), avatar).clip
    assert body_capsules(avatar) is avatar.body
    plain = replace(clip, skeleton=replace(avatar, body=None, mesh=()))
    change = np.abs(ss.retarget(plain, avatar).clip.local_rotations - clip.local_rotations).max()
    assert change > 0.05, "usual skin on the same bones: hands move"
    assert ss.retarget(clip, avatar).clip is clip, "its own body: nothing does"


def test_hands_stay_on_skin_that_lies_above_its_capsules(folder: Path) -> None:
    """A breastplate of 2 cm over the chest's capsules: the hand of MY comes to lie on it."""
    avatar, clip = ss.read_avatar(folder / "narrow.vrm"), open_shipped_lexicon().clip("MY")
    assert avatar.body is not None
    skin = avatar.body.skin
    assert skin is not None
    plate = replace(skin, body=replace(skin.body, points=skin.body.points + 0.02 * skin.body.normals))
    bodies = {"bare": avatar.body, "plated": replace(avatar.body, skin=plate)}
    distances = {}
    for name, body in bodies.items():
        onto = replace(avatar, body=body)
        posed = pose_body(ss.retarget(clip, onto).clip, body_capsules(onto))
        chest, palm = (posed.body.keys.index(key) for key in ("chest1", "rightMiddlePalm"))
        middle = 0.5 * (posed.starts + posed.ends)
        distances[name] = np.linalg.norm(middle[32, palm] - middle[32, chest])
    assert 0.009 < distances["plated"] - distances["bare"] < 0.03


@pytest.mark.parametrize("gloss", ["PLEASE", pytest.param("FRIEND", marks=pytest.mark.slow)])
def test_vertices_of_hands_lie_where_skins_met_at_the_source(folder: Path, gloss: str) -> None:
    rows = avatar_measures.measure_words([ss.read_avatar(folder / "narrow.vrm")], [open_shipped_lexicon().clip(gloss)])
    assert sum(row.n_touching for row in rows) > 10
    assert all(row.kept is None or row.kept > 0.95 for row in rows), rows
    assert max(row.deepest for row in rows) < 0.005


@pytest.mark.slow
def test_skin_beside_a_finger_holds_no_hands_apart(folder: Path) -> None:
    """They were 2.2 mm apart when skin up to 10 mm beside a finger counted as below it."""
    rows = avatar_measures.measure_words([ss.read_avatar(folder / "narrow.vrm")], [open_shipped_lexicon().clip("NAME")])
    (row,) = (row for row in rows if row.skin == "hand")
    assert row.n_touching > 10
    assert row.median < 0.0019


def test_skin_moves_hands_smoothly_and_only_where_they_touch(folder: Path) -> None:
    avatar, clip = ss.read_avatar(folder / "narrow.vrm"), open_shipped_lexicon().clip("PLEASE")
    assert avatar.body is not None
    plain = replace(avatar, body=replace(avatar.body, skin=None))
    (on_skin, _), (before, _) = (arm_ends(ss.retarget(clip, onto).clip) for onto in (avatar, plain))
    moved = np.linalg.norm(on_skin - before, axis=-1)
    assert 0.002 < moved.max() < 0.03
    assert moved[[0, -1]].max() < 1e-3, "where arms hang"
    steps = [np.linalg.norm(np.diff(wrists, 2, axis=0), axis=-1).max() for wrists in (on_skin, before)]
    assert steps[0] < 1.25 * steps[1]


def arm_ends(clip: ss.Clip) -> tuple[np.ndarray, np.ndarray]:
    """Wrists and shoulders (T, 2, 3)."""
    posed = pose_body(clip, body_capsules(clip.skeleton))
    return posed.wrists, posed.shoulders


def test_a_surface_is_the_outermost_skin_and_follows_its_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """A square of skin, and one of cloth 5 mm above its left half, on two joints that turn apart."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0.0, 0.1, 11), np.linspace(0.0, 0.1, 11)))
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    square = np.concatenate(
        [np.stack([corner, corner + 1, corner + 12], 1), np.stack([corner, corner + 12, corner + 11], 1)]
    )
    skin = np.stack([x, y, np.zeros_like(x)], axis=1)
    cloth = skin * [0.5, 1.0, 1.0] + [0.0, 0.0, 0.005]
    weights = np.concatenate([np.stack([1.0 - 10.0 * v[:, 0], 10.0 * v[:, 0]], axis=1) for v in (skin, cloth)])
    mesh = SkinPoints(
        np.concatenate([skin, cloth]), np.tile([0, 1], (242, 1)), weights, np.concatenate([square, square + 121]),
        np.zeros(242, bool),
    )  # fmt: skip
    made = skin_surface.surface(mesh, [0, 1], np.zeros((2, 3)), 0.004)
    assert made is not None
    below = made.points[:, 2] < 0.001
    assert made.points[below, 0].min() > 0.045
    assert made.points[~below, 0].max() < 0.05
    turn = np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0])])
    rows, places = np.arange(len(made.points)), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rest, points = made.deform(
        np.stack([np.tile(np.eye(3), (2, 1, 1)), turn]), np.stack([np.zeros((2, 3)), places]), rows
    )
    np.testing.assert_allclose(rest, made.points, atol=1e-12)
    normals = made.turn_normals(turn, rows)
    blend = 10.0 * made.points[:, :1]
    np.testing.assert_allclose(points, (1.0 - blend) * made.points + blend * (made.points @ turn[1] + [0.0, 0.0, 1.0]))
    assert (normals[blend[:, 0] > 0.6] @ [0.0, 0.0, 1.0] < -0.99).all()
    is_near = np.isin(made.patches.of_points, made.near(turn, places, np.array([0.0, 0.05, 0.0]), 0.02))
    assert is_near[np.linalg.norm(points - [0.0, 0.05, 0.0], axis=1) < 0.02].all()
    assert not is_near.all()
    gaps = points[:, None] - points
    np.testing.assert_allclose(skin_surface.squared_distances(points, points), (gaps**2).sum(axis=2), atol=1e-6)
    bound = skin_surface.SurfaceSettings(most_weights=len(points))
    monkeypatch.setattr(skin_surface, "_SURFACE", bound)
    assert skin_surface.surface(mesh, [0, 1], np.zeros((2, 3)), 0.004) is None, "more than its bound"


def test_the_far_side_of_a_nail_does_not_hide_a_hand_above_it() -> None:
    """A nail 0.2 mm thick whose lower side has the point nearest to a hand 5 mm above it."""
    nail = np.array([[0.0, 0.0, -0.0002], [0.002, 0.0, 0.0]])
    normals = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    for z, expected in ((0.005, 0.005), (-0.004, 0.0038)):
        height, heights, _ = skin_surface.least_height(np.array([[0.0, 0.0, z]]), nail, normals, 0.003, 0.015)
        np.testing.assert_allclose([height, *heights], expected, atol=1e-7)
    far = skin_surface.least_height(np.array([[0.0, 0.0, 0.04]]), nail, normals, 0.003, 0.015)
    assert far[0] == np.inf


def test_convert_puts_a_file_onto_an_avatar(folder: Path, tmp_path: Path) -> None:
    clip, out, report, avatar = (str(p) for p in (folder / "NAME.bvh", tmp_path / "o.vrma", tmp_path / "r.json",
                                                  folder / "narrow.vrm"))  # fmt: skip
    run = CliRunner().invoke(app, ["convert", clip, out, "--avatar", avatar, "--report", report])
    assert run.exit_code == 0, run.output
    assert "2 of 2 contacts kept" in run.output
    assert len(ss.load(out)) == len(ss.load(clip))
    assert '"onto": ' in Path(report).read_text()
    both = CliRunner().invoke(app, ["convert", clip, out, "--avatar", avatar, "--onto", clip])
    assert "--onto and --avatar each name a body, expected one of them" in str(both.exception)
    over = CliRunner().invoke(app, ["convert", clip, avatar.replace(".vrm", ".glb"), "--avatar", clip])
    assert "is no avatar, expected .vrm, .glb, .gltf or .fbx" in str(over.exception)


def test_the_mesh_of_an_avatar_is_written_and_drawn(folder: Path, tmp_path: Path) -> None:
    avatar = ss.read_avatar(folder / "narrow.vrm")
    clip = ss.retarget(open_shipped_lexicon().clip("NAME")[40:42], avatar).clip
    ss.save(clip, tmp_path / "o.glb")
    again = ss.read_avatar(tmp_path / "o.glb")
    assert isinstance(again, Avatar)
    assert sum(len(part.triangles) for part in again.mesh) == sum(len(part.triangles) for part in avatar.mesh)
