"""The commands ``lexicon`` and ``sentence``: exit statuses, one-line errors, JSON, interruption."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from signsplice import cli, lexicon
from signsplice.formats import load, save
from signsplice.motion import Clip


def signsplice(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "signsplice", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, check=False
    )


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with clips, a table, and the lexicon built from both by command."""
    words = lexicon.open_shipped_lexicon()
    folder = tmp_path_factory.mktemp("lexicon")
    (folder / "clips").mkdir()
    for gloss in ("HELLO", "SIGN", "I"):
        save(words.clip(gloss), folder / "clips" / f"{gloss}.bvh")
    for letter in "AN":
        save(words.clip("DEAF"), folder / "clips" / f"fs-{letter}.npz")
    (folder / "clips" / "glosses.csv").write_text("file,synonyms,signer,checked\nHELLO.bvh,HI;HEY,Kim,yes\n")
    run = signsplice("lexicon", "build", "clips", "-o", "lex", cwd=folder)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == "lex: 5 words, 2 of them letters, 0.3 MB, float32\n"
    return folder


def test_list_prints_the_words(built: Path) -> None:
    run = signsplice("lexicon", "list", "lex", cwd=built)
    assert (run.returncode, run.stderr) == (0, "")
    lines = run.stdout.splitlines()
    assert len(lines) == 6
    n_frames = len(load(built / "clips" / "HELLO.bvh"))
    seconds = f"{n_frames / 30.0:.2f} s 30.00 fps"
    assert " ".join(lines[0].split()) == f"HELLO sign {seconds} Kim; checked; also HI, HEY"
    document = json.loads(signsplice("lexicon", "list", "lex", "--json", "--search", "hE", cwd=built).stdout)
    assert (document["version"], document["lexicon"], document["form"]) == (1, "lex", "float32")
    (word,) = document["words"]
    assert (word["gloss"], word["synonyms"], word["frames"], word["checked"]) == (
        "HELLO",
        ["HI", "HEY"],
        n_frames,
        True,
    )
    assert word["rest_before"] > 0
    assert len(word["sha256"]) == 64


