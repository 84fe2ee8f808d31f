"""The command line as other programs call it: names, exit statuses, one-line errors, whole files."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from signsplice import demo
from signsplice.formats import load, save
from signsplice.motion.clip import Clip


def signsplice(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A run of the real program, without a terminal."""
    command = [sys.executable, "-m", "signsplice", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, check=False
    )


@pytest.fixture
def folder(tmp_path: Path, words: dict[str, Clip]) -> Path:
    for gloss in ("HELLO", "SIGN", "I"):
        save(words[gloss], tmp_path / f"{gloss}.bvh")
    return tmp_path


def test_splice_writes_a_clip_and_a_report_that_rebuilds_it(folder: Path) -> None:
    run = signsplice("splice", "HELLO.bvh", "SIGN.bvh", "I.bvh", "-o", "out.bvh", "--report", "r.json", cwd=folder)
    assert (run.returncode, run.stderr) == (0, "")
    report = json.loads((folder / "r.json").read_text())
    out = load(folder / "out.bvh")
    assert report["frames"] == len(out)
    sources = [load(folder / f"{gloss}.bvh") for gloss in ("HELLO", "SIGN", "I")]
    for span in report["spans"]:
        if span["kind"] == "sign":
            part = out.local_rotations[slice(*span["output"])]
            source = sources[span["clip"]].local_rotations[slice(*span["source"])]
            assert np.allclose(np.abs(np.sum(part * source, axis=-1)), 1.0, atol=1e-12)
    first = report["spans"][0]["output"]
    assert out.channels is not None
    assert sources[0].channels is not None
    very_numbers = sources[0].channels.values[: first[1]]
    assert np.array_equal(out.channels.values[: first[1]], very_numbers)


def test_the_dials(folder: Path) -> None:
    common = ("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.npz", "--report", "r.json")
    for extra, check in (
        (("--transition-time", "0.5"), lambda r: r["seams"][0]["n_transition"] == 15),
        (("--transition-time", "fixed"), lambda r: r["seams"][0]["n_transition"] == 8),
        (("--cutter", "ends", "--transition", "slerp"), lambda r: (r["cutter"], r["transition"]) == ("ends", "slerp")),
        (("--fps", "60"), lambda r: r["fps"] == 60.0),
        (("--sign-speed", "2", "--cutter", "ends"), lambda r: r["frames"] < 90),
    ):
        run = signsplice(*common, *extra, cwd=folder)
        assert run.returncode == 0, run.stderr
        assert check(json.loads((folder / "r.json").read_text())), extra


BAD_CALLS = [
    (("splice",), "Missing argument"),
    (("splice", "HELLO.bvh"), "Missing option '-o'"),
    (("splice", "nowhere.bvh", "-o", "out.bvh"), "nowhere.bvh: no such file"),
    (("splice", "HELLO.bvh", "-o", "no/out.bvh"), "folder no does not exist"),
    (("splice", "HELLO.bvh", "-o", "out.fbx"), "suffix .fbx cannot be written"),
    (("splice", "HELLO.bvh", "-o", "out.pose"), "landmark files cannot be written yet"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--cutter", "x"), "no cutter 'x', expected one of"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition", "x"), "no transition 'x'"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition-time", "x"), "no duration 'x'"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition-time", "-1"), "expected 0 to 10s"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--transition-time", "nan"), "transition time nan"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--fps", "0"), "fps 0, expected"),
    (("splice", "HELLO.bvh", "-o", "out.bvh", "--report", "./out.bvh"), "named for both"),
    (("splice", "HELLO.bvh", "bad.bvh", "-o", "out.bvh"), "bad.bvh:"),
    (("splice", "HELLO.bvh", "SIGN.bvh", "-o", "out.bvh", "--roles", "bad.json"), "bad.json"),
    (("splice", "HELLO.bvh", "table.bvh", "-o", "out.bvh"), "have 0 body parts in common"),
    (("inbetween", "SIGN.bvh", "--gap", "5", "-o", "out.bvh"), "--gap '5', expected A:B"),
    (("inbetween", "SIGN.bvh", "--gap", "0:5", "-o", "out.bvh"), "gap 0:5 in "),
    (("inspect", "nowhere.bvh"), "no such file"),
    (("convert", "HELLO.bvh", "out.mov"), "suffix .mov"),
    (("render", "HELLO.bvh", "out.bvh"), "expected a name that ends in .png, .gif, .mp4"),
    (("render", "HELLO.bvh", "out.png", "--report", "bad.json"), "bad.json: is no report"),
    (("render", "HELLO.bvh", "out.png", "--view", "top"), "no view 'top', expected one of front"),
    (("dance",), "No such command 'dance'"),
]


@pytest.mark.parametrize(("call", "message"), BAD_CALLS, ids=[" ".join(call) for call, _ in BAD_CALLS])
def test_bad_calls_get_one_line_and_write_nothing(call: tuple[str, ...], message: str, folder: Path) -> None:
    (folder / "bad.bvh").write_text((folder / "SIGN.bvh").read_text()[:-300])
    (folder / "bad.json").write_text("[1, 2")
    (folder / "table.bvh").write_text(
        "HIERARCHY\nROOT Top\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nJOINT LegA\n{\nOFFSET 0 1 0\n}\n}\n"
        "MOTION\nFrames: 2\nFrame Time: 0.1\n1\n2\n"
    )
    before = sorted(path.name for path in folder.iterdir())
    run = signsplice(*call, cwd=folder)
    assert run.returncode == 2
    assert run.stderr.startswith("error: ")
    assert run.stderr.count("\n") == 1
    assert message in run.stderr
    assert run.stdout == ""
    assert sorted(path.name for path in folder.iterdir()) == before


