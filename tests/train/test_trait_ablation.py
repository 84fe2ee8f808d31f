"""What traits are worth: which networks are trained, that a stopped call continues, the ranking, and the errors."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")

from click.testing import CliRunner

from signing import word
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.splicing.methods.choice import WEIGHTS
from signsplice.synth import training_data
from signsplice.synth.manner import TRAITS
from signsplice.train import trait_ablation
from signsplice.train.trait_ablation import LENGTHS, Ablation, AblationRow

HELPS = {"undershoot": 0.80, "low_elbows": 0.85, "base_lag": 0.90, "off_frame": 0.91, "hesitation": 0.94}
"""Errors of some traits alone; those of all others are 0.95."""
BEST = ("off_frame", "low_elbows", "undershoot", "base_lag")


@pytest.fixture
def ablation(tmp_path: Path) -> Ablation:
    return Ablation("clip.bvh", word("MOTHER").clip[:40], (0, 60), tmp_path / "work", "smoke")


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[tuple[tuple[str, ...], int]]:
    """The networks that are trained, which nobody trains: their errors are those of ``HELPS``."""
    done: list[tuple[tuple[str, ...], int]] = []

    def measured(job: tuple[Ablation, tuple[str, ...], int]) -> AblationRow:
        _, traits, seed = job
        done.append((traits, seed))
        error = HELPS.get(traits[0], 0.95) if len(traits) == 1 else 0.7 + 0.02 * seed
        names = (*trait_ablation.GROUPS, trait_ablation.ARMS)
        return AblationRow(traits, seed, dict.fromkeys(names, (error,) * len(LENGTHS)))

    monkeypatch.setattr(trait_ablation, "_measured", measured)
    monkeypatch.setattr(training_data, "write_all", lambda *_: 0)
    return done


def test_each_trait_is_tried_alone_and_the_best_together(
    ablation: Ablation, trained: list[Any], tmp_path: Path
) -> None:
    rows = trait_ablation.run(ablation, tmp_path / "rows.json", processes=1)
    assert trained[:14] == [((), 0), (TRAITS, 0), *(((name,), 0) for name in TRAITS)]
    assert sorted(trained[14:]) == sorted([((), 1), ((), 2), (TRAITS, 1), (TRAITS, 2), *((BEST, k) for k in range(3))])
    assert [(row.traits, row.seed) for row in rows] == trained
    stored = json.loads((tmp_path / "rows.json").read_text())
    assert len(stored["rows"]) == 21
    assert len(stored["hermite"]["hands"]) == len(LENGTHS)


def test_a_call_that_was_stopped_continues(
    ablation: Ablation, trained: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, measured = tmp_path / "rows.json", trait_ablation._measured

    def stopped(job: tuple[Ablation, tuple[str, ...], int]) -> AblationRow:
        if len(trained) == 5:
            raise KeyboardInterrupt
        return measured(job)

    with monkeypatch.context() as patch:
        patch.setattr(trait_ablation, "_measured", stopped)
        with pytest.raises(KeyboardInterrupt):
            trait_ablation.run(ablation, out, processes=1)
    assert len(trained) == 5
    trait_ablation.run(ablation, out, processes=1)
    assert len(trained) == len(set(trained)) == 21, "no network is trained twice"
    trait_ablation.run(ablation, out, processes=1)
    assert len(trained) == 21
    with pytest.raises(InputError, match=r"holds rows of trait-ablation.*frames:0:60.*expected .*frames:1:60"):
        trait_ablation.run(replace(ablation, frames=(1, 60)), out, processes=1)
    out.write_text(out.read_text().replace('"seed": 2', '"seed": "2"'))
    with pytest.raises(InputError, match=r"rows.json: rows: found .*remove it to begin anew"):
        trait_ablation.run(ablation, out, processes=1)


def test_a_last_look_chooses_nothing(ablation: Ablation, trained: list[Any], tmp_path: Path) -> None:
    chosen = AblationRow(("base_lag", "hesitation"), 7, {"all": (1.0,)})
    stored = {"signature": "another", "rows": [asdict(chosen)]}
    (tmp_path / "first.json").write_text(json.dumps(stored))
    trait_ablation.run(ablation, tmp_path / "last.json", processes=1, same_as=tmp_path / "first.json")
    assert trained == [(chosen.traits, 7)]


@pytest.mark.usefixtures("trained")
def test_the_page_ranks_traits_and_gives_mean_and_spread(ablation: Ablation, tmp_path: Path) -> None:
    rows = trait_ablation.run(ablation, tmp_path / "rows.json", processes=1)
    trait_ablation.write_page(tmp_path / "rows.md", ablation, rows)
    page = (tmp_path / "rows.md").read_text()
    assert "Frames 0 to 59 of `clip.bvh`" in page
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| ")]
    cells = [line for line in cells if line[0] != "---"]
    names = [line[0] for line in cells]
    assert names[:8] == ["traits", "none", "all", "undershoot", "low_elbows", "base_lag", "off_frame", "hesitation"]
    assert names[-4:] == ["traits", "none", "all", ", ".join(BEST)]
    assert cells[3][1] == "0.800"
    assert cells[-1][1] == "0.720 ± 0.020"


def test_errors_are_those_of_every_joint_and_of_the_arms_alone() -> None:
    errors = trait_ablation.errors(word("MOTHER").clip[10:50], WEIGHTS)
    assert set(errors) == {"all", "hands", "fingers", "trunk", "arms"}
    assert all(len(of) == len(LENGTHS) for of in errors.values())
    assert max(errors["hands"]) < 1.0, "the networks that ship are better than the curve on synthetic signing"
    assert errors["fingers"] != (1.0, 1.0, 1.0), "the answer for fingers counts, though the product leaves it out"
    assert errors["all"] != errors["arms"]


def test_a_clip_that_is_too_short_is_refused_before_any_training(
    ablation: Ablation, trained: list[Any], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="no clip has 24 frames"):
        trait_ablation.run(replace(ablation, clip=word("MOTHER").clip[:20]), tmp_path / "rows.json", processes=1)
    assert trained == []


@pytest.mark.slow
def test_a_network_is_trained_on_signing_with_the_traits_alone(ablation: Ablation) -> None:
    trait_ablation._make_signing(ablation, [(), ("base_lag",)], 1, lambda _: None)
    row = trait_ablation._measured((ablation, ("base_lag",), 1))
    assert (row.traits, row.seed) == (("base_lag",), 1)
    parts = sorted(path.name for path in (trait_ablation._work(ablation) / "signing" / "base_lag").iterdir())
    assert len(parts) == 2
    assert all("-base_lag-v" in name for name in parts)
    assert json.loads((trait_ablation._work(ablation) / "networks" / "base_lag-seed1" / "bundle.json").read_text())[
        "networks"
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frames", "3"), "--frames '3', expected A:B with A < B <= 1"),
        (("--frames", "0:900"), "--frames '0:900', expected A:B with A < B <= 1"),
        (("--frames", "0:1", "--processes", "0"), "--processes 0, expected at least 1"),
        (("--frames", "0:1", "-o", "rows.txt"), "-o rows.txt, expected a name that ends in .json"),
        ((), "Missing option '--frames'"),
    ],
)
def test_bad_calls_get_one_line(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    clip = tmp_path / "clip.bvh"
    clip.write_text(
        "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
        "End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.0333333\n0 0 0\n"
    )
    out = () if "-o" in arguments else ("-o", str(tmp_path / "rows.json"))
    called = CliRunner().invoke(app, ["train", "traits", str(clip), *out, *arguments])
    assert called.exit_code != 0, called.output
    assert message in str(called.output) + str(called.exception)
