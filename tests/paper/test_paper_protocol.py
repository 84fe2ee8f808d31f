"""Who is judged on what: the pairs, refusals, fakes with known scores, and classical rows beside golden ones."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toys import GOLDEN, Fake, corpus, golden, write_bundle

from signsplice.errors import InputError
from signsplice.paper import clip_methods, judging, kept_frames, metrics, protocol, results
from signsplice.paper.clip_methods import ClipAnswers, ClipMethod
from signsplice.paper.prediction import Prediction


def quiet(_: str) -> AbstractContextManager[None]:
    return nullcontext()


def scores_of(**errors: Any) -> dict[str, float]:
    pairs = corpus()
    system = Fake(pairs, **errors)
    return protocol.judge(protocol.answers(pairs, system), pairs, protocol.choose(pairs, "random")).scores


def test_the_truth_scores_best() -> None:
    found = scores_of()
    for name in ("pta", "paa", "paa_all", "length_exact", "bleu-1", "ngram-1"):
        assert found[name] == 1.0, name
    assert found["accuracy"] == pytest.approx(1.0)
    assert found["mse"] == pytest.approx(0.0, abs=1e-12)
    assert found["motion_ratio"] == pytest.approx(1.0)
    assert 0.0 < found["ms_median"] <= 1000.0
    assert found["ms_mean"] > 0.0


def test_errors_are_seen_where_they_are_made() -> None:
    off = scores_of(off=0.01)
    assert off["accuracy"] == pytest.approx(0.99)
    mean = np.mean([corpus().index[k, 5] for k in corpus().split("random", "test")])
    assert off["mse"] == pytest.approx(1e-4 * mean)
    assert off["bleu-1@5e-05"] == 0.0
    assert off["bleu-1@0.0003"] == 1.0
    longer = scores_of(longer=1)
    assert longer["accuracy"] == pytest.approx(1.0 - metrics.SIGMA)
    assert longer["mse"] == pytest.approx(metrics.VISIBLE)
    assert longer["length_exact"] == 0.0
    assert scores_of(longer=-1)["bleu-1"] < 1.0, "brevity"
    late = scores_of(late=1)
    assert (late["pta"], late["paa"], late["positions_off"]) == (1.0, 0.0, 0.5)
    silent = scores_of(silent=True)
    assert (silent["pta"], silent["paa_all"], silent["bleu-1"]) == (0.0, 0.0, 1.0)
    assert np.isnan(silent["velocity_jump"])


def test_pairs_are_chosen_once_and_signed() -> None:
    pairs = corpus()
    whole = protocol.choose(pairs, "random", "train")
    some = protocol.choose(pairs, "random", "train", limit=4)
    assert len(some.numbers) == 4
    assert set(some.numbers) < set(whole.numbers)
    assert some == protocol.choose(pairs, "random", "train", limit=4)
    assert some.signature != whole.signature
    assert pairs.head["hash"] in some.signature
    assert {p.split for p in judging.splits(pairs)} == set(protocol.SPLITS)
    assert protocol.choose(pairs, "unseen-signer").numbers == tuple(pairs.split("unseen-signer", "test"))
    with pytest.raises(InputError, match="no split other test"):
        protocol.choose(pairs, "other")
    with pytest.raises(InputError, match="no pair in unseen-words valid"):
        protocol.choose(pairs, "unseen-words", "valid")


def test_a_bundle_is_judged_only_on_pairs_it_did_not_learn_from() -> None:
    pairs = corpus()
    own = {"corpus": pairs.head["hash"], "split": "random"}
    random, words, signer = (protocol.choose(pairs, split) for split in protocol.SPLITS)
    protocol.refuse(own, pairs, random)
    protocol.refuse(own, pairs, signer)
    protocol.refuse({**own, "split": "unseen-signer"}, pairs, random)
    assert not protocol.may_judge({**own, "split": "unseen-words"}, pairs, random)
    with pytest.raises(InputError, match="b: trained on corpus other, judged on"):
        protocol.refuse({**own, "corpus": "other"}, pairs, random, "b")
    with pytest.raises(
        InputError, match="trained on split random, and 1 of the 1 pairs of unseen-words test were seen"
    ):
        protocol.refuse(own, pairs, words)
    with pytest.raises(InputError, match="says no split"):
        protocol.refuse({"corpus": pairs.head["hash"]}, pairs, random)
    with pytest.raises(InputError, match="no split other train"):
        protocol.refuse({**own, "split": "other"}, pairs, random)


@pytest.mark.parametrize(
    ("prediction", "says"),
    [
        (Prediction(1, 1, np.zeros((3, 9))), "predicted frames"),
        (Prediction(1, 1, np.full((3, 159), np.nan)), "predicted frames"),
        (Prediction(-1, 1, np.zeros((3, 159))), "predicted pre -1"),
        (Prediction(1, 10_000, np.zeros((3, 159))), "predicted post 10000"),
    ],
)
def test_what_is_no_prediction_is_refused(prediction: Prediction, says: str) -> None:
    with pytest.raises(InputError, match=says):
        protocol.judge(lambda _: prediction, corpus(), protocol.choose(corpus(), "random"))


def test_classical_rows_are_told_what_they_say() -> None:
    pairs = corpus()
    number = pairs.split("random", "test")[0]
    pre, post, true = pairs.truth(number)
    told = ClipAnswers(pairs, ClipMethod("true-positions", "hermite", "positions and length"))(number)
    assert (told.pre, told.post, len(told.frames)) == (pre, post, len(true))
    own = ClipAnswers(pairs, ClipMethod("pose-velocity", "slerp"))(number)
    length = ClipAnswers(pairs, ClipMethod("pose-velocity", "slerp", "length"))(number)
    assert (own.pre, own.post) == (length.pre, length.post)
    assert len(length.frames) == len(true)
    assert np.abs(own.frames).max() <= 0.5
    with pytest.raises(InputError, match="told 'positions'"):
        ClipMethod("ends", "slerp", "positions")
    with pytest.raises(InputError, match="no cutter 'nothing'"):
        ClipMethod("nothing", "slerp")
    names = [(method.name, method.given) for method in clip_methods.classical()]
    assert len(set(names)) == len(names) == 20
    assert kept_frames.HERMITE in names


def test_classical_rows_score_what_the_golden_ones_do() -> None:
    pairs = golden()
    rows = json.loads((GOLDEN / "paper_rows.json").read_text())
    assert len(rows) == 20
    for row in rows:
        cutter, transition = row["system"].split("+")
        answer = ClipAnswers(pairs, ClipMethod(cutter, transition, row["told"]))
        found = protocol.judge(answer, pairs, protocol.choose(pairs, "random")).scores
        for name in ("accuracy", "mse", "bleu-1", "bleu-2", "bleu-3", "bleu-4", "pta", "paa"):
            assert found[name] == pytest.approx(row[name], rel=1e-6, abs=1e-9), (row["system"], row["told"], name)


def test_bundles_and_classical_rows_become_rows_curves_and_shots(tmp_path: Path) -> None:
    pairs = corpus()
    folder = write_bundle(tmp_path / "lpt", pairs)
    write_bundle(tmp_path / "other", pairs, scale="cpu")
    assert judging.find_bundles(tmp_path, "smoke") == [folder]
    assert judging.find_bundles(tmp_path / "nowhere", "smoke") == []
    opened: list[tuple[Path, str]] = []

    def opener(path: Path, decoding: str) -> Fake:
        opened.append((path, decoding))
        return Fake(pairs, off=0.001)

    cutter, transition = kept_frames.HERMITE[0].split("+")
    method = ClipMethod(cutter, transition, kept_frames.HERMITE[1])
    made = list(judging.everything(pairs, [folder], results.Results(), [], quiet, opener, methods=[method]))
    rows = [row for judgement in made for row in judgement.rows]
    assert [(row.system, row.split) for row in rows] == [
        *((method.name, split) for split in protocol.SPLITS),
        ("lpt", "random"),
        ("lpt", "unseen-signer"),
        ("lpt-one-pass", "random"),
        ("lpt-one-pass", "unseen-signer"),
    ]
    assert rows[-1].bundle == results.bundle_hash(folder)
    assert rows[-1].fr == 8
    assert rows[-1].score("accuracy") == pytest.approx(0.999)
    (curve,) = made[-1].curves
    assert curve.points == [(0.0, 0.9), (5.0, 0.905), (10.0, 0.91), (15.0, 0.915)]
    for shot in made[-1].shots:
        assert {name.split("/")[2] for name in shot.made} == {method.name, "lpt"}
        assert np.allclose(shot.made[kept_frames.label("lpt", "smoke", "adamw")], shot.truth + 0.001, atol=1e-6)
    known = results.Results().merged(rows)
    again = list(judging.everything(pairs, [folder], known, made[-1].shots, quiet, opener, methods=[method]))
    assert [judgement.rows for judgement in again] == [(), ()], "what is known is not judged twice"
    assert opened == [(folder, "one-by-one"), (folder, "parallel")]
    anew = list(judging.everything(pairs, [folder], known, made[-1].shots, quiet, opener, again=True, methods=[]))
    assert len(anew[0].rows) == 4


def test_a_bundle_of_another_corpus_stops_the_judging(tmp_path: Path) -> None:
    folder = write_bundle(tmp_path / "lpt", corpus(), corpus="other")
    with pytest.raises(InputError, match="lpt: trained on corpus other"):
        list(judging.everything(corpus(), [folder], results.Results(), [], quiet, methods=[]))
    folder = write_bundle(tmp_path / "bare", corpus(), seed=1)
    facts = json.loads((folder / "bundle.json").read_text())
    del facts["optimiser"]
    (folder / "bundle.json").write_text(json.dumps(facts))
    with pytest.raises(InputError, match=r"bundle.json: has no 'optimiser'"):
        list(judging.everything(corpus(), [folder], results.Results(), [], quiet, methods=[]))
    (folder / "bundle.json").write_text("{")
    with pytest.raises(InputError, match="is no JSON"):
        judging.facts(folder)