def test_check_reports_faults_of_lexicons_and_folders(built: Path, tmp_path: Path) -> None:
    for path, output in (("lex", "lex: 5 words, no faults\n"), ("clips", "clips: 5 clips, no faults\n")):
        run = signsplice("lexicon", "check", path, cwd=built)
        assert (run.returncode, run.stdout, run.stderr) == (0, output, "")
    (tmp_path / "clips").mkdir()
    text = (built / "clips" / "SIGN.bvh").read_text()
    (tmp_path / "clips" / "a.bvh").write_text(text[:-300])
    (tmp_path / "clips" / "b.bvh").write_text(re.sub(r"Frame Time:.*", "Frame Time: 0", text))
    (tmp_path / "clips" / "c.bvh").write_text(text)
    (tmp_path / "clips" / "glosses.csv").write_text("file,gloss\nd.bvh,D\n")
    run = signsplice("lexicon", "check", "clips", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (1, "")
    lines = run.stdout.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == ["clips/glosses.csv", "clips/a.bvh", "clips/b.bvh"]
    assert lines[3:] == ["clips: 3 clips, 3 faults"]


def test_a_sentence_is_spliced_from_its_words(built: Path, tmp_path: Path) -> None:
    common = ("--lexicon", built / "lex", "--report", "r.json")
    run = signsplice("sentence", "hello I", "fs-ann", "sign", "-o", "out.bvh", *common, "--fps", "60", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    report = json.loads((tmp_path / "r.json").read_text())
    names = [span["name"] for span in report["spans"] if span["kind"] == "sign"]
    assert names == ["HELLO", "I", "fs-A", "fs-N", "fs-N", "SIGN"]
    assert len(load(tmp_path / "out.bvh")) == report["frames"]
    assert report["fps"] == 60.0
    run = signsplice("sentence", "I NANA", "-o", "out.npz", "--lexicon", built / "lex", cwd=tmp_path)
    assert run.returncode == 0
    assert run.stderr == "warning: no gloss 'NANA', so it is spelled; write fs-NANA to mean that\n"


def test_a_typed_line_pauses_unless_it_is_told_not_to(built: Path, tmp_path: Path) -> None:
    frames = {}
    for more in ((), ("--no-pauses",)):
        call = ("sentence", "Hello, I sign.", "-o", "out.npz", "--lexicon", built / "lex", "--report", "r.json", *more)
        assert signsplice(*call, cwd=tmp_path).returncode == 0
        report = json.loads((tmp_path / "r.json").read_text())
        assert [unit["pause"] for unit in report["units"]] == [",", "", "."]
        marks = [span["pause"]["mark"] for span in report["spans"] if span["pause"]]
        assert marks == ([] if more else [",", "."])
        frames[more] = report["frames"]
    assert frames[()] > frames["--no-pauses",] + 20


BAD_CALLS = [
    (("sentence",), "Missing argument"),
    (("sentence", "I"), "Missing option '-o'"),
    (("sentence", " ", "-o", "out.bvh", "--lexicon", "lex"), "no gloss in the sentence"),
    (("sentence", "HALLO", "-o", "out.bvh", "--lexicon", "lex"), "lex: no gloss 'HALLO' (nearest: HELLO)"),
    (("sentence", "I ZZ", "-o", "out.bvh", "--lexicon", "lex", "--no-spell"), "lex: no gloss 'ZZ'"),
    (("sentence", "NANA", "-o", "out.bvh", "--lexicon", "lex", "--no-spell"), "no gloss 'NANA'"),
    (("sentence", "fs-OTTO", "-o", "out.bvh", "--lexicon", "lex"), "there is no letter 'O'"),
    (("sentence", "I", "-o", "out.bvh", "--lexicon", "clips"), "clips: is no lexicon, it has no index.sqlite"),
    (("sentence", "I", "-o", "out.bvh", "--lexicon", "no"), "no: no such folder, expected a lexicon"),
    (("sentence", "I", "-o", "no/out.bvh", "--lexicon", "lex"), "folder no does not exist"),
    (("sentence", "I", "-o", "out.bvh", "--lexicon", "lex", "--cutter", "x"), "no cutter 'x'"),
    (("lexicon", "list", "no"), "no such folder"),
    (("lexicon", "list", "clips"), "clips: is no lexicon"),
    (("lexicon", "check", "no"), "no: no such folder, expected a folder of clips"),
    (("lexicon", "build", "clips"), "Missing option '-o'"),
    (("lexicon", "build", "no", "-o", "new"), "no: no such folder"),
    (("lexicon", "build", "clips", "-o", "clips"), "clips: is there already and is no lexicon"),
    (("lexicon", "build", "clips", "-o", "a/b"), "folder a does not exist"),
    (("lexicon", "build", "bad", "-o", "lex"), "bad/I.bvh:"),
    (("lexicon", "build", "clips", "-o", "lex", "--roles", "no.json"), "no.json: no such file"),
    (("lexicon", "burn"), "No such command 'burn'"),
]


@pytest.mark.parametrize(("call", "message"), BAD_CALLS, ids=[" ".join(call) for call, _ in BAD_CALLS])
def test_bad_calls_get_a_one_line_error_and_change_nothing(
    call: tuple[str, ...],
    message: str,
    built: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (built / "bad").mkdir(exist_ok=True)
    (built / "bad" / "I.bvh").write_text((built / "clips" / "I.bvh").read_text()[:-300])
    before = {path: path.read_bytes() for path in built.rglob("*") if path.is_file()}
    monkeypatch.chdir(built)
    monkeypatch.setattr(sys, "argv", ["signsplice", *call])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    assert stopped.value.code == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert printed.err.count("\n") == 1
    assert message in printed.err
    assert printed.out == ""
    assert {path: path.read_bytes() for path in built.rglob("*") if path.is_file()} == before


def test_an_interrupted_build_leaves_the_old_lexicon(tmp_path: Path, words: dict[str, Clip]) -> None:
    """Ctrl-C leaves the older lexicon and no temporary files."""
    (tmp_path / "clips").mkdir()
    with lexicon.building(tmp_path / "lex") as builder:
        builder.add(words["I"], "OLD")
    save(words["SIGN"], tmp_path / "clips" / "W0.bvh")
    text = (tmp_path / "clips" / "W0.bvh").read_text()
    for n in range(1, 400):
        (tmp_path / "clips" / f"W{n}.bvh").write_text(text)
    process = subprocess.Popen(
        [sys.executable, "-m", "signsplice", "lexicon", "build", "clips", "-o", "lex"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a job in the background would ignore it
    )
    deadline = time.monotonic() + 30.0
    while process.poll() is None and time.monotonic() < deadline:
        if any(
            path.stat().st_size for path in tmp_path.glob(".signsplice-*/frames.bin")
        ):  # the first words are written
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors.strip()) == (130, "error: interrupted; no file was left half-written")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clips", "lex"]
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.glosses == ("OLD",)
