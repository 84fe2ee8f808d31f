"""What serves where nothing is named: networks, and the classical methods where no network can be read."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import signsplice as ss
from signing import word
from signsplice.errors import InputError
from signsplice.rig.arms import arms
from signsplice.splicing import methods as defaults
from signsplice.splicing import report
from signsplice.splicing.bundle import BUNDLE_FILE, bundle_sha256
from signsplice.splicing.cut import Cut
from signsplice.splicing.duration import travel_widths
from signsplice.splicing.learned import LearnedCutter, LearnedDuration, LearnedTransition

TINY = Path(__file__).parents[1] / "golden" / "tiny_bundle"
CLIPS = [word(gloss).clip for gloss in ("MOTHER", "BOOK", "SEE")]


@pytest.fixture
def weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The bundle that ships, for once a copy of the tiny one."""
    folder = tmp_path / "weights"
    shutil.copytree(TINY, folder)
    monkeypatch.setattr(defaults, "WEIGHTS", folder)
    return folder


def kinds(methods: defaults.ChosenMethods) -> tuple[bool, bool, bool]:
    """Which parts are learned."""
    return (
        isinstance(methods.cutter, LearnedCutter),
        isinstance(methods.transition, LearnedTransition),
        isinstance(methods.duration, LearnedDuration),
    )


def test_networks_are_the_default_and_the_report_names_them(weights: Path) -> None:
    chosen = defaults.choose()
    assert kinds(chosen) == (True, True, True)
    assert chosen.bundle == bundle_sha256(weights)
    assert chosen.warnings == ()
    assert defaults.choose(duration="auto").duration is chosen.duration
    result = ss.splice(CLIPS)
    assert report.describe(result)["bundle"] == bundle_sha256(weights)
    assert (result.cutter, result.transition) == ("learned", "learned")
    filled = ss.inbetween(CLIPS[0], [(20, 30)])
    assert (filled.transition, filled.bundle) == ("learned", bundle_sha256(weights))


def test_what_is_named_is_taken_and_nothing_else_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(defaults, "WEIGHTS", tmp_path / "none")
    chosen = defaults.choose("ends", "hold", "fixed")
    assert (chosen.cutter.name, chosen.transition.name, chosen.duration.name) == ("ends", "hold", "fixed")
    assert (chosen.bundle, chosen.warnings) == (None, ())
    assert ss.inbetween(CLIPS[0], [(20, 30)], "hermite").bundle is None


def test_one_part_learned_is_enough_to_name_the_bundle(weights: Path) -> None:
    chosen = defaults.choose("ends", None, "fixed")
    assert kinds(chosen) == (False, True, False)
    assert chosen.bundle == bundle_sha256(weights)
    assert defaults.choose("ends", "hermite", "fixed").bundle is None


