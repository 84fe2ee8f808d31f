"""Lexicons of landmarks: folders of spoken-to-signed as they are, and lexicons built from them."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import signsplice as ss
from signsplice.errors import FormatError, InputError
from signsplice.formats import pose
from signsplice.lexicon import Lexicon, build, open_lexicon
from signsplice.lexicon.recordings import read_index

HEAD = "path,spoken_language,signed_language,start,end,words,glosses,priority"


def write_folder(folder: Path, rows: Sequence[str], head: str = HEAD) -> Path:
    """A folder with landmarks of four shipped words, a.pose to d.pose, and a table."""
    (folder / "sgg").mkdir(parents=True, exist_ok=True)
    with ss.open_lexicon() as words:
        for name, gloss in zip("abcd", ("HELLO", "NAME", "YES", "MOTHER"), strict=True):
            (folder / "sgg" / f"{name}.pose").write_bytes(pose.encode(words.clip(gloss)))
    (folder / "index.csv").write_text("\n".join([head, *rows]) + "\n")
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the program spoken-to-signed has them."""
    rows = (
        "sgg/a.pose,de,sgg,0,0,hallo,HALLO1,0",
        "sgg/b.pose,de,sgg,0,0,name,Name,1",
        "sgg/c.pose,de,sgg,0,0,name,Name,0",
        "sgg/d.pose,de,sgg,500,1500,Mutter,MUTTER,0",
    )
    return write_folder(tmp_path_factory.mktemp("lexicon"), rows)


@pytest.fixture(scope="module", params=["as it is", "built"])
def lexicon(request: pytest.FixtureRequest, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Lexicon:
    """The same words from the folder itself, and from a lexicon built from it."""
    if request.param == "as it is":
        return open_lexicon(folder)
    target = tmp_path_factory.mktemp("built") / "lexicon"
    build(folder, target)
    return open_lexicon(target)


def test_words_have_their_glosses_synonyms_and_language(lexicon: Lexicon) -> None:
    assert lexicon.glosses == ("HALLO1", "MUTTER", "NAME", "NAME-2")
    assert lexicon.entry("hallo").gloss == "HALLO1"
    assert {lexicon.language_of(gloss) for gloss in lexicon.glosses} == {"sgg"}
    assert [entry.gloss for entry in lexicon.entries()] == list(lexicon.glosses)


def test_the_best_priority_has_the_gloss_and_others_are_variants(lexicon: Lexicon, folder: Path) -> None:
    for gloss, file in (("NAME", "c"), ("NAME-2", "b")):
        points, expected = lexicon.clip(gloss).points, ss.load(folder / "sgg" / f"{file}.pose").points
        assert points is not None
        assert expected is not None
        assert np.array_equal(points.values, expected.values)
        assert (points.layout, points.framing) == (expected.layout, expected.framing)


def test_a_word_is_its_span_of_the_film(lexicon: Lexicon, folder: Path) -> None:
    whole, word = ss.load(folder / "sgg" / "d.pose").points, lexicon.clip("MUTTER").points
    assert whole is not None
    assert word is not None
    assert np.array_equal(word.values, whole.values[15:45])


def test_a_sentence_of_them_has_landmarks(lexicon: Lexicon) -> None:
    result = ss.splice([lexicon.clip(gloss) for gloss in ("HALLO1", "NAME", "MUTTER")])
    assert result.clip.points is not None
    assert len(result.clip.points) == len(result.clip)


def test_segments_are_the_spans_of_words(tmp_path: Path) -> None:
    head = f"{HEAD},segment_start,segment_end"
    rows = ("sgg/a.pose,de,sgg,0,2000,hallo,HALLO,0,400,1400", "sgg/b.pose,de,sgg,0,9000,name,NAME,0,0,9000")
    lexicon = open_lexicon(write_folder(tmp_path, rows, head))
    assert len(lexicon.clip("HALLO")) == 30
    assert len(lexicon.clip("NAME")) == len(ss.load(tmp_path / "sgg" / "b.pose")), "a film may be cut shorter"


def test_an_alphabet_has_letters_and_one_language_is_chosen(tmp_path: Path) -> None:
    rows = ("sgg/a.pose,en,ase,0,0,A,A,0", "sgg/b.pose,en,ase,0,0,B,B,0", "sgg/c.pose,el,gss,0,0,Γ,Γ,0")
    folder = write_folder(tmp_path, rows)
    with pytest.raises(InputError, match=r"index\.csv: holds signs of ase, gss: name one of them as the language"):
        open_lexicon(folder)
    with pytest.raises(InputError, match="holds signs of ase, gss: name one"):
        open_lexicon(folder, language="dse")
    assert open_lexicon(folder, language="ase").glosses == ("fs-A", "fs-B")
    assert open_lexicon(folder, language="gss").glosses == ("fs-Γ",)
    build(folder, tmp_path.with_name(f"{tmp_path.name}-built"), language="ase")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("sgg/a.pose,de,sgg,0,0,,,0", "no gloss or no path"),
        ("sgg/a.pose,de,sgg,0,0,a,A,high", "is no table of a lexicon"),
        ("sgg/a.pose,de,sgg,x,0,ab,AB,0", "invalid literal"),
        ("sgg/a.pose,de,swiss,0,0,ab,AB,0", "expected three letters"),
    ],
)
def test_a_wrong_row_has_one_clear_line(row: str, message: str, tmp_path: Path) -> None:
    folder = write_folder(tmp_path, [row])
    with pytest.raises(FormatError, match=rf"index\.csv:2: .*{message}") as error:
        read_index(folder / "index.csv")
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(folder: Path, tmp_path: Path) -> None:
    lexicon = open_lexicon(write_folder(tmp_path, ["sgg/nowhere.pose,de,sgg,0,0,ab,AB,0"]))
    with pytest.raises(InputError, match=r"nowhere\.pose: no such file"):
        lexicon.clip("AB")


