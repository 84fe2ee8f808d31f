"""Tuning to a lexicon: a network goes on from its graph, is judged on words held back, and stays out if it is worse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from click.testing import CliRunner

from clothes import without
from conftest import GOLDEN
from signing import word
from signsplice import lexicon
from signsplice.cli import app
from signsplice.errors import InputError, SignspliceError
from signsplice.motion.clip import concatenate
from signsplice.rig.canonical import canonical_motion
from signsplice.splicing import features
from signsplice.splicing.bundle import read_facts, read_file, write_bundle
from signsplice.splicing.learned import LearnedTransition, open_sessions
from signsplice.splicing.transition import find_transition
from signsplice.train.export import ExportGraph, compare
from signsplice.train.product import tuning
from training_toys import ALONE

TINY = GOLDEN / "tiny_bundle"
GLOSSES = ("HELLO", "DEAF", "SIGN", "YOU", "SEE", "MOTHER", "BOOK", "I", "THANK-YOU", "GOOD", "WATER", "HOUSE")


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tuning") / "lex"
    with lexicon.building(folder) as builder:
        for gloss in GLOSSES:
            builder.add(word(gloss).clip, gloss)
    return Path(folder)


@pytest.fixture(scope="module")
def mine(words: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[tuning.Tuned, Path]:
    """A bundle whose random weights have been tuned, and what came of it."""
    out: Path = tmp_path_factory.mktemp("tuned") / "mine"
    return tuning.make(tuning.Tuning(60, 8, 3e-3), words, TINY, out, ALONE), out


def test_a_network_begins_where_its_graph_is() -> None:
    facts = read_facts(TINY)
    content = read_file(TINY, facts, "bridge.onnx")
    network = tuning.begun(facts, content, TINY)
    clips = [word("HELLO").clip, word("DEAF").clip]
    seen = [tuning.ClipGapDataset(clips, 0, 4).batch(rows) for rows in ([0, 1], [2], [3])]
    given = [{"tokens": batch.tokens, "mask": batch.mask} for batch in seen]
    compare("bridge", ExportGraph(network.eval(), given[0], ("turns",), {}, tuple(given[1:])), content)
    network.out.bias.data.add_(0.1)
    with pytest.raises(SignspliceError, match="differ in turns"):
        compare("bridge", ExportGraph(network, given[0], ("turns",), {}, tuple(given[1:])), content)


FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
LACKING: dict[str, tuple[str, ...]] = {
    "nothing": ("?",),
    "fingers": FINGERS,
    "the middle finger": ("Middle",),
    "the left hand's fingers": tuple(f"LeftHand{finger}" for finger in FINGERS),
    "all but the index": tuple(finger for finger in FINGERS if finger != "Index"),
    "collar bones": ("Shoulder",),
    "last finger joints": ("3",),
    "a head": ("Head",),
    "some of the spine": ("Spine1",),
}


@pytest.mark.parametrize("lacking", LACKING)
def test_a_rig_that_lacks_joints_teaches_what_it_will_be_shown(lacking: str) -> None:
    clip = without(word("DEAF").clip, *LACKING[lacking])
    seen = tuning.ClipGapDataset([clip], 0)
    ((part,),) = seen.parts
    one = seen._seen(part, part.sentences[0][20:46], 8, 10)
    before, after = clip[20:28], clip[38:46]
    base = find_transition("hermite").between(before, after, 10)
    own = features.gap_features(canonical_motion(concatenate([before, base, after])), 8, 10)
    assert np.isfinite(one["tokens"]).all()
    np.testing.assert_allclose(one["tokens"], own.tokens, atol=2e-4)


def test_what_teaches_is_not_judged(words: Path) -> None:
    learned, held = tuning.split(words)
    assert len(learned) + len(held) == len(GLOSSES)
    assert len(held) == 3
    assert not {clip.name for clip in learned} & {clip.name for clip in held}


def test_a_better_network_is_written_and_runs(words: Path, mine: tuple[tuning.Tuned, Path]) -> None:
    outcome, out = mine
    assert outcome.after < outcome.before, "random weights leave much to be learned"
    assert outcome.better
    facts = read_facts(out)
    assert facts["networks"]["transition"]["tuned"]["scores"]["error"] == outcome.after
    assert facts["networks"]["cutter"] == read_facts(TINY)["networks"]["cutter"]
    assert facts["files"]["cut.onnx"] == read_facts(TINY)["files"]["cut.onnx"]
    made = LearnedTransition(open_sessions(out)).between(word("SEE").clip[:20], word("SEE").clip[30:], 10)
    assert len(made) == 10
    again = tuning.make(tuning.Tuning(60, 8, 3e-3), words, TINY, out, ALONE)
    assert again == outcome, "what is tuned is not tuned again"


def test_a_worse_network_is_not_kept(words: Path, mine: tuple[tuning.Tuned, Path], tmp_path: Path) -> None:
    out = tmp_path / "worse"
    outcome = tuning.make(tuning.Tuning(6, 8, 0.5), words, mine[1], out, ALONE)
    assert not outcome.better
    assert not out.exists()


def test_the_command_tells_what_came_of_it(words: Path, tmp_path: Path) -> None:
    call = ["train", "transition", "--lexicon", str(words), "--from", str(TINY), "--out", str(tmp_path / "b")]
    told = CliRunner().invoke(app, [*call, "--steps", "2", "--device", "cpu"], catch_exceptions=False)
    assert told.stdout.startswith("9 words taught; error on 3 held back, arm / 1000: ")
    assert told.stdout.splitlines()[1].startswith(f"{tmp_path / 'b'}: ")


def test_what_cannot_be_tuned_is_refused(words: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    for call, said in (
        ([], "expected --signing DIR, to train anew, or --lexicon DIR, to tune"),
        (["--lexicon", str(words), "--from", str(tmp_path / "none")], "none/bundle.json: no such file"),
    ):
        with pytest.raises(InputError, match=said):
            runner.invoke(
                app, ["train", "transition", "--out", str(tmp_path / "b"), *call],
                catch_exceptions=False, standalone_mode=False,
            )  # fmt: skip
    with lexicon.building(tmp_path / "few") as builder:
        builder.add(word("HELLO").clip, "HELLO")
    with pytest.raises(InputError, match=r"1 of 1 words can teach .* expected at least 10"):
        tuning.split(tmp_path / "few")
    facts = read_facts(TINY)
    content = read_file(TINY, facts, "bridge.onnx")
    with pytest.raises(InputError, match=r"holds no weights named embedding\.weight"):
        tuning.begun(facts, content.replace(b"embedding.weight.T", b"embedding.weight_T"), TINY)
    del facts["networks"]["transition"]["config"]
    bare = tmp_path / "bare"
    bare.mkdir()
    files = {name: (TINY / name).read_bytes() for name in facts["files"]}
    write_bundle(bare, {k: v for k, v in facts.items() if k != "files"}, files)
    with pytest.raises(InputError, match="says no sizes of its transition network"):
        tuning.make(tuning.Tuning(1), words, bare, tmp_path / "b", ALONE)
    assert not (tmp_path / "b").exists()
