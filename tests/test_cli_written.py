"""Commands on written signs: lexicons of SiGML and HamNoSys beside clips, one sign, words to fall back on."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result

import signsplice as ss
from signsplice import lexicon
from signsplice.cli.commands import app
from signsplice.lexicon.lexicon import WrittenWords
from signsplice.signer import notation
from signsplice.written import files
from signsplice.written.compiler import compile_sign
from signsplice.written.files import SUFFIXES
from written_words import code, constructed

TEN = Path(__file__).parent / "synth" / "written_signs.sigml"
KING = "symmlr finger2345 extfingerul palmd forehead lrbeside touch moveur smallmod fast"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two clips, a table of three signs, one of which is refused, and SiGML with a gloss of a clip."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "clips").mkdir()
    for gloss in ("HELLO", "DEAF"):
        ss.save(lexicon.open_shipped_lexicon().clip(gloss), tmp_path / "clips" / f"{gloss}.bvh")
    rows = {"MONARCH": KING, "ODD": "moveu", "HELLO": KING}
    table = "".join(f"{gloss},{code(names)}\n" for gloss, names in rows.items())
    (tmp_path / "table.csv").write_text(f"gloss,hamnosys\n{table}", encoding="utf-8")
    (tmp_path / "sigml").mkdir()
    shutil.copy(TEN, tmp_path / "sigml" / "ten.sigml")
    return tmp_path


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments, standalone_mode=False, catch_exceptions=True)


def test_a_lexicon_holds_clips_and_written_signs_and_drops_no_gloss(folder: Path) -> None:
    done = run("lexicon", "build", "clips", "table.csv", "sigml/ten.sigml", "-o", "lex", "--jobs", "1")
    assert done.exception is None, done.output
    assert "lex: 14 words" in done.output
    assert "table.csv: ODD: symbol 1: has no handshape" in done.stderr
    with ss.open_lexicon("lex") as words:
        assert {"HELLO", "HELLO#2", "DEAF", "MONARCH", "KING", "RAIN"} <= set(words)
        assert words.clip("HELLO").skeleton.names == lexicon.open_shipped_lexicon().clip("HELLO").skeleton.names
        np.testing.assert_allclose(
            words.clip("HELLO").local_rotations, lexicon.open_shipped_lexicon().clip("HELLO").local_rotations, atol=2e-6
        )
        assert words.clip("RED").face is not None
        assert words.entry("RED").source == "ten.sigml"
        assert not words.entry("RED").checked


def test_a_written_sign_owns_its_arms_and_what_its_tiers_move(folder: Path) -> None:
    tiers = '<head_tier><head_movement movement="NO"/></head_tier><shoulder_tier><shoulder_movement movement="UL"/>'
    text = TEN.read_text(encoding="utf-8").replace("</sign_nonmanual>", f"{tiers}</shoulder_tier></sign_nonmanual>", 1)
    Path("ten.sigml").write_text(text, encoding="utf-8")
    one, both = frozenset({"right arm"}), frozenset({"left arm", "right arm"})
    owned = {"RED": both | {"head"}, "FATHER": one, "KING": both}
    lexicon.build("ten.sigml", "lex")
    for words in (ss.open_lexicon("lex"), ss.Lexicon(WrittenWords("ten.sigml"))):
        with words:
            assert {gloss: words.owns(gloss) for gloss in owned} == owned


@pytest.mark.parametrize(("flags", "status"), [((), 0), (("--strict",), 1)])
def test_a_refused_sign_is_a_failure_only_on_request(folder: Path, flags: tuple[str, ...], status: int) -> None:
    done = run("lexicon", "build", "table.csv", "-o", "lex", *flags)
    if status:
        assert isinstance(done.exception, SystemExit)
        assert done.exception.code == 1
    else:
        assert done.exception is None
    with ss.open_lexicon("lex") as words:
        assert set(words) == {"MONARCH", "HELLO"}


def test_a_folder_may_hold_both_clips_and_sigml(folder: Path) -> None:
    shutil.copy(TEN, folder / "clips" / "ten.sigml")
    (folder / "clips" / "glosses.csv").write_text("file,synonyms\nHELLO.bvh,HI\n")
    built = lexicon.build(["clips"], "lex")
    assert (built.n_words, built.left_out) == (12, ())
    with ss.open_lexicon("lex") as words:
        assert words.entry("HI").gloss == "HELLO"
        assert "RAIN" in words


def test_a_sign_that_is_not_understood_is_left_out_or_read_in_part(folder: Path) -> None:
    Path("odd.txt").write_text(f"A\t{code(KING + ' mime')}\nB\t{code(KING)}\n", encoding="utf-8")
    built = lexicon.build(["odd.txt"], "lex")
    assert built.n_words == 1
    assert "hammime" in built.left_out[0]
    built = lexicon.build(["odd.txt"], "lex", lenient=True)
    assert (built.n_words, built.left_out) == (2, ())
    assert built.warnings == (
        "odd.txt: A: symbol 11: hammime is left out: stands for a mimed action, which is not made",
    )


def test_a_folder_of_sigml_is_a_lexicon_of_ngt_whose_licence_is_the_users_to_check(folder: Path) -> None:
    done = run("lexicon", "ngt", "sigml", "-o", "lex")
    assert done.exception is None, done.output
    assert "lex: 10 words" in done.output
    assert "licence" in done.output
    assert isinstance(run("lexicon", "ngt", "clips", "-o", "other").exception, ss.InputError)
    assert not Path("other").exists()


def test_many_warnings_are_counted_by_kind_and_written_to_a_file_whole(folder: Path) -> None:
    text = TEN.read_text(encoding="utf-8")
    sign = text[text.index("<hamgestural_sign") : text.index("</hamgestural_sign>")]
    sign = sign.replace("<handconfig ", '<handconfig contactkind="x" ', 1)
    (folder / "odd").mkdir()
    made = "".join(f"{sign.replace('RED', f'W{n}')}</hamgestural_sign>" for n in range(21))
    (folder / "odd" / "odd.sigml").write_text(f"<sigml>{made}</sigml>", encoding="utf-8")
    done = run("lexicon", "ngt", "odd", "-o", "lex", "--warnings", "all.txt")
    assert "21 times, first in odd/odd.sigml" in done.output, done.output
    assert len(Path("all.txt").read_text(encoding="utf-8").splitlines()) == 21


def test_a_number_of_a_gloss_that_is_not_there_is_named_with_those_that_are(folder: Path) -> None:
    for text in ("HELLO#2 DEAF", "DEAF HELLO#2?"):
        failed = run("sentence", text, "-o", "a.bvh", "--no-spell").exception
        assert "has no 'HELLO#2', expected HELLO" in str(failed), failed
    failed = run("synth", "sign", "sigml/ten.sigml", "CAR#2", "-o", "a.bvh").exception
    assert "signs: CAR, RED" in str(failed), failed


def test_one_sign_becomes_a_file_with_its_face(folder: Path) -> None:
    done = run("synth", "sign", "sigml/ten.sigml", "red", "-o", "red.glb")
    assert done.exception is None, done.output
    assert "red.glb: RED" in done.output
    clip = ss.load("red.glb")
    assert clip.face is not None
    assert "jawOpen" in clip.face.channels
    run("synth", "sign", "sigml/ten.sigml", "red", "-o", "red.npz")
    same = ss.load("red.npz")
    np.testing.assert_allclose(ss.sign("sigml/ten.sigml", "RED").local_rotations, same.local_rotations, atol=1e-5)


def test_a_written_sign_becomes_text_that_signs_the_same(folder: Path) -> None:
    text = TEN.read_text(encoding="utf-8")
    nod = '<head_tier><head_movement movement="NO"/></head_tier></sign_nonmanual>'
    Path("ten.sigml").write_text(text.replace("</sign_nonmanual>", nod), encoding="utf-8")
    gestures = 0
    for written in files.read("ten.sigml").signs.values():
        done = run("synth", "sign", "ten.sigml", written.gloss, "-o", "mend.signs")
        assert done.exception is None, done.output
        assert "without its face" in done.output
        (again,) = notation.read("mend.signs").values()
        assert again == compile_sign(written)
        gestures += len(again.gestures)
    assert gestures
    done = run("synth", "sign", "mend.signs", "-o", "mended.bvh")
    assert done.exception is None, done.output
    text = Path("mend.signs").read_text(encoding="utf-8")
    Path("bad.signs").write_text(text.replace("\n", "\n  gesture: elbow 3,0,0\n", 1), encoding="utf-8")
    assert "expected head|trunk FORWARD" in str(run("synth", "sign", "bad.signs").exception)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sigml/ten.sigml",), "10 signs, expected the gloss of one of its signs: RED, FATHER"),
        (("sigml/ten.sigml", "BLUE"), "no sign 'BLUE'"),
        (("table.csv", "ODD"), "ODD: symbol 1: has no handshape"),
        (("none.sigml", "A"), "no such file"),
    ],
)
def test_a_sign_that_is_not_there_or_not_understood_is_named(
    folder: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = run("synth", "sign", *arguments, "-o", "x.bvh")
    assert isinstance(done.exception, ss.InputError | click.ClickException)
    assert message in str(done.exception)
    assert not Path("x.bvh").exists()


def test_a_sentence_falls_back_on_written_signs_before_it_spells(folder: Path) -> None:
    done = run("sentence", "HELLO RAIN", "--fallback", "sigml/ten.sigml", "-o", "a.bvh", "--report", "r.json")
    assert done.exception is None, done.output
    report = json.loads(Path("r.json").read_text())
    assert [unit["glosses"] for unit in report["units"]] == [["HELLO"], ["RAIN"]]
    assert not any(unit["spelled"] for unit in report["units"])


def test_a_word_of_the_lexicon_is_preferred_to_a_written_one_and_forms_stay(folder: Path) -> None:
    with ss.open_lexicon(fallback="table.csv") as words, ss.open_lexicon() as shipped:
        assert words.entry("HELLO").sha256 == shipped.entry("HELLO").sha256
        assert words.entry("2-GIVE-1").gloss == "2-GIVE-1"
        assert "monarch" in words
        assert "ODD" not in words
        assert words.clip("monarch").name == "MONARCH"
        assert "MONARCH" not in list(words)
    run("lexicon", "build", "clips", "-o", "lex")
    with ss.open_lexicon("lex", fallback="table.csv") as words:
        assert "2-GIVE-1" not in words
        assert words.entry("MONARCH").source == "table.csv"


def test_a_sentence_says_which_languages_it_mixes_and_where_a_word_was_sought(folder: Path) -> None:
    line = ("sentence", "FRIEND MONARCH", "--fallback", "table.csv", "-o", "a.bvh", "--report", "r.json")
    done = run(*line, "--language", "dse")
    assert "warning: signs of other languages than dse: ase (FRIEND)" in done.output
    report = json.loads(Path("r.json").read_text())
    assert [unit["language"] for unit in report["units"]] == ["ase", "dse"]
    assert report["warnings"] == ["signs of other languages than dse: ase (FRIEND)"]
    refused = run(*line, "--one-language")
    assert "the words that ship and table.csv: signs of several languages: ase (FRIEND); unnamed (MONARCH)" in str(
        refused.exception
    )
    assert "the words that ship and table.csv: no gloss '你好'" in str(run(*line[:1], "你好", *line[2:]).exception)
    run("lexicon", "build", "clips", "-o", "lex", "--language", "gsg")
    words = json.loads(run("lexicon", "list", "lex", "--json").stdout)["words"]
    assert {word["language"] for word in words} == {"gsg"}


def test_a_sentence_takes_the_second_sign_of_a_gloss_by_its_number(folder: Path) -> None:
    run("lexicon", "build", "clips", "table.csv", "-o", "lex")
    done = run("sentence", "HELLO#2 DEAF", "--lexicon", "lex", "-o", "a.bvh", "--report", "r.json")
    assert done.exception is None, done.output
    assert json.loads(Path("r.json").read_text())["units"][0]["glosses"] == ["HELLO#2"]


def test_suffixes_of_written_signs_are_no_suffixes_of_clips() -> None:
    from signsplice.formats import READ_SUFFIXES

    assert not set(SUFFIXES) & set(READ_SUFFIXES)
    assert len(constructed()) > 150
