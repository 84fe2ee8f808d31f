"""The commands `synth`: complete folders, one-line errors, and lexicons that other commands accept."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from signsplice.formats import load
from signsplice.signer import notation

NOTATION = """\
# two words
WAVE  hands=one
  source: a wave (invented)
  synonyms: HI, HEY
  X  shape=B-open at=space-high palm=fwd fingers=up
  M  local=nod:20:2
KNOCK  hands=one
  X  shape=S at=space palm=down fingers=fwd
  M  shift=0,-5,0 times=2
  H
"""


def signsplice(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "signsplice", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, check=False
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a text of two words, and what a command makes of it."""
    folder = tmp_path_factory.mktemp("synth")
    (folder / "own.signs").write_text(NOTATION, encoding="utf-8")
    run = signsplice("synth", "lexicon", "-o", "words", "--signs", "own.signs", "--pseudo", "1", cwd=folder)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith("words: 3 words, signer standard; no signer")
    assert run.stdout.count("\n") == 1
    return folder


def test_a_lexicon_of_words_of_a_file(folder: Path) -> None:
    assert sorted(path.name for path in (folder / "words").iterdir()) == [
        *("KNOCK.bvh", "PSEUDO-0.bvh", "WAVE.bvh", "glosses.csv")
    ]
    table = (folder / "words" / "glosses.csv").read_text(encoding="utf-8").splitlines()
    assert table[1] == "WAVE.bvh,WAVE,HI;HEY,standard,a wave (invented),no,sign,right arm"
    assert len(load(folder / "words" / "KNOCK.bvh")) > 40


def test_other_commands_accept_the_lexicon_and_its_files(folder: Path) -> None:
    run = signsplice("lexicon", "build", "words", "-o", "lex", cwd=folder)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith("lex: 3 words")
    listed = json.loads(signsplice("lexicon", "list", "lex", "--json", cwd=folder).stdout)
    (wave,) = (word for word in listed["words"] if word["gloss"] == "WAVE")
    assert wave["synonyms"] == ["HI", "HEY"]
    assert not wave["checked"]
    assert wave["rest_before"] > 0, "it begins with hanging hands"
    run = signsplice("splice", "words/WAVE.bvh", "words/KNOCK.bvh", "-o", "both.bvh", cwd=folder)
    assert run.returncode == 0, run.stderr


def test_words_are_drawn_by_seed_and_keep_their_order() -> None:
    from signsplice.cli.synth import chosen_signs

    order = list(notation.everyday())
    drawn = [[one.gloss for one in chosen_signs(None, 9, 0, seed)] for seed in (4, 4, 5)]
    assert drawn[0] == drawn[1] != drawn[2]
    for glosses in drawn:
        assert len(set(glosses)) == 9
        assert glosses == sorted(glosses, key=order.index)
    assert len(chosen_signs(None, None, 0, 0)) == len(order)


BROKEN = "WAVE  hands=one\n  X  shape=B-opn at=space palm=fwd fingers=up\n"
UNLAWFUL = "WAVE  hands=one\n  H  shape=B-open at=space palm=up fingers=up\n"
BAD_CALLS = [
    (("lexicon",), "Missing option '-o'"),
    (("lexicon", "-o", "out", "--signs", "none.signs"), "none.signs: no such file"),
    (
        ("lexicon", "-o", "out", "--signs", "broken.signs"),
        "broken.signs:2: WAVE: unknown shape 'B-opn'; did you mean B-open",
    ),
    (("lexicon", "-o", "out", "--signs", "unlawful.signs"), "unlawful.signs:1: WAVE: segment 1: palm and fingers"),
    (("lexicon", "-o", "out", "--signs", "empty.signs"), "0 words chosen, expected at least 1"),
    (("lexicon", "-o", "out", "--words", "100000"), "--words 100000, but the package has"),
    (("lexicon", "-o", "out", "--signs", "own.signs", "--words", "3"), "--words 3, but own.signs has 2"),
    (("lexicon", "-o", "out", "--words", "-1"), "--words -1 --pseudo 0, expected numbers of at least 0"),
    (("lexicon", "-o", "out", "--fps", "5"), "--fps 5, expected 10 to 240"),
    (("lexicon", "-o", "out", "--fps", "nan"), "--fps nan, expected 10 to 240"),
    (("lexicon", "-o", "own.signs", "--signs", "own.signs"), "own.signs: would overwrite what is read from own.signs"),
    (("lexicon", "-o", "no/out", "--signs", "own.signs"), "folder no does not exist; make it first"),
    (("lexicon", "-o", ".", "--signs", "own.signs"), "would overwrite what is read from own.signs"),
    (("lexicon", "-o", ".", "--words", "1"), "is there already and has no glosses.csv"),
    (
        ("lexicon", "-o", "mine", "--words", "1"),
        "has other columns than a table of `synth lexicon`; the folder is not replaced",
    ),
    (("dance",), "No such command 'dance'"),
]


