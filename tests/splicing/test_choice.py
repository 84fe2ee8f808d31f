"""Methods: networks by default, and classical methods where no network can be read."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import GOLDEN

import signsplice as ss
from signing import word
from signsplice.errors import InputError
from signsplice.splicing import options as methods
from signsplice.splicing import report
from signsplice.splicing.bundle import BUNDLE_FILE, bundle_sha256
from signsplice.splicing.learned import LearnedCutter, LearnedTransition

TINY = GOLDEN / "tiny_bundle"
CLIPS = [word(gloss).clip for gloss in ("MOTHER", "BOOK", "SEE")]


@pytest.fixture
def weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the tiny bundle in place of the one that ships."""
    folder = tmp_path / "weights"
    shutil.copytree(TINY, folder)
    monkeypatch.setattr(methods, "WEIGHTS", folder)
    return folder


def learned_parts(chosen: methods.Methods) -> tuple[bool, bool]:
    """Whether cutter and transition are networks."""
    return (
        isinstance(chosen.cutter, LearnedCutter),
        isinstance(chosen.transition, LearnedTransition),
    )


def test_networks_are_the_default_and_the_report_names_them(weights: Path) -> None:
    chosen = methods.choose()
    assert learned_parts(chosen) == (True, True)
    assert chosen.duration.name == "tempo"
    assert chosen.bundle == bundle_sha256(weights)
    assert chosen.warnings == ()
    assert methods.choose(duration="auto").duration is chosen.duration
    result = ss.splice(CLIPS)
    assert report.describe(result)["bundle"] == bundle_sha256(weights)
    assert (result.cutter, result.transition) == ("learned", "learned")
    filled = ss.inbetween(CLIPS[0], [(20, 30)])
    assert (filled.transition, filled.bundle) == ("learned", bundle_sha256(weights))


def test_with_classical_methods_no_bundle_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(methods, "WEIGHTS", tmp_path / "none")
    chosen = methods.choose("ends", "hold", "fixed")
    assert (chosen.cutter.name, chosen.transition.name, chosen.duration.name) == ("ends", "hold", "fixed")
    assert (chosen.bundle, chosen.warnings) == (None, ())
    assert ss.inbetween(CLIPS[0], [(20, 30)], "hermite").bundle is None


def test_the_bundle_is_named_where_one_part_is_learned(weights: Path) -> None:
    chosen = methods.choose("ends", None, "fixed")
    assert learned_parts(chosen) == (False, True)
    assert chosen.bundle == bundle_sha256(weights)
    assert methods.choose("ends", "hermite", "fixed").bundle is None


@pytest.mark.parametrize("broken", ["missing", "json", "network", "other system", "features"])
def test_without_a_readable_bundle_methods_are_classical(weights: Path, broken: str) -> None:
    classical = ss.splice(CLIPS, ss.SpliceOptions("pose-velocity", "hermite", "tempo"))
    stored = json.loads((weights / BUNDLE_FILE).read_text())
    if broken == "missing":
        shutil.rmtree(weights)
    elif broken == "json":
        (weights / BUNDLE_FILE).write_text("{")
    elif broken == "network":
        content = bytearray((weights / "bridge.onnx").read_bytes())
        content[len(content) // 2] ^= 1
        (weights / "bridge.onnx").write_bytes(content)
    elif broken == "other system":
        (weights / BUNDLE_FILE).write_text(json.dumps(stored | {"system": "lpt"}))
    else:
        (weights / BUNDLE_FILE).write_text(json.dumps(stored | {"features": 0}))
    result = ss.splice(CLIPS)
    assert (result.cutter, result.transition, result.bundle) == ("pose-velocity", "hermite", None)
    np.testing.assert_array_equal(result.clip.local_rotations, classical.clip.local_rotations)
    warnings = [line for line in result.warnings if "classical" in line]
    assert len(warnings) == 1
    assert str(weights) in warnings[0]
    assert sum(len(piece.warnings) for piece in ss.stream(CLIPS)) == 1
    assert len(ss.inbetween(CLIPS[0], [(20, 30)]).warnings) == 1
    with pytest.raises(InputError, match="weights"):
        methods.choose(cutter="learned")
    with pytest.raises(InputError, match="weights"):
        methods.choose(bundle=weights)


def test_a_bundle_may_hold_only_some_networks(weights: Path) -> None:
    stored = json.loads((weights / BUNDLE_FILE).read_text())
    del stored["files"]["bridge.onnx"]
    (weights / BUNDLE_FILE).write_text(json.dumps(stored))
    chosen = methods.choose(bundle=weights)
    assert learned_parts(chosen) == (True, False)
    assert chosen.transition.name == "hermite"
    with pytest.raises(InputError, match="holds no network for the transition"):
        methods.choose(transition="learned", bundle=weights)


def test_an_unknown_name_is_refused_with_all_names(weights: Path) -> None:
    with pytest.raises(InputError, match=r"expected one of ends, .*, learned"):
        methods.choose(cutter="nearest")


def test_a_bundle_that_is_written_anew_is_opened_anew(weights: Path) -> None:
    first = methods.choose(bundle=weights)
    assert methods.choose(bundle=weights).cutter is first.cutter
    stored = json.loads((weights / BUNDLE_FILE).read_text())
    (weights / BUNDLE_FILE).write_text(json.dumps(stored | {"seed": 5}))
    second = methods.choose(bundle=weights)
    assert second.cutter is not first.cutter
    assert second.bundle != first.bundle


def test_the_list_of_methods_has_one_default_of_each_kind(weights: Path) -> None:
    rows = methods.all_methods()
    for kind, default in (("cutter", "learned"), ("transition", "learned"), ("duration", "tempo")):
        assert [method.name for k, method, is_default in rows if k == kind and is_default] == [default]
        names = [method.name for k, method, _ in rows if k == kind]
        assert len(names) == len(set(names)) > 1


def test_a_rig_without_known_arms_is_filled_and_timed_by_rule(weights: Path) -> None:
    clip = CLIPS[0]
    names = tuple(f"j{k}" for k in range(len(clip.skeleton.names)))
    bare = ss.Clip(
        ss.Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets),
        clip.local_rotations,
        clip.root_positions,
        clip.fps,
    )
    default, hermite = (ss.inbetween(bare, [(20, 30)], transition) for transition in (None, "hermite"))
    np.testing.assert_array_equal(default.clip.local_rotations, hermite.clip.local_rotations)
    joined = ss.splice([bare, bare], ss.SpliceOptions(cutter="ends"))
    assert joined.seams[0].seconds == pytest.approx(0.25, abs=1.0 / clip.fps)
    with pytest.raises(InputError, match="a cutter that needs no arms"):
        ss.splice([bare, bare])


def test_a_gap_that_is_too_long_for_the_network_has_a_warning(weights: Path) -> None:
    result = ss.splice(CLIPS[:2], ss.SpliceOptions(transition_time=3.0))
    assert any("made by hermite alone" in line for line in result.seams[0].warnings)
    short = ss.splice(CLIPS[:2], ss.SpliceOptions(transition_time=0.4))
    assert not any("made by" in line for line in short.seams[0].warnings)