def test_a_table_of_another_program_is_not_taken_for_an_index(tmp_path: Path) -> None:
    write_folder(tmp_path, ["1,2"], head="name,size")
    with pytest.raises(InputError, match=r"it has no index\.sqlite"):
        open_lexicon(tmp_path)


def test_a_word_outside_of_the_folder_is_not_read(folder: Path, tmp_path: Path) -> None:
    outside = folder / "sgg" / "a.pose"
    rows = [f"{outside},de,sgg,0,0,ab,AB,0", "../../x/a.pose,de,sgg,0,0,cd,CD,0", "sgg/link.pose,de,sgg,0,0,ef,EF,0"]
    lexicon = open_lexicon(write_folder(tmp_path / "lexicon", rows))
    (tmp_path / "lexicon" / "sgg" / "link.pose").symlink_to(outside)
    for gloss in ("AB", "CD", "EF"):
        with pytest.raises(InputError, match="lies outside the folder"):
            lexicon.clip(gloss)


def test_a_quoted_header_with_spaces_and_a_mark_is_read(tmp_path: Path) -> None:
    write_folder(tmp_path, ["sgg/a.pose,de,sgg,0,0,hallo,HALLO,0"])
    table = tmp_path / "index.csv"
    head = ", ".join(f'"{name}"' for name in HEAD.split(","))
    text = head.replace(", ", ",") + "\r\n" + '"sgg/a.pose",de,sgg,0,0,"hallo","HALLO",0\r\n'
    table.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert open_lexicon(tmp_path).glosses == ("HALLO",)
    table.write_text(HEAD.replace(",", " , ") + "\nsgg/a.pose,de,sgg,0,0,hallo,HALLO,0\n")
    assert open_lexicon(tmp_path).glosses == ("HALLO",)
    table.write_bytes(f"{HEAD}\nsgg/a.pose,de,sgg,0,0,gr\u00fcn,GR\u00dcN,0\n".encode("latin-1"))
    with pytest.raises(FormatError, match=r"index\.csv:2: is not UTF-8"):
        open_lexicon(tmp_path)


def test_a_word_of_one_row_does_not_take_the_gloss_of_another(tmp_path: Path) -> None:
    rows = ("sgg/a.pose,de,sgg,0,0,gebaeude,HAUS,0", "sgg/b.pose,de,sgg,0,0,building,GEBAEUDE,0")
    folder = write_folder(tmp_path, rows)
    points, expected = open_lexicon(folder).clip("gebaeude").points, ss.load(folder / "sgg" / "b.pose").points
    assert points is not None
    assert expected is not None
    assert np.array_equal(points.values, expected.values)


def test_lexicons_of_two_languages_open_together(folder: Path, tmp_path: Path) -> None:
    alphabet = write_folder(tmp_path, ["sgg/a.pose,en,ase,0,0,A,A,0", "sgg/b.pose,en,ase,0,0,B,B,0"])
    for language in ("", "ase", "sgg"):
        lexicon = open_lexicon(folder, alphabet, language=language)
        assert {lexicon.language_of(gloss) for gloss in ("fs-A", "NAME")} == {"ase", "sgg"}


def test_landmarks_that_unpack_to_far_more_than_a_word_are_refused(folder: Path) -> None:
    clip = ss.load(folder / "sgg" / "a.pose")
    assert clip.points is not None
    packed = pose.pack_points(clip.points)
    assert np.array_equal(pose.unpack_points(packed, len(clip)).values, clip.points.values)
    bomb = zlib.compress(zlib.decompress(packed) + bytes(200 << 20))
    with pytest.raises(InputError, match="bytes follow its last frame"):
        pose.unpack_points(bomb, len(clip))