@pytest.mark.parametrize(("call", "message"), BAD_CALLS, ids=[" ".join(call) for call, _ in BAD_CALLS])
def test_a_bad_call_gives_one_line_and_writes_nothing(
    call: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """In this process, as ``python -m signsplice`` would run them."""
    from signsplice import cli

    texts = {"own": NOTATION, "broken": BROKEN, "unlawful": UNLAWFUL, "empty": "# nothing\n"}
    for name, text in texts.items():
        (tmp_path / f"{name}.signs").write_text(text, encoding="utf-8")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "HELLO.bvh").write_text("my recording", encoding="utf-8")
    (tmp_path / "mine" / "glosses.csv").write_text("file,gloss\nHELLO.bvh,HELLO\n", encoding="utf-8")
    before = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["signsplice", "synth", *call])
    with pytest.raises(SystemExit) as left:
        cli.main()
    out, err = capsys.readouterr()
    assert left.value.code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert message in err
    assert out == ""
    assert sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*")) == before


def test_forms_of_words_are_added(tmp_path: Path) -> None:
    (tmp_path / "own.signs").write_text(NOTATION, encoding="utf-8")
    call = ("lexicon", "-o", "words", "--signs", "own.signs", "--form", "KNOCK-HABITUAL", "--form", "KNOCK-HABITUAL")
    done = signsplice("synth", *call, "--form", "WAVE", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.stem for path in (tmp_path / "words").glob("*.bvh")) == ["KNOCK", "KNOCK-HABITUAL", "WAVE"]
    wrong = signsplice("synth", "lexicon", "-o", "words", "--form", "2-GIV-1", cwd=tmp_path)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("error: form '2-GIV-1': no sign 'GIV', expected a sign's gloss as in 2-GIVE-1")


FAULTY = """\
FAR  hands=one
  X  shape=index at=space-far palm=down fingers=fwd
  M  shift=0,20,40
FINE  hands=one
  X  shape=B-open at=chest palm=back fingers=in
  M  off=5
"""


def test_one_sign_is_drawn_and_what_cannot_be_is_said(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    (tmp_path / "own.signs").write_text(FAULTY)
    done = signsplice("synth", "preview", "own.signs", "FAR", cwd=tmp_path)
    assert (done.returncode, done.stdout.partition(":")[0]) == (0, "FAR.png")
    assert done.stderr.startswith("warning: FAR: at=space-far is out of reach in segment 2 (M): ")
    assert len(done.stderr.splitlines()) == 1
    fine = signsplice("synth", "preview", "own.signs", "FINE-HABITUAL", "-o", "b.png", cwd=tmp_path)
    assert (fine.returncode, fine.stderr) == (0, "")
    shipped = signsplice("synth", "preview", "-", "2-ASK-1", cwd=tmp_path)
    assert shipped.returncode == 0
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["2-ASK-1.png", "FAR.png", "b.png"]
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in tmp_path.glob("*.png"))


@pytest.mark.parametrize(
    ("call", "line"),
    [
        ((), "expected a file and a gloss: signsplice synth preview FILE GLOSS"),
        (("own.signs",), "expected a file and a gloss"),
        (("own.signs", "NONE"), "own.signs: form 'NONE': no sign 'NONE'"),
        (("own.signs", "FAR", "-o", "a.gif"), "a.gif: expected a name that ends in .png"),
        (("own.signs", "FAR", "-o", "own.signs"), "own.signs: expected a name that ends in .png"),
        (("own.signs", "FAR", "--all", "out"), "--all draws the names of the notation, expected no FILE"),
        (("--all", "none"), "none: no such folder"),
        (("none.signs", "FAR"), "none.signs: "),
    ],
)
def test_a_wrong_preview_is_one_line(call: tuple[str, ...], line: str, tmp_path: Path) -> None:
    (tmp_path / "own.signs").write_text(FAULTY)
    done = signsplice("synth", "preview", *call, cwd=tmp_path)
    assert done.returncode == 2
    assert line in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["own.signs"]


def test_a_lexicon_of_ones_own_signs_is_warned_of_what_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "own.signs").write_text(FAULTY)
    done = signsplice("synth", "lexicon", "-o", "words", "--signs", "own.signs", cwd=tmp_path)
    assert done.returncode == 0
    (warning,) = done.stderr.splitlines()
    assert warning.startswith("warning: FAR: at=space-far is out of reach")