def test_inbetween_keeps_every_other_number(folder: Path) -> None:
    run = signsplice("inbetween", "SIGN.bvh", "--gap", "30:38", "--gap", "50:55", "-o", "out.bvh", cwd=folder)
    assert run.returncode == 0, run.stderr
    source, out = load(folder / "SIGN.bvh").channels, load(folder / "out.bvh").channels
    assert source is not None
    assert out is not None
    kept = np.ones(len(source.values), bool)
    kept[30:38] = kept[50:55] = False
    assert np.array_equal(out.values[:30], source.values[:30])
    assert np.allclose(out.values[kept], source.values[kept], atol=1e-6)
    assert not np.allclose(out.values[~kept], source.values[~kept], atol=1e-3)


def test_inspect_tells_what_a_clip_is(folder: Path) -> None:
    run = signsplice("inspect", "SIGN.bvh", "--json", cwd=folder)
    facts = json.loads(run.stdout)
    assert (facts["rig"], facts["unit"], facts["fps"]) == ("mixamo", "cm", 30.0)
    assert (facts["joints"], facts["frames"]) == (53, len(load(folder / "SIGN.bvh")))
    assert facts["roles"]["leftUpperArm"] == "mixamorig:LeftArm"
    assert len(facts["rest"]) == 2
    assert facts["warnings"] == []
    assert "mixamorig:LeftArm" in signsplice("inspect", "SIGN.bvh", cwd=folder).stdout


def test_convert_there_and_back_is_the_same_file(folder: Path) -> None:
    assert signsplice("convert", "SIGN.bvh", "a.npz", cwd=folder).returncode == 0
    assert signsplice("convert", "a.npz", "b.bvh", cwd=folder).returncode == 0
    assert (folder / "b.bvh").read_text() == (folder / "SIGN.bvh").read_text()


def test_methods_lists_every_part(folder: Path) -> None:
    rows = json.loads(signsplice("methods", "--json", cwd=folder).stdout)
    names = {row["name"] for row in rows}
    assert names >= {"ends", "rest-trim", "hand-distance", "pose-velocity", "hold", "linear", "slerp", "minimum-jerk"}
    assert names >= {"hermite", "quintic", "inertialize", "fixed", "travel", "speed", "tempo"}
    assert [row["name"] for row in rows if row["default"]] == ["learned", "learned", "learned"]
    assert len(signsplice("methods", cwd=folder).stdout.splitlines()) == len(rows)


def test_roles_can_be_given_by_hand(folder: Path, words: dict[str, Clip]) -> None:
    """A rig whose names say nothing is spliced once its roles are named."""
    from signsplice.rig.roles import find_roles

    text = (folder / "SIGN.bvh").read_text()
    renamed = {name: f"b{n:02d}" for n, name in enumerate(words["SIGN"].skeleton.names)}
    for name in sorted(renamed, key=len, reverse=True):
        text = text.replace(name, renamed[name])
    (folder / "mute.bvh").write_text(text)
    joints = find_roles(words["SIGN"].skeleton).joints
    (folder / "roles.json").write_text(json.dumps({role: f"b{joint:02d}" for role, joint in joints.items()}))
    run = signsplice("splice", "mute.bvh", "mute.bvh", "-o", "out.bvh", cwd=folder)
    assert run.returncode == 2
    assert "roles" in run.stderr
    for first, second in (("mute.bvh", "mute.bvh"), ("HELLO.bvh", "mute.bvh"), ("mute.bvh", "I.bvh")):
        run = signsplice("splice", first, second, "-o", "out.bvh", "--roles", "roles.json", cwd=folder)
        assert run.returncode == 0, run.stderr
    (folder / "roles.json").write_text('{"leftHand": "nowhere"}')
    run = signsplice("splice", "mute.bvh", "mute.bvh", "-o", "out.bvh", "--roles", "roles.json", cwd=folder)
    assert run.returncode == 2
    assert "no joint 'nowhere'" in run.stderr


def test_evaluate_and_bench_print_json(folder: Path) -> None:
    run = signsplice("evaluate", "--clips", "SIGN.bvh", "--json", cwd=folder)
    told = json.loads(run.stdout)
    assert "arm/1000" in told["signature"]
    assert {row["n_frames"] for row in told["rows"]} == {5, 8, 12, 18, 24}
    figures = json.loads(signsplice("bench", "--repeats", "3", "--json", cwd=folder).stdout)
    assert figures["joints"] == 53
    assert figures["memory"]["ratio"] < 2.0, "a splice holds less than twice its clips"
    assert figures["memory"]["ratio at worst"] < 2.0


def test_demo_leaves_something_to_look_at(tmp_path: Path) -> None:
    run = signsplice("demo", "--out", "d", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    for name in ("sentence.bvh", "sentence.gif", "sentence.png", "report.json", "words/SIGN.bvh"):
        assert (tmp_path / "d" / name).stat().st_size > 500
    for gloss in demo.SENTENCE:
        assert gloss in run.stdout
    report = json.loads((tmp_path / "d" / "report.json").read_text())
    assert len(load(tmp_path / "d" / "sentence.bvh")) == report["frames"]


def test_long_work_can_be_interrupted(folder: Path) -> None:
    """Ctrl-C leaves no half-written file and no traceback."""
    import signal
    import time

    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", "render", "SIGN.bvh", "out.gif"],
        cwd=folder,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    if process.returncode != 0:  # it may have been done already on a quick machine
        assert process.returncode == 130
        assert said.strip() == "error: interrupted; nothing was half-written"
        assert not (folder / "out.gif").exists()
    assert [p.name for p in folder.iterdir() if p.name.startswith(".")] == []
