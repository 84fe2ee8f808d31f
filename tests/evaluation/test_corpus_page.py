"""The page of a corpus: tables between its marks, pictures in a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from signing import sign, word
from signsplice.errors import InputError
from signsplice.evaluation import corpus_checks, corpus_page, corpus_pictures
from signsplice.formats import save
from signsplice.synth import pseudo
from signsplice.synth.corpus import Pairs, Recipe, write_pairs


@contextlib.contextmanager
def quiet(what: str) -> Iterator[None]:
    yield None


def without_measuring(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corpus_pictures, "check_matplotlib", lambda: None)
    monkeypatch.setattr(corpus_page, "_realism", lambda *a: ["### Realism", "", "| a | b |", ""])
    monkeypatch.setattr(corpus_page, "_difficulty", lambda *a: ["### Difficulty"])
    monkeypatch.setattr(corpus_page, "_validity", lambda *a: ["### Validity"])
    monkeypatch.setattr(corpus_pictures, "write_sheets", lambda *a: None)


def test_a_page_is_filled_between_its_marks_alone(
    pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_measuring(monkeypatch)
    page = tmp_path / "page.md"
    before, after = "# Corpus\n\nText — with ümlauts.\n\n", "\n\n## More\n"
    page.write_text(f"{before}{corpus_page.BEGIN}\nold, old\n{corpus_page.END}{after}", encoding="utf-8")
    corpus_page.write(pairs, page, tmp_path, {}, quiet)
    text = page.read_text(encoding="utf-8")
    assert text.startswith(before + corpus_page.BEGIN)
    assert text.endswith(corpus_page.END + after)
    assert "old, old" not in text
    middle = text[text.index(corpus_page.BEGIN) : text.index(corpus_page.END)]
    assert f"Corpus `{pairs.head['hash']}`, version 2: 28 pairs, truth by partner, seed 0, 30 fps." in middle
    assert [line for line in middle.splitlines() if line.startswith("###")] == [
        *("### Realism", "### Difficulty", "### Validity")
    ]
    corpus_page.write(pairs, page, tmp_path, {}, quiet)
    assert page.read_text(encoding="utf-8") == text, "written again it is the same"


@pytest.mark.parametrize("text", ["# Nothing\n", "only <!-- measured: begin -->\n", "only <!-- measured: end -->\n"])
def test_a_page_without_marks_is_refused_and_kept(
    text: str, pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_measuring(monkeypatch)
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(InputError, match=r"page\.md: has no lines .* expected both") as caught:
        corpus_page.write(pairs, page, tmp_path, {}, quiet)
    assert "\n" not in str(caught.value)
    assert page.read_text() == text
    with pytest.raises(InputError, match="no such file"):
        corpus_page.write(pairs, tmp_path / "none.md", tmp_path, {}, quiet)


def test_a_whole_page_of_a_small_corpus(pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("PIL")
    monkeypatch.setattr(corpus_pictures, "SHEET_WORDS", ("I", "BOOK"))
    monkeypatch.setattr(corpus_pictures, "_write_letters", lambda letters, path: path.write_bytes(b"letters"))
    monkeypatch.setattr(
        corpus_pictures, "write_strips", lambda strips, path, **more: path.write_bytes(b"%d" % len(strips))
    )
    page, images = tmp_path / "page.md", tmp_path / "images"
    images.mkdir()
    page.write_text(f"# Corpus\n{corpus_page.BEGIN}\n{corpus_page.END}\n")
    real = {"a-clip": word("LEARN", 3).clip}
    corpus_page.write(pairs, page, images, real, quiet)
    text = page.read_text()
    for part in (
        "### Realism",
        "### Difficulty",
        "### Validity",
        "a-clip",
        "pose-velocity",
        "hermite",
        "Over all 28 pairs",
    ):
        assert part in text
    assert "| pairs that differ in any bit, of 25 drawn and planned anew | 0 |" in text
    assert "of 20, whose touch is not flagged, or flagged and not seen | 0, 0 |" in text
    assert "| within one frame |" in text
    assert (images / "corpus-realism.png").stat().st_size > 10_000
    for line in text.splitlines():
        if line.startswith("!["):
            name = line.partition("](")[2].rstrip(")")
            assert (tmp_path / name).exists(), line
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in tables)


def test_pseudo_signs_are_known_by_their_gloss(tmp_path: Path) -> None:
    recipe = Recipe((pseudo.sign(0), sign("I")), seed=1, n_other=0)
    made = Pairs(write_pairs(recipe, tmp_path / "pairs", processes=1))
    signs = corpus_page.known_signs(made)
    assert signs["PSEUDO-0"] == pseudo.sign(0)
    assert corpus_checks.replan(made, signs) == (4, 0)


def test_real_clips_are_those_that_move(tmp_path: Path) -> None:
    still = word("I").clip[:5]
    for name, clip in (("signing", word("I").clip), ("Idle-1", word("BOOK").clip), ("still", still)):
        save(clip, tmp_path / f"{name}.bvh")
    (tmp_path / "notes.txt").write_text("no clip")
    assert list(corpus_page.read_real(tmp_path)) == ["signing"]
    assert corpus_page.read_real(None) == {}
