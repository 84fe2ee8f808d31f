"""The protocol: the pairs, refusals, fake systems with known scores, and classical rows with golden scores."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice_paper import (
    baselines,
    bundles,
    clip_methods,
    judging,
    kept_frames,
    metrics,
    protocol,
    published,
    viewed,
)
from signsplice_paper.clip_methods import ClipAnswers, ClipMethod
from signsplice_paper.prediction import Prediction
from signsplice_paper.results import Results
from signsplice_paper.systems import open_bundle
from signsplice_workshop.corpora import readable_pairs
from signsplice_workshop.corpora.pairs import Pairs
from toys import GOLDEN, Fake, corpus, golden, write_bundle

SPLITS = protocol.SPLITS[:3]
"""The splits of the toy corpora."""


def judge(pairs: Pairs, opener: judging.Opener = open_bundle, known: Results | None = None) -> judging.Judge:
    """A judge without progress bars."""
    return judging.Judge(pairs, known or Results(), lambda _: nullcontext(), opener)


def scores_of(**errors: Any) -> dict[str, float]:
    pairs = corpus()
    system = Fake(pairs, **errors)
    return protocol.judge(protocol.make_answer(pairs, system), pairs, protocol.choose(pairs, "random")).scores


def test_the_truth_has_perfect_scores() -> None:
    found = scores_of()
    for name in ("pta", "paa", "paa_all", "length_exact", "bleu-1", "papineni-1", "bleu-4_bones"):
        assert found[name] == 1.0, name
    assert found["accuracy"] == pytest.approx(1.0)
    assert found["mse"] == pytest.approx(0.0, abs=1e-12)
    assert found["motion_ratio"] == pytest.approx(1.0)
    assert found["bone_change"] < 1e-4
    assert 0.0 < found["ms_median"] <= 1000.0
    assert found["ms_mean"] > 0.0


def test_every_error_lowers_its_own_scores() -> None:
    off = scores_of(off=0.01)
    assert off["accuracy"] == pytest.approx(0.99)
    mean = np.mean([corpus().index[k, 5] for k in corpus().split("random", "test")])
    assert off["mse"] == pytest.approx(1e-4 * mean)
    assert off["bleu-1@2e-05"] == 0.0
    assert off["bleu-1@0.0003"] == 1.0
    longer = scores_of(longer=1)
    assert longer["accuracy"] == pytest.approx(1.0 - metrics.SIGMA)
    assert longer["mse"] == pytest.approx(metrics.VISIBLE)
    assert longer["length_exact"] == 0.0
    assert scores_of(longer=-1)["papineni-1"] < 1.0, "the brevity penalty applies"
    assert scores_of(longer=-1)["bleu-1"] == 1.0, "the paper has none"
    shifted = scores_of(late=1)
    assert (shifted["pta"], shifted["paa"], shifted["positions_off"]) == (1.0, 0.0, 0.5)
    silent = scores_of(silent=True)
    assert (silent["pta"], silent["paa_all"], silent["bleu-1"]) == (0.0, 0.0, 1.0)
    assert np.isnan(silent["velocity_jump"])


def test_a_system_without_rotations_gets_a_second_score_with_bones_kept() -> None:
    pairs = corpus()
    chosen = protocol.choose(pairs, "random")
    noise = np.random.default_rng(0).normal(size=(100, 159)) * 0.02
    system = Fake(pairs)

    def shaken(number: int) -> Prediction:
        made = protocol.make_answer(pairs, system)(number)
        return replace(made, frames=made.frames + noise[: len(made.frames)])

    found = protocol.judge(shaken, pairs, chosen).scores
    assert {name.removesuffix("_bones") for name in found if name.endswith("_bones")} == set(
        protocol.SCORES_WITH_BONES_KEPT
    )
    assert found["bone_change"] > 0.1
    assert found["bone_change_bones"] < 1e-4
    assert found["accuracy_bones"] != found["accuracy"]
    on_clips = protocol.judge(ClipAnswers(pairs, ClipMethod("ends", "slerp")), pairs, chosen).scores
    assert not any(name.endswith("_bones") for name in on_clips), "a method on clips keeps them anyway"
    assert on_clips["bone_change"] < 1e-4


def test_a_fixed_choice_of_many_pairs_is_put_onto_a_skeleton(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = corpus()
    chosen = protocol.choose(pairs, "random", "train")
    answer = protocol.make_answer(pairs, Fake(pairs, off=0.01))
    whole = protocol.judge(answer, pairs, chosen).scores
    looked_at: list[int] = []
    view = viewed.Viewer.view

    def spied(self: viewed.Viewer, number: int, *more: Any) -> viewed.PairView:
        looked_at.append(number)
        return view(self, number, *more)

    monkeypatch.setattr(viewed.Viewer, "view", spied)
    monkeypatch.setattr(viewed, "N_VIEWED", 2)
    some = [protocol.judge(answer, pairs, chosen) for _ in range(2)]
    assert len(looked_at) == 8, "as it is and with bones kept, of two pairs, twice"
    assert looked_at[:4] == looked_at[4:]
    assert {judged.n_pairs for judged in some} == {len(chosen.pair_numbers)}
    assert some[0].scores["accuracy"] == whole["accuracy"], "of all pairs"


def test_the_choice_of_pairs_is_fixed_and_in_the_signature() -> None:
    pairs = corpus()
    whole = protocol.choose(pairs, "random", "train")
    some = protocol.choose(pairs, "random", "train", limit=4)
    assert len(some.pair_numbers) == 4
    assert set(some.pair_numbers) < set(whole.pair_numbers)
    assert some == protocol.choose(pairs, "random", "train", limit=4)
    assert some.signature != whole.signature
    assert pairs.head["hash"] in some.signature
    assert [p.split for p in judge(pairs).choose_protocols()] == list(SPLITS)
    assert set(protocol.SPLITS) - set(SPLITS) == {"unseen-both"}, "which this corpus has not"
    assert protocol.choose(pairs, "unseen-signer").pair_numbers == tuple(pairs.split("unseen-signer", "test"))
    with pytest.raises(InputError, match="no split other test"):
        protocol.choose(pairs, "other")
    with pytest.raises(InputError, match="no pair in unseen-words valid"):
        protocol.choose(pairs, "unseen-words", "valid")


def test_a_bundle_is_judged_only_on_pairs_that_are_new_to_it() -> None:
    pairs = corpus()
    source = {"corpus": pairs.head["hash"], "split": "random"}
    random, words, signer = (protocol.choose(pairs, split) for split in SPLITS)
    protocol.check_allowed(source, pairs, random)
    protocol.check_allowed(source, pairs, signer)
    protocol.check_allowed({**source, "split": "unseen-signer"}, pairs, random)
    assert not protocol.may_judge({**source, "split": "unseen-words"}, pairs, random)
    with pytest.raises(InputError, match="b: trained on corpus other, judged on"):
        protocol.check_allowed({**source, "corpus": "other"}, pairs, random, "b")
    with pytest.raises(
        InputError, match="trained on split random, and 1 of the 1 pairs of unseen-words test were seen"
    ):
        protocol.check_allowed(source, pairs, words)
    with pytest.raises(InputError, match="states no split"):
        protocol.check_allowed({"corpus": pairs.head["hash"]}, pairs, random)
    with pytest.raises(InputError, match="no split other train"):
        protocol.check_allowed({**source, "split": "other"}, pairs, random)


def test_what_was_taught_on_many_words_is_judged_on_a_corpus_whose_truth_can_be_read() -> None:
    pairs = copy(corpus())
    source = {"corpus": "another", "split": readable_pairs.TAUGHT}
    assert not any(protocol.may_judge(source, pairs, protocol.choose(pairs, split)) for split in SPLITS)
    pairs.truth_kind = readable_pairs.TRUTH
    assert all(protocol.may_judge(source, pairs, protocol.choose(pairs, split)) for split in SPLITS)
    other = protocol.choose(pairs, "random")
    assert not protocol.may_judge({"corpus": "another", "split": "random"}, pairs, other)


@pytest.mark.parametrize(
    ("prediction", "message"),
    [
        (Prediction(1, 1, np.zeros((3, 9))), "predicted frames"),
        (Prediction(1, 1, np.full((3, 159), np.nan)), "predicted frames"),
        (Prediction(-1, 1, np.zeros((3, 159))), "predicted pre -1"),
        (Prediction(1, 10_000, np.zeros((3, 159))), "predicted post 10000"),
    ],
)
def test_invalid_predictions_are_refused(prediction: Prediction, message: str) -> None:
    with pytest.raises(InputError, match=message):
        protocol.judge(lambda _: prediction, corpus(), protocol.choose(corpus(), "random"))


def test_methods_use_no_more_of_the_truth_than_they_are_given() -> None:
    pairs = corpus()
    number = pairs.split("random", "test")[0]
    pre, post, true = pairs.truth(number)
    both = ClipAnswers(pairs, ClipMethod("true-positions", "hermite", "positions and length"))(number)
    assert (both.pre, both.post, len(both.frames)) == (pre, post, len(true))
    nothing = ClipAnswers(pairs, ClipMethod("pose-velocity", "slerp"))(number)
    length = ClipAnswers(pairs, ClipMethod("pose-velocity", "slerp", "length"))(number)
    assert (nothing.pre, nothing.post) == (length.pre, length.post)
    assert len(length.frames) == len(true)
    assert np.abs(nothing.frames).max() <= 0.5
    with pytest.raises(InputError, match="given 'positions'"):
        ClipMethod("ends", "slerp", "positions")
    with pytest.raises(InputError, match="no cutter 'nothing'"):
        ClipMethod("nothing", "slerp")
    names = [(method.name, method.given) for method in clip_methods.list_methods()]
    assert len(set(names)) == len(names) == 4
    assert set(kept_frames.SHOWN_METHODS) <= set(names)


def test_classical_rows_have_the_golden_scores() -> None:
    pairs = golden()
    rows = json.loads((GOLDEN / "paper_rows.json").read_text())
    assert len(rows) == 20
    for row in rows:
        cutter, transition = row["system"].split("+")
        answer = ClipAnswers(pairs, ClipMethod(cutter, transition, row["told"]))
        found = protocol.judge(answer, pairs, protocol.choose(pairs, "random")).scores
        for name in ("accuracy", "mse", "bleu-1", "bleu-2", "bleu-3", "bleu-4", "pta", "paa"):
            now = name.replace("bleu", "papineni")
            assert found[now] == pytest.approx(row[name], rel=1e-6, abs=1e-9), (row["system"], row["told"], name)


RIDGES = ("commonest-cut+ridge", "mean-cut+ridge", "true-positions+ridge", "lpt-plus-positions+ridge")


def test_methods_and_bundles_become_rows_curves_and_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baselines, "Ridge", partial(baselines.Ridge, fr=1))  # fitted in no time
    pairs = corpus()
    folder = write_bundle(tmp_path / "lpt-plus", pairs)
    write_bundle(tmp_path / "other", pairs, scale="cpu")
    config, _ = bundles.read_all(tmp_path)
    assert config.path.parent == folder
    assert bundles.read_all(tmp_path / "nowhere") == []
    opened: list[Path] = []

    def opener(path: Path) -> Fake:
        opened.append(path)
        return Fake(pairs, off=0.001)

    cutter, transition = kept_frames.HERMITE[0].split("+")
    method = ClipMethod(cutter, transition, kept_frames.HERMITE[1])
    made = list(judge(pairs, opener).judge_all([method], [config], []))
    rows = [row for judgement in made for row in judgement.rows]
    assert [(row.system, row.split) for row in rows] == [
        *(("mean-transition", split) for split in SPLITS if pairs.split(split, "train")),
        *(
            (name, split)
            for split in SPLITS
            for name in ("truth", "signsplice", *(RIDGES if pairs.split(split, "train") else ()))
            if (name, split) != ("lpt-plus-positions+ridge", "unseen-words")
        ),
        *((method.name, split) for split in SPLITS),
        ("lpt-plus", "random"),
        ("lpt-plus", "unseen-signer"),
    ]
    assert rows[-1].score("paa_train") == 1.0
    assert rows[-1].score("accuracy_valid") == pytest.approx(0.999)
    assert (rows[-1].truth, rows[-1].taught, rows[-1].condition) == ("partner", "", published.EQUAL)
    assert rows[-1].bundle == bundles.compute_short_hash(config)
    assert rows[-1].fr == 8
    assert rows[-1].score("accuracy") == pytest.approx(0.999)
    (curve,) = made[-1].curves
    assert curve.column("pairs") == [320.0, 640.0, 960.0, 1280.0]
    assert curve.column("accuracy") == pytest.approx([0.849, 0.899, 0.949, 0.999])
    for pair in made[-1].figure_pairs:
        assert {name.split("/")[2] for name in pair.made} == {method.name, "lpt-plus"}
        assert np.allclose(
            pair.made[kept_frames.make_label("lpt-plus", "smoke", "adamw")], pair.truth + 0.001, atol=1e-6
        )
    known = Results().merge(rows)
    repeated = list(judge(pairs, opener, known).judge_all([method], [config], made[-1].figure_pairs))
    assert [judgement.rows for judgement in repeated] == [(), (), (), ()], "known rows are not judged again"
    assert opened == [folder] * 3, "for the positions of two splits, and once to be judged"
    forced = list(replace(judge(pairs, opener, known), rejudge=True).judge_all([], [config], made[-1].figure_pairs))
    assert len(forced[1].rows) == 2


def test_a_row_names_the_training_corpus_and_the_condition_of_a_bundle(tmp_path: Path) -> None:
    pairs = copy(corpus())
    pairs.truth_kind = readable_pairs.TRUTH
    write_bundle(tmp_path / "many", pairs, corpus="another", split=readable_pairs.TAUGHT)
    plain = {"spsn-printed": {"plain_loss": True}, "tfgn": {"plain_loss": False}}
    write_bundle(tmp_path / "plain", pairs, system="lptransformer-printed", parts=plain)
    how = replace(judge(pairs, lambda _: Fake(pairs)), splits=("random",))
    _, many, printed = how.judge_all([], bundles.read_all(tmp_path), [])
    assert [(row.taught, row.corpus, row.condition) for row in (*many.rows, *printed.rows)] == [
        ("another", pairs.head["hash"], published.EQUAL),
        ("", pairs.head["hash"], published.AS_PRINTED),
    ]
    (row,) = many.rows
    assert "accuracy" in row.scores
    assert "paa_train" not in row.scores, "it learned from none of these pairs"
    assert {name for pair in many.figure_pairs for name in pair.made} == set(), "figures show what was taught here"


def test_a_bundle_of_another_corpus_stops_the_judging(tmp_path: Path) -> None:
    write_bundle(tmp_path / "lpt-plus", corpus(), corpus="other")
    with pytest.raises(InputError, match="lpt-plus: trained on corpus other"):
        list(judge(corpus()).judge_all([], bundles.read_all(tmp_path), []))
    shutil.rmtree(tmp_path / "lpt-plus")
    folder = write_bundle(tmp_path / "bare", corpus(), seed=1)
    contents = json.loads((folder / "bundle.json").read_text())
    del contents["optimiser"]
    (folder / "bundle.json").write_text(json.dumps(contents))
    with pytest.raises(InputError, match=r"bundle.json: has no 'optimiser'"):
        list(judge(corpus()).judge_all([], bundles.read_all(tmp_path), []))
    (folder / "bundle.json").write_text("{")
    with pytest.raises(InputError, match="is no JSON"):
        bundles.read_all(tmp_path)