@pytest.mark.parametrize("broken", ["missing", "head", "graph", "foreign", "features"])
def test_without_a_readable_bundle_the_classical_methods_serve(weights: Path, broken: str) -> None:
    before = ss.splice(CLIPS, ss.SpliceOptions("pose-velocity", "hermite", "tempo"))
    facts = json.loads((weights / BUNDLE_FILE).read_text())
    if broken == "missing":
        shutil.rmtree(weights)
    elif broken == "head":
        (weights / BUNDLE_FILE).write_text("{")
    elif broken == "graph":
        graph = bytearray((weights / "bridge.onnx").read_bytes())
        graph[len(graph) // 2] ^= 1
        (weights / "bridge.onnx").write_bytes(graph)
    elif broken == "foreign":
        (weights / BUNDLE_FILE).write_text(json.dumps(facts | {"system": "lpt"}))
    else:
        (weights / BUNDLE_FILE).write_text(json.dumps(facts | {"features": 0}))
    result = ss.splice(CLIPS)
    assert (result.cutter, result.transition, result.bundle) == ("pose-velocity", "hermite", None)
    np.testing.assert_array_equal(result.clip.local_rotations, before.clip.local_rotations)
    told = [line for line in result.warnings if "classical" in line]
    assert len(told) == 1
    assert str(weights) in told[0]
    assert sum(len(piece.warnings) for piece in ss.stream(CLIPS)) == 1
    assert len(ss.inbetween(CLIPS[0], [(20, 30)]).warnings) == 1
    with pytest.raises(InputError, match="weights"):
        defaults.choose(cutter="learned")
    with pytest.raises(InputError, match="weights"):
        defaults.choose(bundle=weights)


def test_a_bundle_may_hold_some_networks(weights: Path) -> None:
    facts = json.loads((weights / BUNDLE_FILE).read_text())
    del facts["files"]["bridge.onnx"]
    (weights / BUNDLE_FILE).write_text(json.dumps(facts))
    chosen = defaults.choose(bundle=weights)
    assert kinds(chosen) == (True, False, True)
    assert chosen.transition.name == "hermite"
    with pytest.raises(InputError, match="holds no network for the transition"):
        defaults.choose(transition="learned", bundle=weights)


def test_unknown_names_are_told_all_there_are(weights: Path) -> None:
    with pytest.raises(InputError, match=r"expected one of ends, .*, learned"):
        defaults.choose(cutter="nearest")


def test_a_bundle_written_anew_is_opened_anew(weights: Path) -> None:
    first = defaults.choose(bundle=weights)
    assert defaults.choose(bundle=weights).cutter is first.cutter
    facts = json.loads((weights / BUNDLE_FILE).read_text())
    (weights / BUNDLE_FILE).write_text(json.dumps(facts | {"seed": 5}))
    second = defaults.choose(bundle=weights)
    assert second.cutter is not first.cutter
    assert second.bundle != first.bundle


def test_the_list_of_methods_has_one_default_a_kind(weights: Path) -> None:
    rows = defaults.all_methods()
    for kind in ("cutter", "transition", "duration"):
        assert [part.name for of, part, default in rows if of == kind and default] == ["learned"]
        names = [part.name for of, part, _ in rows if of == kind]
        assert len(names) == len(set(names)) > 3


def test_a_rig_without_arms_is_bridged_and_timed_by_rule(weights: Path) -> None:
    clip = CLIPS[0]
    names = tuple(f"j{k}" for k in range(len(clip.skeleton.names)))
    bare = ss.Clip(
        ss.Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets),
        clip.local_rotations,
        clip.root_positions,
        clip.fps,
    )
    own = ss.inbetween(bare, [(20, 30)])
    rule = ss.inbetween(bare, [(20, 30)], "hermite")
    np.testing.assert_array_equal(own.clip.local_rotations, rule.clip.local_rotations)
    joined = ss.splice([bare, bare], ss.SpliceOptions(cutter="ends"))
    assert joined.seams[0].seconds == pytest.approx(0.25, abs=1.0 / clip.fps)
    with pytest.raises(InputError, match="a cutter that needs no arms"):
        ss.splice([bare, bare])


def test_what_is_longer_than_the_network_knows_is_said(weights: Path) -> None:
    result = ss.splice(CLIPS[:2], ss.SpliceOptions(transition_time=3.0))
    assert any("made by hermite alone" in line for line in result.seams[0].warnings)
    short = ss.splice(CLIPS[:2], ss.SpliceOptions(transition_time=0.4))
    assert not any("made by" in line for line in short.seams[0].warnings)


def test_the_learned_time_is_not_quicker_than_people(weights: Path) -> None:
    learned = defaults.open_learned(weights)
    slow = learned.durations["learned"]
    quick = LearnedDuration(slow.reader, unhurried=False)
    p, q = CLIPS[:2]
    held = 0
    for cut in (Cut(10, 20), Cut(36, 30), Cut(36, len(q) - 3), Cut(24, 24)):
        law = 0.051 + 0.149 * np.log2(1.0 + travel_widths(arms(p), arms(q), cut.pre, cut.post) / 0.15)
        raw = quick.seconds(p, q, cut)
        # The body's size in arm lengths is told from its rest, the arms' own from the clip.
        assert slow.seconds(p, q, cut) == pytest.approx(max(raw, 0.25, law), rel=0.02)
        held += law > 0.25
    assert held
