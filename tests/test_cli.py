"""The command line: options, exit statuses, one-line errors, files that are whole or absent."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from other_rigs import on_other_rig, with_rest_pose
from reference_poses import arms_out, with_pose
from signsplice import demo, lexicon
from signsplice.bench import parts
from signsplice.cli import main
from signsplice.cli.terminal import with_option_names
from signsplice.formats import load, save
from signsplice.formats.avatar import read_avatar
from signsplice.motion import Clip, rotation
from signsplice.render import film
from signsplice.rig.info import active_span, arms, rig_info
from signsplice.service import page

Run = subprocess.CompletedProcess[str]
Call = Callable[..., Run]


def run_program(*arguments: str, cwd: Path) -> Run:
    """A run of the program in a process of its own, without a terminal."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=120,
        check=False,
    )


@pytest.fixture
def folder(tmp_path: Path, words: dict[str, Clip]) -> Path:
    for gloss in ("HELLO", "SIGN", "I"):
        save(words[gloss], tmp_path / f"{gloss}.bvh")
    return tmp_path


@pytest.fixture
def signsplice(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Runs the command line in this process and in ``folder``: the same as the program, without its start."""
    monkeypatch.chdir(folder)

    def call(*arguments: str) -> Run:
        monkeypatch.setattr(sys, "argv", ["signsplice", *arguments])
        status: str | int | None = 0
        try:
            main()
        except SystemExit as stop:
            status = stop.code
        out, err = capsys.readouterr()
        assert isinstance(status, int)
        return subprocess.CompletedProcess(arguments, status, out, err)

    return call


def test_splice_writes_a_clip_and_a_report_that_rebuilds_it(folder: Path) -> None:
    call = ("-m", "signsplice", "splice", "HELLO.bvh", "SIGN.bvh", "I.bvh", "-o", "out.bvh", "--report", "r.json")
    run = run_program(*call, cwd=folder)
    assert (run.returncode, run.stderr) == (0, "")
    report = json.loads((folder / "r.json").read_text())
    out = load(folder / "out.bvh")
    assert report["frames"] == len(out)
    sources = [load(folder / f"{gloss}.bvh") for gloss in ("HELLO", "SIGN", "I")]
    copied: list[list[bool]] = []
    for span in report["spans"]:
        if span["clip"] is not None:
            copied.append([name not in span["remade"]["joints"] for name in out.skeleton.names])
            part = out.local_rotations[slice(*span["output"])]
            source = sources[span["clip"]].local_rotations[slice(*span["source"])]
            same = np.abs(np.sum(part * source, axis=-1))[:, copied[-1]]
            assert np.allclose(same[:, 1:], 1.0, atol=1e-12)
            assert np.allclose(same[:, 0], 1.0, atol=3e-4), "words are turned to face alike, by less than 3 degrees"
    named = dict(zip(out.skeleton.names, np.all(copied, axis=0), strict=True))
    assert all(named[f"mixamorig:{joint}"] for joint in ("Hips", "RightArm", "RightHand", "RightHandIndex1"))
    first = report["spans"][0]["output"]
    assert out.channels is not None
    assert sources[0].channels is not None
    columns = np.repeat(copied[0], [len(names) for names in out.channels.names])
    assert np.array_equal(out.channels.values[: first[1], columns], sources[0].channels.values[: first[1], columns])


def test_splicing_options_change_the_result(folder: Path, signsplice: Call) -> None:
    common = ("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.npz", "--report", "r.json")
    for extra, check in (
        (("--transition-time", "0.5"), lambda r: r["seams"][0]["n_transition"] == 15),
        (("--transition-time", "fixed"), lambda r: r["seams"][0]["n_transition"] == 8),
        (("--cutter", "ends", "--transition", "slerp"), lambda r: (r["cutter"], r["transition"]) == ("ends", "slerp")),
        (("--fps", "60"), lambda r: r["fps"] == 60.0),
        (("--sign-speed", "2", "--cutter", "ends"), lambda r: r["frames"] < 100),
        (("--tempo", "natural"), lambda r: r["tempo"]["mode"] == "natural" and r["spans"][0]["warp"]),
        (("--tempo", "0.9"), lambda r: r["tempo"]["asked_seconds"] == 0.9),
        (("--person", "0.5", "--seed", "3"), lambda r: (r["person"]["amount"], r["person"]["seed"]) == (0.5, 3)),
    ):
        run = signsplice(*common, *extra)
        assert run.returncode == 0, run.stderr
        assert check(json.loads((folder / "r.json").read_text())), extra


@pytest.mark.parametrize(
    ("option", "avoids"),
    [
        ("--avoid-collisions", True),
        ("--no-avoid-collisions", False),
    ],
)
def test_collision_avoidance_is_switched_by_its_option(
    option: str, avoids: bool, folder: Path, signsplice: Call
) -> None:
    methods = ("--cutter", "rest-trim", "--transition", "hermite")
    run = signsplice("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.npz", "--report", "r.json", *methods, option)
    assert run.returncode == 0, run.stderr
    (seam,) = json.loads((folder / "r.json").read_text())["seams"]
    assert (seam["intrusion_mm"] is not None) == avoids
    run = signsplice("inbetween", "SIGN.bvh", "--gap", "30:38", "-o", "out.bvh", "--report", "r.json", option)
    assert run.returncode == 0, run.stderr
    (seam,) = json.loads((folder / "r.json").read_text())["seams"]
    assert (seam["intrusion_mm"] is not None) == avoids


@pytest.mark.parametrize("command", ["splice", "sentence", "inbetween"])
def test_help_shows_options_by_their_names(command: str, signsplice: Call) -> None:
    text = signsplice(command, "--help").stdout
    assert "--avoid-collisions / --no-avoid-collisions" in text
    assert "body" not in text


BAD_CALLS = [
    (("splice",), "Missing argument"),
    (("splice", "HELLO.bvh"), "Missing option '-o'"),
    (("splice", "nowhere.bvh", "HELLO.bvh", "-o", "out.bvh"), "nowhere.bvh: no such file"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "no/out.bvh"), "folder no does not exist"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.fbx"), "suffix .fbx cannot be written"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--cutter", "x"), "no cutter 'x', expected one of"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition", "x"), "no transition 'x'"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition-time", "x"), "no duration 'x'"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition-time", "-1"), "expected 0 to 10s"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition-time", "nan"), "transition time nan"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--fps", "0"), "fps 0, expected"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--report", "./out.bvh"), "named for both"),
    (("splice", "HELLO.bvh", "bad.bvh", "-o", "out.bvh"), "bad.bvh:"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--roles", "bad.json"), "bad.json"),
    (("splice", "HELLO.bvh", "table.bvh", "-o", "out.bvh"), "have 0 body parts in common"),
    (("inbetween", "SIGN.bvh", "--gap", "5", "-o", "out.bvh"), "--gap '5', expected A:B"),
    (("inbetween", "SIGN.bvh", "--gap", "0:5", "-o", "out.bvh"), "gap 0:5 in "),
    (("inspect", "nowhere.bvh"), "no such file"),
    (("convert", "HELLO.bvh", "out.mov"), "suffix .mov"),
    (("render", "HELLO.bvh", "out.bvh"), "expected a name that ends in .png, .gif, .mp4"),
    (("render", "HELLO.bvh", "out.png", "--report", "bad.json"), "bad.json:1: is no JSON"),
    (("render", "HELLO.bvh", "out.png", "--view", "top"), "no view 'top', expected one of front"),
    (
        ("evaluate", "corpus", "nowhere", "--page", "p.md", "--images", "."),
        "nowhere: has no corpus.json, expected a corpus of pairs",
    ),
    (("evaluate", "corpus", "nowhere", "--page", "p.md", "--images", "none"), "none: no such folder; make it first"),
    (("evaluate", "corpus", "nowhere", "--page", "p.md", "--images", ".", "--real", "none"), "none: no such folder"),
    (
        ("evaluate", "corpus", "nowhere", "--page", "p.md", "--images", ".", "--real-frames", "0:9"),
        "expected --real DIR too",
    ),
    *(
        (
            ("evaluate", "corpus", "nowhere", "--page", "p.md", "--images", ".", "--real", ".", "--real-frames", text),
            f"--real-frames {text}, expected FIRST:STOP with FIRST below STOP, as in 0:315",
        )
        for text in ("315", "9:9", "-1:5", "a:b")
    ),
    (("evaluate", "corpus", "nowhere", "--page", "p.md"), "expected --images DIR too"),
    (("dance",), "No such command 'dance'"),
]


@pytest.mark.parametrize(("call", "message"), BAD_CALLS, ids=[" ".join(call) for call, _ in BAD_CALLS])
def test_a_bad_call_prints_one_line_and_writes_nothing(
    call: tuple[str, ...], message: str, folder: Path, signsplice: Call
) -> None:
    (folder / "bad.bvh").write_text((folder / "SIGN.bvh").read_text()[:-300])
    (folder / "bad.json").write_text("[1, 2")
    (folder / "table.bvh").write_text(
        "HIERARCHY\nROOT Top\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nJOINT LegA\n{\nOFFSET 0 1 0\n}\n}\n"
        "MOTION\nFrames: 2\nFrame Time: 0.1\n1\n2\n"
    )
    before = sorted(path.name for path in folder.iterdir())
    run = signsplice(*call)
    assert run.returncode == 2
    assert run.stderr.startswith("error: ")
    assert run.stderr.count("\n") == 1
    assert message in run.stderr
    assert run.stdout == ""
    assert sorted(path.name for path in folder.iterdir()) == before


OVERWRITING = (
    ("splice", "HELLO.bvh", "SIGN.bvh", "-o", "SIGN.bvh"),
    ("splice", "HELLO.bvh", "SIGN.bvh", "-o", "lex/../SIGN.bvh"),
    ("splice", "HELLO.bvh", "SIGN.bvh", "-o", "linked.bvh"),
    ("splice", "HELLO.bvh", "to-sign.bvh", "-o", "SIGN.bvh"),
    ("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--report", "SIGN.bvh"),
    ("splice", "HELLO.bvh", "I.bvh", "-o", "out.bvh", "--roles", "roles.json", "--report", "roles.json"),
    ("splice", "HELLO.bvh", "I.bvh", "-o", "out.bvh", "--bundle", "bundle", "--report", "bundle/bundle.json"),
    ("splice", "HELLO.bvh", "I.bvh", "-o", "out.bvh", "--cutter", "bundle", "--report", "bundle/bundle.json"),
    ("sentence", "I", "-o", "linked.bvh", "--roles", "SIGN.bvh"),
    ("sentence", "I", "-o", "out.bvh", "--lexicon", "lex", "--report", "lex/index.sqlite"),
    ("inbetween", "SIGN.bvh", "--gap", "20:25", "-o", "SIGN.bvh"),
    ("convert", "SIGN.bvh", "linked.bvh"),
    ("convert", "to-sign.bvh", "SIGN.bvh"),
    ("render", "SIGN.bvh", "drawn.png", "--report", "roles.json"),
    ("view", "SIGN.bvh", "--report", "roles.json", "-o", "drawn.html"),
    ("lexicon", "build", ".", "-o", "lex"),
    ("lexicon", "build", "bundle", "-o", "lex", "--roles", "lex/index.sqlite"),
    ("synth", "lexicon", "-o", "words", "--signs", "words/own.signs"),
    ("synth", "sentences", "-o", "words", "--signs", "words/own.signs"),
    ("synth", "pairs", "-o", "words", "--signs", "words/own.signs"),
)


@pytest.mark.parametrize("call", OVERWRITING, ids=" ".join)
def test_an_output_is_never_an_input(call: tuple[str, ...], folder: Path, signsplice: Call) -> None:
    """By name, by another spelling, and through hard and symbolic links."""
    with lexicon.building(folder / "lex") as builder:
        builder.add(load(folder / "I.bvh"))
    for name, text in (("bundle/bundle.json", "{}"), ("words/own.signs", ""), ("roles.json", '{"hips": "Hips"}')):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    for name in ("drawn.png", "drawn.html"):
        os.link(folder / "roles.json", folder / name)
    os.link(folder / "SIGN.bvh", folder / "linked.bvh")
    (folder / "to-sign.bvh").symlink_to("SIGN.bvh")
    before = {path: (path.lstat().st_ino, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}
    run = signsplice(*call)
    assert run.returncode == 2
    assert run.stderr.startswith("error: ")
    assert run.stderr.count("\n") == 1
    assert "would overwrite what is read from" in run.stderr or ", which is read, or contains it" in run.stderr
    assert {path: (path.lstat().st_ino, path.read_bytes()) for path in folder.rglob("*") if path.is_file()} == before


def test_pictures_mark_the_words_that_travel_in_the_file(signsplice: Call, folder: Path) -> None:
    assert signsplice("splice", "HELLO.bvh", "SIGN.bvh", "-o", "both.glb", "--report", "r.json").returncode == 0
    pages = []
    for call in (("marked.png",), ("told.png", "--report", "r.json")):
        assert signsplice("render", "both.glb", *call).returncode == 0
        pages.append((folder / call[0]).read_bytes())
    assert pages[0] == pages[1]
    clip = load(folder / "both.glb")
    save(replace(clip, report={"version": "?"}), folder / "odd.glb")
    run = signsplice("render", "odd.glb", "plain.png")
    assert (run.returncode, run.stderr.count("\n")) == (0, 1)
    assert "odd.glb: its report of a splice: is no report" in run.stderr
    assert (folder / "plain.png").read_bytes() != pages[0]


@pytest.mark.parametrize(
    "call", [("convert", "SIGN.bvh", "linked.bvh"), ("sentence", "I", "-o", "new.bvh", "--report", "linked.bvh")]
)
def test_an_output_with_other_names_is_named(call: tuple[str, ...], folder: Path, signsplice: Call) -> None:
    """Hard links keep the old content, since a finished file is renamed to the output."""
    old = (folder / "I.bvh").read_bytes()
    os.link(folder / "I.bvh", folder / "linked.bvh")
    run = signsplice(*call)
    assert run.returncode == 0
    assert run.stderr == "warning: linked.bvh: is one of 2 hard links to a file; the others keep the old content\n"
    assert (folder / "I.bvh").read_bytes() == old != (folder / "linked.bvh").read_bytes()
    assert signsplice(*call).stderr == ""


def test_an_input_may_be_a_link(folder: Path, signsplice: Call) -> None:
    (folder / "linked.bvh").symlink_to("SIGN.bvh")
    assert signsplice("convert", "linked.bvh", "out.npz").returncode == 0
    assert len(load(folder / "out.npz")) == len(load(folder / "SIGN.bvh"))


def test_the_program_exits_with_status_2_after_a_bad_call(folder: Path) -> None:
    run = run_program("-m", "signsplice", "splice", "nowhere.bvh", "HELLO.bvh", "-o", "out.bvh", cwd=folder)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("error: nowhere.bvh: no such file")


@pytest.mark.parametrize(("call", "line"), [((), "  splice "), (("lexicon",), "  build ")])
def test_without_a_command_there_is_the_help(call: tuple[str, ...], line: str, signsplice: Call) -> None:
    run = signsplice(*call)
    assert (run.returncode, run.stdout) == (2, "")
    lines = run.stderr.splitlines()
    assert lines[0].startswith("Usage: ")
    assert any(text.startswith(line) for text in lines)
    assert "error:" not in run.stderr


def test_inbetween_changes_no_other_frame(folder: Path, signsplice: Call) -> None:
    run = signsplice("inbetween", "SIGN.bvh", "--gap", "30:38", "--gap", "50:55", "-o", "out.bvh")
    assert run.returncode == 0, run.stderr
    source, out = load(folder / "SIGN.bvh").channels, load(folder / "out.bvh").channels
    assert source is not None
    assert out is not None
    kept = np.ones(len(source.values), bool)
    kept[30:38] = kept[50:55] = False
    assert np.array_equal(out.values[:30], source.values[:30])
    assert np.allclose(out.values[kept], source.values[kept], atol=1e-6)
    assert not np.allclose(out.values[~kept], source.values[~kept], atol=1e-3)


def test_inspect_describes_a_clip(folder: Path, signsplice: Call) -> None:
    run = signsplice("inspect", "SIGN.bvh", "--json")
    facts = json.loads(run.stdout)
    assert (facts["rig"], facts["unit"], facts["fps"]) == ("mixamo", "cm", 30.0)
    assert (facts["joints"], facts["frames"]) == (53, len(load(folder / "SIGN.bvh")))
    assert facts["roles"]["leftUpperArm"] == "mixamorig:LeftArm"
    assert len(facts["rest"]) == 2
    assert facts["warnings"] == []
    assert "recorded at 30 frames a second (--input-fps)" in facts["assumed"]
    assert "rest pose: all rotations zero" in facts["assumed"]
    assert "mixamorig:LeftArm" in signsplice("inspect", "SIGN.bvh").stdout


def test_converted_and_converted_back_a_file_is_the_same(folder: Path, signsplice: Call) -> None:
    assert signsplice("convert", "SIGN.bvh", "a.npz").returncode == 0
    assert signsplice("convert", "a.npz", "b.bvh").returncode == 0
    assert (folder / "b.bvh").read_text() == (folder / "SIGN.bvh").read_text()


def test_methods_are_listed_with_their_defaults(signsplice: Call) -> None:
    rows = json.loads(signsplice("methods", "--json").stdout)
    names = {row["name"] for row in rows}
    assert names >= {"ends", "rest-trim", "hand-distance", "pose-velocity", "hold", "linear", "slerp", "minimum-jerk"}
    assert names >= {"hermite", "quintic", "inertialize", "fixed", "tempo"}
    assert [row["name"] for row in rows if row["default"]] == ["learned", "learned", "tempo"]
    assert len(signsplice("methods").stdout.splitlines()) == len(rows)


def test_a_wrong_rate_is_corrected_by_every_command_that_reads_files(folder: Path, signsplice: Call) -> None:
    wrong = re.sub("Frame Time:.*", "Frame Time: 30", (folder / "HELLO.bvh").read_text())
    (folder / "wrong.bvh").write_text(wrong)
    right = json.loads(signsplice("inspect", "HELLO.bvh", "--json").stdout)
    run = signsplice("inspect", "wrong.bvh", "--json", "--input-fps", f"{right['fps']}")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["seconds"] == right["seconds"]
    for call in (
        ("splice", "wrong.bvh", "wrong.bvh", "-o", "out.bvh"),
        ("inbetween", "wrong.bvh", "--gap", "10:14", "-o", "out.bvh"),
        ("convert", "wrong.bvh", "out.glb"),
        ("render", "wrong.bvh", "out.png"),
        *([("view", "wrong.bvh", "-o", "out.html")] if page.BUILT.is_dir() else []),
        ("evaluate", "clips", "wrong.bvh"),
    ):
        run = signsplice(*call, "--input-fps", "25")
        assert run.returncode == 0, (call, run.stderr)
    (folder / "clips").mkdir()
    (folder / "wrong.bvh").rename(folder / "clips" / "wrong.bvh")
    assert signsplice("lexicon", "build", "clips", "-o", "lex", "--input-fps", "25").returncode == 0
    (word,) = json.loads(signsplice("lexicon", "list", "lex", "--json").stdout)["words"]
    assert (word["fps"], word["frames"]) == (25.0, right["frames"])
    run = signsplice("inspect", "HELLO.bvh", "--input-fps", "0")
    assert (run.returncode, run.stderr) == (2, "error: fps 0.0, expected frames a second, 0.001 to 100,000\n")


def test_a_roles_file_makes_an_unknown_rig_usable(folder: Path, words: dict[str, Clip], signsplice: Call) -> None:
    save(words["SIGN"][:50], folder / "short.bvh")
    text = (folder / "short.bvh").read_text()
    new_names = {name: f"b{n:02d}" for n, name in enumerate(words["SIGN"].skeleton.names)}
    for name in sorted(new_names, key=len, reverse=True):
        text = text.replace(name, new_names[name])
    (folder / "unknown.bvh").write_text(text)
    joints = rig_info(words["SIGN"].skeleton).roles.joints
    (folder / "roles.json").write_text(json.dumps({role: f"b{joint:02d}" for role, joint in joints.items()}))
    run = signsplice("splice", "unknown.bvh", "unknown.bvh", "-o", "out.bvh")
    assert run.returncode == 2
    assert "roles" in run.stderr
    for first, second in (("unknown.bvh", "unknown.bvh"), ("HELLO.bvh", "unknown.bvh"), ("unknown.bvh", "I.bvh")):
        run = signsplice("splice", first, second, "-o", "out.bvh", "--roles", "roles.json")
        assert run.returncode == 0, run.stderr
    for call in (
        ("render", "unknown.bvh", "out.png"),
        ("evaluate", "clips", "unknown.bvh"),
        ("inspect", "unknown.bvh"),
    ):
        run = signsplice(*call, "--roles", "roles.json")
        assert (run.returncode, run.stderr) == (0, ""), call
    named, unnamed = folder / "named.png", folder / "unnamed.png"
    signsplice("render", "unknown.bvh", unnamed.name)
    signsplice("render", "short.bvh", named.name)
    assert (folder / "out.png").read_bytes() == named.read_bytes() != unnamed.read_bytes(), "a figure, not sticks"
    (folder / "roles.json").write_text('{"leftHand": "nowhere"}')
    run = signsplice("splice", "unknown.bvh", "unknown.bvh", "-o", "out.bvh", "--roles", "roles.json")
    assert run.returncode == 2
    assert "no joint 'nowhere'" in run.stderr


def test_evaluate_prints_json(signsplice: Call) -> None:
    printed = json.loads(signsplice("evaluate", "clips", "SIGN.bvh", "--json").stdout)
    assert "arm/1000" in printed["signature"]
    assert {row["n_frames"] for row in printed["rows"]} == {5, 8, 12, 18, 24}
    assert {row["drawn"] for row in printed["rows"]} == {0.0}


@pytest.mark.slow
def test_bench_prints_json(signsplice: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "N_LEXICON", 134)
    monkeypatch.setattr(parts, "N_LONG_FRAMES", 300)
    monkeypatch.setattr(parts, "N_STREAM", 20)
    figures = json.loads(signsplice("bench", "--repeats", "3", "--json").stdout)
    assert figures["joints"] == 53
    assert figures["memory"]["ratio"] < 2.0, "a splice allocates less than twice the size of its clips"
    assert figures["memory"]["ratio at worst"] < 2.0


def test_demo_writes_clips_pictures_and_a_report(
    folder: Path, signsplice: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    sentence = ("HELLO", "SIGN")
    assert set(sentence) < set(demo.SENTENCE)
    monkeypatch.setattr(demo, "SENTENCE", sentence)
    monkeypatch.setattr(film, "GIF_SIZE", (96, 96))
    run = signsplice("demo", "--out", "d")
    assert run.returncode == 0, run.stderr
    for name in ("sentence.bvh", "sentence.gif", "sentence.png", "report.json", "avatar.glb", "words/SIGN.bvh"):
        assert (folder / "d" / name).stat().st_size > 500
    assert " ".join(sentence) in run.stdout
    report = json.loads((folder / "d" / "report.json").read_text())
    assert len(load(folder / "d" / "sentence.bvh")) == report["frames"]
    assert read_avatar(folder / "d" / "avatar.glb").body is not None


INTERRUPTED = """
import signal
from signsplice.cli import main
from signsplice.cli.terminal import with_option_names
from signsplice.render import film

def draw(*arguments):
    drawn.append(arguments)
    if len(drawn) == 3:
        signal.raise_signal(signal.SIGINT)
    return draw_frame(*arguments)

drawn, draw_frame, film.draw = [], film.draw, draw
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell starts with it ignored
main()
"""
"""The program, which gets a SIGINT while it draws its third frame."""


INTERRUPTED_AT_START = """
import signal, sys

class Finder:
    def find_spec(self, name, *others):
        if name == sys.argv[-1]:
            signal.raise_signal(signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Finder())
from signsplice.cli import main
from signsplice.cli.terminal import with_option_names
main()
"""
"""The program, which gets a SIGINT while it imports the module named last."""


@pytest.mark.parametrize(
    "module", ["signsplice.cli.commands", "click", "signsplice.cli.plugins", "signsplice.motion.clip"]
)
def test_an_interrupt_while_the_program_starts_shows_no_traceback(folder: Path, module: str) -> None:
    run = run_program("-c", INTERRUPTED_AT_START, "inspect", "SIGN.bvh", "--roles", module, cwd=folder)
    assert run.returncode == 130
    assert run.stderr.strip() == "error: interrupted; no file was left half-written"


def test_interrupted_work_leaves_no_file_and_no_traceback(folder: Path) -> None:
    before = sorted(path.name for path in folder.iterdir())
    run = run_program("-c", INTERRUPTED, "render", "SIGN.bvh", "out.gif", cwd=folder)
    assert run.returncode == 130
    assert run.stderr.strip() == "error: interrupted; no file was left half-written"
    assert sorted(path.name for path in folder.iterdir()) == before


def test_every_warning_of_inspect_is_one_of_each_command_that_uses_clips(signsplice: Call, folder: Path) -> None:
    """A clip that never rests, in a unit without a name, with a jump, on a rig whose zero pose shows no person."""
    whole = load(folder / "SIGN.bvh")
    heaped = with_rest_pose(whole, {name: (2.0, float(n), 0.0) for n, name in enumerate(whole.skeleton.names)})
    clip = on_other_rig(heaped, np.asarray(rotation.IDENTITY), 1e-3)[30:45]
    local = np.array(clip.local_rotations)
    local[7:, 3] = rotation.multiply(local[7:, 3], rotation.exp([1.4, 0.0, 0.0]))
    (folder / "clips").mkdir()
    save(replace(clip, local_rotations=local, name="ODD"), folder / "clips" / "ODD.npz")
    warnings = json.loads(signsplice("inspect", "clips/ODD.npz", "--json").stdout)["warnings"]
    parts = (
        "no rest found",
        "a fault of the capture?",
        "no unit makes the body a person's",
        "frame 0 is taken as rest pose",
    )
    assert [any(part in line for line in warnings) for part in parts] == [True] * 4
    assert len(warnings) == len(parts)
    for prefix, call in (
        ("ODD", ("splice", "HELLO.bvh", "clips/ODD.npz", "clips/ODD.npz", "-o", "a.bvh", "--report", "a.json")),
        ("ODD", ("inbetween", "clips/ODD.npz", "--gap", "5:7", "-o", "a.bvh")),
        ("ODD", ("convert", "clips/ODD.npz", "a.bvh", "--onto", "HELLO.bvh")),
        ("clips/ODD.npz", ("lexicon", "check", "clips")),
        ("clips/ODD.npz", ("lexicon", "build", "clips", "-o", "lex")),
        ("lex: word 'ODD'", ("lexicon", "check", "lex")),
        ("ODD", ("sentence", "ODD ODD", "--lexicon", "lex", "-o", "a.bvh")),
    ):
        run = signsplice(*call)
        assert run.returncode == 0, run.stderr
        for line in warnings:
            assert run.stderr.count(f"warning: {prefix}: {line}\n") == 1, (call, line)
    assert {f"ODD: {line}" for line in warnings} <= set(json.loads((folder / "a.json").read_text())["warnings"])


def test_a_rest_pose_is_that_of_the_frame_that_the_user_names(signsplice: Call, folder: Path) -> None:
    whole = load(folder / "SIGN.bvh")
    heaped = with_rest_pose(whole, {name: (2.0, float(n), 0.0) for n, name in enumerate(whole.skeleton.names)})
    save(replace(heaped, name="HEAP"), folder / "HEAP.npz")
    for call in (("inspect", "HEAP.npz"), ("splice", "I.bvh", "HEAP.npz", "-o", "a.bvh")):
        run = signsplice(*call, "--rest-frame", "4")
        assert "the zero pose shows no person: frame 4 is taken as rest pose" in run.stdout + run.stderr
    assert "I: its zero pose shows a person; --rest-frame is not for it" in run.stderr
    run = signsplice("render", "HEAP.npz", "a.png", "--rest-frame", "900")
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert f"no frame 900 to be its rest pose, expected 0 to {len(whole) - 1}" in run.stderr
    rested = load(folder / "HEAP.npz", rest_frame=4).skeleton.rest_pose
    assert rested is not None
    assert np.array_equal(rested, heaped.local_rotations[4])


def test_frames_that_do_not_belong_are_named_by_every_command_that_reads_words(
    signsplice: Call, folder: Path, words: dict[str, Clip]
) -> None:
    clip = words["SIGN"]
    (folder / "clips").mkdir()
    for gloss in ("HELLO", "I"):
        save(words[gloss], folder / "clips" / f"{gloss}.npz")
    save(with_pose(clip, arms_out(clip.skeleton), 4), folder / "clips" / "SIGN.npz")
    line = "frames 0 to 3: a T-pose that does not belong to the motion; left out of splices"
    inspected = json.loads(signsplice("inspect", "clips/SIGN.npz", "--json").stdout)
    assert inspected["warnings"] == [line]
    runs = {
        f"SIGN: {line}": ("splice", "clips/HELLO.npz", "clips/SIGN.npz", "-o", "a.bvh", "--report", "a.json"),
        f"clips/SIGN.npz: {line}": ("lexicon", "check", "clips"),
        f" clips/SIGN.npz: {line}": ("lexicon", "build", "clips", "-o", "lex"),
        f"lex: word 'SIGN': {line}": ("lexicon", "check", "lex"),
        f" SIGN: {line}": ("sentence", "HELLO SIGN I", "-o", "b.bvh", "--lexicon", "lex"),
    }
    for expected, arguments in runs.items():
        run = signsplice(*arguments)
        assert (run.returncode, run.stderr) == (0, f"warning: {expected.strip()}\n"), arguments
    assert json.loads((folder / "a.json").read_text())["warnings"] == [f"SIGN: {line}"]
    listed = json.loads(signsplice("lexicon", "list", "lex", "--json").stdout)["words"]
    (entry,) = [row for row in listed if row["gloss"] == "SIGN"]
    start, stop = active_span(arms(clip))
    assert (entry["frames"], entry["rest_before"], entry["rest_after"]) == (len(clip) + 4, start + 4, len(clip) - stop)


def test_a_seed_repeats_the_movements_between_the_signs_and_another_changes_them(
    folder: Path, signsplice: Call
) -> None:
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        run = signsplice("splice", "HELLO.bvh", "SIGN.bvh", "-o", f"{name}.bvh", "--cutter", "ends", "--seed", seed)
        assert run.returncode == 0, run.stderr
    a, b, c = ((folder / f"{name}.bvh").read_bytes() for name in "abc")
    assert a == b != c


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--person", "1.5"), "person 1.5, expected 0 to 1"),
        (("--person", "nan"), "person nan, expected 0 to 1"),
        (("--seed", "-1"), "'--seed': -1 is not in the range"),
        (("--free-hand", "slow"), "free hand 'slow', expected one of transition, natural"),
        (("--system", "lpt-plus", "--person", "0.5"), "leave out --person"),
        (("--system", "lpt-plus", "--free-hand", "transition"), "leave out --free-hand"),
    ],
)
def test_movements_between_the_signs_that_cannot_be_are_refused(
    options: tuple[str, ...], message: str, folder: Path, signsplice: Call
) -> None:
    run = signsplice("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", *options)
    assert run.returncode == 2
    assert message in run.stderr
    assert not (folder / "out.bvh").exists()


def test_a_seed_changes_nothing_in_a_systems_sentence(folder: Path, signsplice: Call) -> None:
    for seed in ("1", "2"):
        call = ("splice", "HELLO.bvh", "SIGN.bvh", "-o", f"{seed}.bvh", "--system", "lpt-plus", "--seed", seed)
        assert signsplice(*call).returncode == 0
    assert (folder / "1.bvh").read_bytes() == (folder / "2.bvh").read_bytes()


def test_an_option_is_named_as_the_command_line_has_it(signsplice: Call) -> None:
    """The library names the field of ``SpliceOptions``."""
    run = signsplice("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--system", "lpt-plus", "--cutter", "ends")
    assert run.returncode == 2
    assert run.stderr == (
        "error: lpt-plus runs whole: it chooses positions, number of frames and frames itself; leave out --cutter\n"
    )
    assert with_option_names("leave out SpliceOptions.cutter, SpliceOptions.duration") == (
        "leave out --cutter, --transition-time"
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("call", [("methods",), ("lexicon", "list", "--json"), ("--help",), ("--version",)])
def test_a_full_standard_output_is_one_line(call: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(
            [sys.executable, "-m", "signsplice", *call], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert run.returncode == 1
    assert re.fullmatch(r"error: standard output cannot be written \(No space left on device\).*\n", run.stderr)


@pytest.mark.parametrize(
    ("error", "message", "status"),
    [
        ("MemoryError()", "error: there is not enough memory for this", 1),
        ("ImportError('lib.so: failed to map segment from shared object')", "error: there is not enough memory", 1),
        ("OSError(12, 'Cannot allocate memory')", "error: there is not enough memory for this", 1),
        ("swallowed() or SystemError('error return without exception')", "error: interrupted;", 130),
    ],
)
def test_lack_of_memory_and_interrupts_in_imports_are_one_line(
    error: str, message: str, status: int, tmp_path: Path
) -> None:
    """A library that is imported may make another error of an interrupt."""
    code = (
        "import signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell's background job ignores it
        "def swallowed():\n"
        "    try:\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "    except KeyboardInterrupt:\n"
        "        pass\n"
        "from signsplice import cli\n"
        "def fail(*_, **__):\n"
        f"    raise {error}\n"
        "sys.argv = ['signsplice', 'methods']\n"
        "from signsplice.splicing import options\n"
        "options.all_methods = fail\n"
        "cli.main()\n"
    )
    run = run_program("-c", code, cwd=tmp_path)
    assert run.returncode == status, run.stderr
    assert run.stderr.startswith(message)
    assert run.stderr.count("\n") == 1


def test_faces_come_by_option_or_beside_their_clips_and_go_out_again(folder: Path, signsplice: Call) -> None:
    spoken = signsplice("convert", "HELLO.bvh", "SAID.bvh", "--mouth", "h@l@U")
    assert (spoken.returncode, spoken.stderr) == (0, "")
    assert (folder / "SAID.csv").exists()
    common = ("-o", "out.npz", "--report", "r.json", "--cutter", "ends")
    for arguments, recorded in (
        (("SAID.bvh", "SIGN.bvh"), [0]),
        (("I.bvh", "SIGN.bvh", "--face", "SAID.csv", "--face", "SAID.csv", "--face-offset", "0.5"), [0, 1]),
    ):
        run = signsplice("splice", *arguments, *common)
        assert run.returncode == 0, run.stderr
        assert json.loads((folder / "r.json").read_text())["face"]["recorded"] == recorded
        assert load(folder / "out.npz").face is not None
    run = signsplice("convert", "SAID.bvh", "out.glb")
    assert "out.glb: its figure cannot show " in run.stderr or load(folder / "out.glb").face is not None
    assert signsplice("convert", "SAID.bvh", "out.vrma").returncode == 0
    face = load(folder / "out.vrma").face
    assert face is not None
    assert face.of(["jawOpen"]).max() > 0.1


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("splice", "HELLO.bvh", "I.bvh", "-o", "o.bvh", "--face", "x.csv"), "1 --face for 2 clips, expected one for"),
        (("convert", "HELLO.bvh", "o.bvh", "--face", "x.csv"), "x.csv: no such file"),
        (("convert", "HELLO.bvh", "o.bvh", "--face", "o.csv"), "o.csv: would overwrite what is read from o.csv"),
        (("convert", "HELLO.bvh", "o.bvh", "--mouth", "hello!"), "'!' is no sound of SAMPA"),
    ],
)
def test_a_face_that_cannot_be_had_is_one_line(
    arguments: tuple[str, ...], expected: str, folder: Path, signsplice: Call
) -> None:
    (folder / "o.csv").write_text("jawOpen\n0.5\n")
    run = signsplice(*arguments)
    assert run.returncode == 2
    assert len(run.stderr.splitlines()) == 1
    assert expected in run.stderr
    assert not (folder / "o.bvh").exists()


def test_a_sentence_has_a_face_by_rule_where_its_file_has_a_place_for_one(folder: Path, signsplice: Call) -> None:
    line = ("sentence", "YOU DEAF?", "--cutter", "ends", "--report", "r.json", "-o")
    for extra, rules in (
        (("out.npz",), ["blinks", "brows", "gaze"]),
        (("out.bvh",), None),
        (("out.npz", "--no-face-rules"), None),
        (("out.bvh", "--face-rules"), ["blinks", "brows", "gaze"]),
    ):
        run = signsplice(*line, *extra)
        assert (run.returncode, run.stderr) == (0, "")
        face = json.loads((folder / "r.json").read_text()).get("face")
        assert face == (None if rules is None else {"recorded": [], "rules": rules})
        clip = load(folder / extra[0])
        assert (clip.face is None) == (rules is None)
    run = signsplice(*line, "out.bvh")
    assert "out.csv: beside out.bvh, which was written without a face, is another clip's; remove it" in run.stderr


def test_a_sentence_is_mouthed_from_a_dictionary_where_its_file_has_a_face(folder: Path, signsplice: Call) -> None:
    (folder / "words.dict").write_text("DEAF  D EH1 F\n")
    line = ("sentence", "YOU DEAF", "--cutter", "ends", "--mouthing", "words.dict", "-o")
    run = signsplice(*line, "out.npz")
    assert (run.returncode, run.stderr) == (0, "")
    face = load(folder / "out.npz").face
    assert face is not None
    assert face.of(["jawOpen"]).max() > 0.3
    run = signsplice(*line, "out.bvh")
    assert run.returncode == 2
    assert run.stderr == "error: --mouthing moves faces by rule, expected --face-rules too\n"
    run = signsplice(*line, "words.dict")
    assert run.returncode == 2
    assert len(run.stderr.splitlines()) == 1
    assert (folder / "words.dict").read_text() == "DEAF  D EH1 F\n"
