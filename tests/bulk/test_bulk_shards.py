"""Shards: what they hold, that they are the same whoever makes them, and that every row can be made again."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tarfile
import threading
from collections.abc import Iterable, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import signsplice as ss
from bulk_kills import read_folder
from signing import marked
from signsplice import lexicon
from signsplice.bulk import recipes, run
from signsplice.bulk.job import BulkJob, BulkOptions, prepare, progress_path, read_job
from signsplice.bulk.maker import FailedSentence, MadeSentence, SentenceMaker, motion_sha256
from signsplice.bulk.recipes import SentenceRecipe
from signsplice.bulk.shards import ShardResult, make_shard, poses
from signsplice.errors import FormatError, InputError
from signsplice.formats import npz
from signsplice.formats.json_files import read_json
from signsplice.lexicon.lexicon import SHIPPED
from signsplice.motion import Clip, rotation
from signsplice.motion.kinematics import forward
from signsplice.rig.info import rig_info
from signsplice.splicing import report as reports
from signsplice.splicing.engine import splice
from signsplice.splicing.faces import RULES

QUICK = {"cutter": "pose-velocity", "transition": "hermite", "transition_time": "tempo"}
ROWS = [
    SentenceRecipe(("HELLO", "I", "DEAF")),
    SentenceRecipe(("YES", "NO"), sign_speed=1.2, **QUICK),  # type: ignore[arg-type]
    SentenceRecipe(("YES", "NOTHING-LIKE-THIS-你"), **QUICK),  # type: ignore[arg-type]
    SentenceRecipe(("fs-ANN", "fs-A", "I"), **QUICK),  # type: ignore[arg-type]
    SentenceRecipe(("YES", "NO"), sign_speed=99.0),
]
OPTIONS = BulkOptions(str(SHIPPED), shard_size=2)


def job_of(out: Path, rows: Iterable[SentenceRecipe] = ROWS, **options: object) -> BulkJob:
    batch = recipes.batch_of(rows)
    return prepare(out, replace(OPTIONS, **options), lambda: [batch])  # type: ignore[arg-type]


def make(out: Path, job: BulkJob, order: Iterable[int] | None = None) -> None:
    (out / "index").mkdir(exist_ok=True)
    for shard in range(job.n_shards) if order is None else order:
        make_shard(str(out), shard, 8)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, BulkJob]:
    out = tmp_path_factory.mktemp("bulk") / "out"
    job = job_of(out)
    make(out, job)
    return out, job


def index(out: Path) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = pq.read_table(out / "index").sort_by("row").to_pylist()
    return rows


def test_a_row_of_the_index_says_what_became_of_each_recipe(made: tuple[Path, BulkJob]) -> None:
    rows = index(made[0])
    assert [row["row"] for row in rows] == [0, 1, 2, 3, 4]
    assert [tuple(row["glosses"]) for row in rows] == [row.glosses for row in ROWS]  # type: ignore[arg-type]
    errors = [row["error"] for row in rows]
    assert errors[0] is errors[1] is errors[3] is None
    assert "NOTHING-LIKE-THIS" in str(errors[2])
    assert errors[4] == "sign speed 99, expected 0.1 to 10"
    assert all(row["motion_sha256"] is None and row["n_bytes"] is None for row in rows if row["error"])
    assert [row["seams"] for row in rows] == [2, 1, None, 4, None]
    summary = run.summarize(*made)
    assert (summary.n_recipes, summary.n_shards, summary.n_failed, summary.n_seams) == (5, 3, 2, 7)
    assert summary.reasons == {error: 1 for error in errors if error}


def test_a_sample_holds_the_clip_its_report_poses_and_annotations(made: tuple[Path, BulkJob]) -> None:
    out, _ = made
    with lexicon.open_shipped_lexicon() as words, tarfile.open(out / "shard-000000.tar") as tar:
        alone = ss.splice([ss.Word(words.clip(gloss), owns=words.owns(gloss)) for gloss in ROWS[0].glosses])
        files = {name: tar.extractfile(name).read() for name in tar.getnames()}  # type: ignore[union-attr]
        assert {(m.mtime, m.uid, m.gid, m.uname, m.mode) for m in tar.getmembers()} == {(0, 0, 0, "", 0o644)}
    row = index(out)[0]
    with (out / "shard-000000.tar").open("rb") as stored:
        stored.seek(row["offset"])  # type: ignore[arg-type]
        assert stored.read(row["n_bytes"]) == files["000000000.npz"]  # type: ignore[arg-type]
    clip = npz.parse(files["000000000.npz"])
    assert np.array_equal(clip.local_rotations, alone.clip.local_rotations)
    assert motion_sha256(clip) == row["motion_sha256"] == motion_sha256(alone.clip)
    report = json.loads(files["000000000.json"])
    expected = json.loads(json.dumps(reports.describe(alone)))
    assert all(report[key] == expected[key] for key in expected if key != "timing_ms")
    assert report["recipe"]["glosses"] == ["HELLO", "I", "DEAF"]
    assert report["timing_ms"] == {}
    head = np.load(BytesIO(files["000000000.pose.upper_pose.npy"]))[:, 0]
    assert head.shape == (len(clip), 3)
    assert 1.3 < head[:, 1].mean() < 1.8
    signs = json.loads(files["000000000.annotations.both_hands.json"])
    spans = [span for span in expected["spans"] if span["kind"] == "sign"]
    assert [(row["lemma"], row["start_frame"], row["end_frame"] + 1) for row in signs] == [
        (span["name"], *span["output"]) for span in spans
    ]
    assert files["000000000.signer.txt"].decode() == "standard"


def test_bytes_do_not_depend_on_order_or_on_what_was_there(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    out = tmp_path / "out"
    job = job_of(out)
    (out / "index").mkdir()
    (out / "shard-000001.tar").write_bytes(b"of a run that was killed")
    make(out, job, [2, 1, 0])
    assert read_folder(out) == read_folder(made[0])


def test_a_run_makes_only_what_is_missing_or_not_whole(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(made[0], out)
    whole = read_folder(out)
    (out / "index" / "000000.parquet").unlink()
    (out / "shard-000002.tar").write_bytes(whole["shard-000002.tar"][:-512])
    (out / "summary.json").write_text("of the files that are missing now")
    states: list[run.RunProgress] = []

    def advance(state: run.RunProgress) -> None:
        states.append(state)
        assert len(states) == 1 or not (out / "summary.json").exists()

    summary = run.run(out, OPTIONS, lambda: [recipes.batch_of(ROWS)], workers=1, advance=advance)
    assert (states[0].n_before, states[0].n_done, states[-1].n_done, states[-1].n_failed) == (2, 2, 5, 1)
    found = read_folder(out)
    assert json.loads(found.pop("summary.json"))["n_failed"] == summary.n_failed == 2
    assert found == whole


def test_progress_counts_the_rows_of_shards_that_are_not_whole(
    made: tuple[Path, BulkJob], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    shutil.copytree(made[0], out)
    (out / "index" / "000000.parquet").unlink()
    progress_path(out, 0).write_text("2 rows of a call that was killed")

    def made_slowly(*_: object) -> Iterator[ShardResult | None]:
        yield None
        progress_path(out, 0).write_text("1")
        yield None
        progress_path(out, 0).unlink()
        yield None
        yield make_shard(str(out), 0, 8)

    monkeypatch.setattr(run, "_make_shards", made_slowly)
    done: list[int] = []
    run.run(out, OPTIONS, lambda: [recipes.batch_of(ROWS)], advance=lambda state: done.append(state.n_done))
    assert done == [3, 3, 4, 4, 5]
    assert not list(out.rglob(".*"))


def test_rounded_samples_are_smaller_and_nearly_the_same(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    out, job = tmp_path / "out", job_of(tmp_path / "out", format="npz32")
    make(out, job, [0])
    with tarfile.open(made[0] / "shard-000000.tar") as exact, tarfile.open(out / "shard-000000.tar") as rounded:
        both = [tar.extractfile("000000000.npz").read() for tar in (exact, rounded)]  # type: ignore[union-attr]
        assert exact.getnames() == rounded.getnames()
    assert len(both[1]) < 0.5 * len(both[0])
    before, after = (npz.parse(content) for content in both)
    turned = rotation.multiply(rotation.inverse(before.local_rotations), after.local_rotations)
    assert np.rad2deg(np.linalg.norm(rotation.log(turned), axis=-1)).max() < 0.002
    places = [forward(clip)[1] * rig_info(clip.skeleton).sizes.unit.metres for clip in (before, after)]
    assert np.linalg.norm(places[0] - places[1], axis=-1).max() < 1e-4
    assert index(out)[0]["motion_sha256"] == motion_sha256(before), "the hash is that of the motion before rounding"


@pytest.mark.parametrize(
    ("rows", "options", "named"),
    [
        (ROWS[:4], {}, "other recipes"),
        (ROWS, {"shard_size": 3}, "shard_size 2"),
        (ROWS, {"store": "recipes"}, "store frames"),
        (ROWS, {"format": "bvh"}, "format npz"),
        (ROWS, {"poses": False}, "poses True"),
    ],
)
def test_another_run_is_not_mixed_into_a_folder(
    made: tuple[Path, BulkJob], rows: list[SentenceRecipe], options: dict[str, object], named: str
) -> None:
    before = read_folder(made[0])
    with pytest.raises(InputError, match=f"was begun with {named}.*new folder"):
        job_of(made[0], rows, **options)
    assert read_folder(made[0]) == before


def test_another_lexicon_is_refused_by_the_call_and_by_workers(words: dict[str, Clip], tmp_path: Path) -> None:
    lex, out = tmp_path / "lex", tmp_path / "out"
    batch = recipes.batch_of([SentenceRecipe(("I", "DEAF"), **QUICK)])  # type: ignore[arg-type]

    def build(second: Clip, owns: bytes = b"head") -> None:
        with lexicon.building(lex) as builder:
            builder.add(words["I"], "I")
            builder.add(second, "DEAF", extensions={"owns": owns})

    build(words["DEAF"])
    prepare(out, BulkOptions(str(lex)), lambda: [batch])
    (out / "index").mkdir()
    for second, owns in ((words["SIGN"], b"head"), (words["DEAF"], b"trunk")):
        build(second, owns)
        with pytest.raises(InputError, match=r"its lexicon, .*, is another"):
            make_shard(str(out), 0, 8)
        with pytest.raises(InputError, match="was begun with lexicon_sha256"):
            prepare(out, BulkOptions(str(lex)), lambda: [batch])


def test_a_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("")
    with pytest.raises(InputError, match=r"holds thesis.txt and no job.json"):
        job_of(tmp_path / "out")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"shard_size": 0}, "shard_size 0, expected 1 to"),
        ({"format": "obj"}, "format 'obj', expected npz"),
        ({"lexicon": "a\0b"}, "a name or path is no line of text"),
        ({"made_with": {"numpy": "2\u20281"}}, "a name or path is no line of text"),
        ({"bundle": "b" * 1000}, "a name or path is no line of text"),
    ],
)
def test_a_job_that_was_changed_is_refused(
    made: tuple[Path, BulkJob], changed: dict[str, object], message: str, tmp_path: Path
) -> None:
    stored = read_json(made[0] / "job.json", "")
    (tmp_path / "job.json").write_text(json.dumps(stored | changed))
    with pytest.raises(FormatError, match=f"is no job of a folder of shards .*{message}") as error:
        read_job(tmp_path)
    assert len(str(error.value).splitlines()) == 1


def test_a_call_that_is_refused_leaves_no_trace(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    for out in (tmp_path / "new", made[0]):
        before = read_folder(out) if out.exists() else None
        with pytest.raises(InputError):
            run.run(out, OPTIONS, lambda: [recipes.batch_of(ROWS[:0])])
        assert (read_folder(out) if out.exists() else None) == before
        assert not (out / "unfinished").exists()


@pytest.mark.parametrize("kind", ["file", "folder that is not empty"])
def test_what_is_called_unfinished_and_is_not_ours_is_not_touched(tmp_path: Path, kind: str) -> None:
    mark = tmp_path / "out" / "unfinished"
    thesis = mark if kind == "file" else mark / "thesis.txt"
    thesis.parent.mkdir(parents=True)
    thesis.write_text("mine")
    with pytest.raises(InputError, match=r"unfinished: is no empty folder.*name a new folder"):
        run.run(tmp_path / "out", OPTIONS, lambda: [recipes.batch_of(ROWS)])
    assert thesis.read_text() == "mine"


def test_a_call_that_waited_for_one_that_was_refused_begins_anew(tmp_path: Path) -> None:
    out, held, refuse = tmp_path / "out", threading.Event(), threading.Event()

    def no_recipes() -> list[pa.RecordBatch]:
        held.set()
        refuse.wait(5.0)
        return []

    def refused() -> None:
        with pytest.raises(InputError, match="no recipes"):
            run.run(out, OPTIONS, no_recipes)

    first = threading.Thread(target=refused)
    first.start()
    held.wait(5.0)
    threading.Timer(0.2, refuse.set).start()
    assert run.run(out, OPTIONS, lambda: [recipes.batch_of(ROWS[1:2])], workers=1).n_recipes == 1
    first.join()
    assert not (out / "unfinished").exists()


def test_a_call_that_is_interrupted_leaves_whole_shards_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"

    def interrupt(state: run.RunProgress) -> None:
        if state.n_done >= 2:
            (out / f".signsplice-{0:016x}.tar").write_bytes(b"of a worker that was killed")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"2 of 5 rows are kept in .*out; the same command continues"):
        run.run(out, OPTIONS, lambda: [recipes.batch_of(ROWS)], workers=1, advance=interrupt)
    assert not [path for path in out.rglob("*") if path.name.startswith(".signsplice-")]
    assert (out / "unfinished").is_dir()
    assert {path.name for path in out.glob("*.tar")} >= {"shard-000000.tar"}


def test_a_folder_whose_recipes_were_written_again_is_refused(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(made[0], out)
    pq.write_table(pq.read_table(out / "recipes.parquet"), out / "recipes.parquet", compression="none")
    with pytest.raises(InputError, match=r"recipes\.parquet: is not the file that job\.json names"):
        job_of(out)


def test_a_broken_file_of_the_index_ends_a_run_in_one_line(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(made[0], out)
    path = out / "index" / "000001.parquet"
    stored = path.read_bytes()
    footer = int.from_bytes(stored[-8:-4], "little") + 8  # says what there is, and stays
    path.write_bytes(stored[:4] + bytes(len(stored) - 4 - footer) + stored[-footer:])
    with pytest.raises(FormatError, match=r"000001\.parquet: cannot be read as the index of shard 1 .*makes it anew"):
        run.run(out, OPTIONS, lambda: [recipes.batch_of(ROWS)])


def test_recipes_and_hashes_alone_make_any_row_again(made: tuple[Path, BulkJob], tmp_path: Path) -> None:
    out = tmp_path / "out"
    make(out, job_of(out, store="recipes"), [0])
    assert not list(out.glob("*.tar"))
    command = [sys.executable, "-m", "signsplice", "bulk", "make", str(out), "0", "-o", str(tmp_path / "row.npz")]
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.stderr == ""
    assert again.stdout.endswith("bit for bit that of the index\n")
    with tarfile.open(made[0] / "shard-000000.tar") as tar:
        assert (tmp_path / "row.npz").read_bytes() == tar.extractfile("000000000.npz").read()  # type: ignore[union-attr]


def test_what_is_beside_a_sentence_does_not_change_it() -> None:
    with lexicon.open_shipped_lexicon() as words:
        together = SentenceMaker(words, n_words_kept=2).make(ROWS)
        for recipe, one in zip(ROWS, together, strict=True):
            (alone,) = SentenceMaker(words).make([recipe])
            assert type(alone) is type(one)
            if isinstance(alone, MadeSentence) and isinstance(one, MadeSentence):
                assert alone.motion_sha256 == one.motion_sha256
            elif isinstance(alone, FailedSentence) and isinstance(one, FailedSentence):
                assert alone.reason == one.reason


def owning(words: list[ss.Word], owns: list[frozenset[str] | None]) -> list[ss.Word]:
    return [replace(word, owns=channels) for word, channels in zip(words, owns, strict=True)]


def test_recipes_pause_and_have_forms_as_sentence_has(words: dict[str, Clip]) -> None:
    rows = [SentenceRecipe(("hello,", "DEAF", "2-GIVE-1."), pauses=pauses) for pauses in (True, False)]
    with ss.open_lexicon() as lex:
        held, plain = SentenceMaker(lex).make(rows)
        some = [words["HELLO"], words["DEAF"], lex.clip("2-GIVE-1")]
        owns = [lex.owns(gloss) for gloss in ("HELLO", "DEAF", "2-GIVE-1")]
    assert isinstance(held, MadeSentence)
    assert isinstance(plain, MadeSentence)
    wanted = ss.splice(owning(marked(some, pauses={0: ",", 2: "."}), owns))
    assert np.array_equal(held.result.clip.local_rotations, wanted.clip.local_rotations)
    assert held.result.spans == wanted.spans
    assert plain.result.spans == ss.splice(owning(marked(some), owns)).spans


def test_recipes_have_faces_by_rule_as_sentence_has() -> None:
    rows = [SentenceRecipe(("YOU", "WHERE", "BOOK?"), face_rules=face_rules) for face_rules in (True, False)]
    with ss.open_lexicon() as lex:
        ruled, plain = SentenceMaker(lex).make(rows)
        some = [lex.clip(gloss) for gloss in ("YOU", "WHERE", "BOOK")]
        owns = [lex.owns(gloss) for gloss in ("YOU", "WHERE", "BOOK")]
    assert isinstance(ruled, MadeSentence)
    assert isinstance(plain, MadeSentence)
    wanted = splice(
        owning(marked(some, starts=(), pauses={2: "?"}, brows=dict.fromkeys(range(3), "furrowed")), owns),
        ss.SpliceOptions(face_rules=RULES),
    ).clip
    assert ruled.motion_sha256 == motion_sha256(wanted)
    assert plain.result.clip.face is None


def test_a_signer_signs_on_its_own_body(words: dict[str, Clip], tmp_path: Path) -> None:
    small = replace(words["SIGN"].skeleton, offsets=words["SIGN"].skeleton.offsets * 0.8)
    with lexicon.building(tmp_path / "lex") as builder:
        builder.add(words["I"], "I", signer="kim")
        builder.add(words["DEAF"], "DEAF", signer="kim")
        builder.add(replace(words["SIGN"], skeleton=small), "SIGN", signer="lee")
    rows = [SentenceRecipe(("I", "DEAF"), signer=signer, **QUICK) for signer in ("", "kim", "lee", "max")]  # type: ignore[arg-type]
    with ss.open_lexicon(tmp_path / "lex") as lex:
        own, kim, lee, none = SentenceMaker(lex).make(rows)
    assert isinstance(own, MadeSentence)
    assert isinstance(kim, MadeSentence)
    assert isinstance(lee, MadeSentence)
    assert (own.signer, kim.signer, lee.signer) == ("kim", "kim", "lee")
    assert own.motion_sha256 == kim.motion_sha256 != lee.motion_sha256
    assert np.allclose(lee.result.clip.skeleton.offsets, small.offsets, atol=1e-6)
    assert isinstance(none, FailedSentence)
    assert none.reason == "signer 'max', expected one of the lexicon's: kim, lee"


def test_poses_have_the_points_of_a_hand_in_order(words: dict[str, Clip]) -> None:
    found = poses(words["HELLO"])
    n = len(words["HELLO"])
    assert {name: part.shape for name, part in found.items()} == {
        "upper_pose": (n, 8, 3), "left_hand": (n, 21, 3), "right_hand": (n, 21, 3),
    }  # fmt: skip
    for side, wrist in (("left", 4), ("right", 7)):
        hand = found[f"{side}_hand"]
        assert np.array_equal(hand[:, 0], found["upper_pose"][:, wrist])
        bones = np.linalg.norm(np.diff(hand[:, 1:].reshape(n, 5, 4, 3), axis=2), axis=-1)
        assert ((bones > 0.01) & (bones < 0.08)).all()


def read_elsewhere(code: str, out: Path) -> list[list[object]]:
    """The list in the last line that a program prints: both readers leave files open, so not in this process."""
    done = subprocess.run([sys.executable, "-c", code, str(out)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows: list[list[object]] = json.loads(done.stdout.splitlines()[-1])
    return rows


def test_webdataset_reads_shards_as_they_are(made: tuple[Path, BulkJob]) -> None:
    code = (
        "import sys, json, webdataset as wds\n"
        "samples = wds.WebDataset(sys.argv[1] + '/shard-{000000..000001}.tar', shardshuffle=False).decode()\n"
        "print(json.dumps([[one['__key__'], one['json']['frames'], one['json']['recipe']['glosses'],\n"
        "    list(one['npz']['local_rotations'].shape)] for one in samples]))"
    )
    rows = [row for row in index(made[0]) if not row["error"]]
    expected = [[row["key"], row["frames"], row["glosses"], [row["frames"], 53, 4]] for row in rows]
    assert read_elsewhere(code, made[0]) == expected


def test_sign_language_data_loading_reads_shards_as_they_are(made: tuple[Path, BulkJob]) -> None:
    pytest.importorskip("sldl", exc_type=ImportError)  # asks for MediaPipe and OpenCV, so it is in no lock
    code = (
        "import sys, json, sldl\n"
        "shards = sys.argv[1] + '/shard-{000000..000001}.tar'\n"
        "dataset = sldl.SignLanguageDataset(shards)\n"
        "windows = sldl.SignLanguageDataset(shards, use_windows=True, window_size=40, window_stride=20)\n"
        "batch = sldl.SignLanguageCollator()([dataset[0], dataset[1]])\n"
        "print(json.dumps([[one['n_frames'], one['signer_id'], list(one['poses']['right_hand'].shape),\n"
        "    list(one['annotations']['both_hands']['lemma'])] for one in (dataset[k] for k in range(len(dataset)))]\n"
        "    + [[max(windows[k]['n_frames'] for k in range(len(windows))), list(batch['poses']['upper_pose'].shape)]]))"
    )
    *samples, (longest, padded) = read_elsewhere(code, made[0])
    n_frames = [row["frames"] for row in index(made[0]) if not row["error"]]
    assert [sample[:3] for sample in samples] == [[n, "standard", [n, 21, 3]] for n in n_frames]
    assert samples[0][3] == ["HELLO", "I", "DEAF"]
    assert longest == 40
    assert padded == [2, max(n_frames[:2]), 8, 3]  # type: ignore[type-var]


def test_a_job_is_read_back_as_it_was_written(made: tuple[Path, BulkJob]) -> None:
    assert read_json(made[0] / "job.json", "")["n_recipes"] == 5
    assert job_of(made[0]) == made[1]
