"""The page of a corpus: tables between its marks, pictures in a folder."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from signing import made, sign, word
from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.motion import Clip, concatenate, rotation
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import TRANSITIONS, find_transition
from signsplice.splicing.cutters import CUTTERS
from signsplice_workshop.corpora import pseudo
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs
from signsplice_workshop.measure import corpus_checks, corpus_page, corpus_pictures, corpus_realism
from signsplice_workshop.measure.corpus_difficulty import BY_WORD
from signsplice_workshop.measure.measures import format_table, parse_tables

DOCS = Path(__file__).parents[2] / "docs" / "measured" / "corpus.md"
FORWARD = "X shape=1 at=space palm=down fingers=fwd", "M shift=0,0,14", "H"
UPWARD = "X shape=1 at=space palm=down fingers=fwd", "M shift=0,14,0", "H"


@contextlib.contextmanager
def quiet(what: str) -> Iterator[None]:
    yield None


def without_measuring(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corpus_pictures, "check_matplotlib", lambda: None)
    monkeypatch.setattr(corpus_page, "_format_realism", lambda *a: ["### Realism", "", "| a | b |", ""])
    monkeypatch.setattr(corpus_page, "_format_difficulty", lambda *a: ["### Difficulty"])
    monkeypatch.setattr(corpus_page, "_format_validity", lambda *a: ["### Validity"])
    monkeypatch.setattr(corpus_pictures, "write_sheets", lambda *a: None)
    monkeypatch.setattr(corpus_page, "shorten", lambda lines, _: lines)


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
    assert (
        f"Corpus `{pairs.head['hash']}`, version {pairs.version}: 28 pairs, truth by partner, seed 0, 30 fps." in middle
    )
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
    monkeypatch.setattr(corpus_realism, "N_PSEUDO", 2)
    monkeypatch.setattr(corpus_pictures, "N_ROWS", 2)
    real = {"a-clip": word("LEARN", 3).clip, "drawn": keyed()}
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
        "| strong upper arm, rms | degrees/s |",
        " figures agree with real signing in all that can be compared.",
        "- Pairs with a hand deeper than 5 mm: ",
        "| quantity | corpus | a-clip | drawn (keyed) |",
        "drawn is no measure of real motion (keyed: ",
    ):
        assert part in text
    assert "| drawn; n = " not in text, "no figure is held against a keyed clip"
    assert "| pairs that differ in any bit, of 25 drawn and planned anew | 0 |" in text
    assert "of 20, whose touch is not flagged, or flagged and not seen | 0, 0 |" in text
    assert "| within one frame |" in text
    assert "Thumb 1" not in text
    assert "Realism,1,Thumb 1,a-clip," in page.with_suffix(".csv").read_text()
    assert (images / "corpus-realism.png").stat().st_size > 10_000
    # A method that is newer than the committed page has no row there yet.
    methods = {f"| {name} |" for name in (*CUTTERS, *TRANSITIONS)}
    differing = (labels(text) ^ labels(DOCS.read_text())) - methods
    assert differing <= {f"| {BY_WORD} |"}, "docs/measured/corpus.md is of another generator: make measured-corpus"
    for line in text.splitlines():
        if line.startswith("!["):
            name = line.partition("](")[2].rstrip(")")
            assert (tmp_path / name).exists(), line
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in tables)


def labels(text: str) -> set[str]:
    """What is the same on every page: headings, and of tables that compare no clip the heads and first cells."""
    shown = text[text.index(corpus_page.BEGIN) : text.index(corpus_page.END)].partition("### Difficulty")
    rows = [line for line in shown[2].splitlines() if line.startswith("|")]
    heads = [line for line in shown[0].splitlines() if line.startswith("| quantity | unit")]
    found = [*heads, *(row[: row.index("|", 1) + 1] for row in rows), *re.findall("###.*", text)]
    return {re.sub(r"\d+", "N", line).replace("-N", "+N") for line in found}


def test_tables_are_found_with_their_sections() -> None:
    lines = [
        "### A",
        "",
        "Two",
        "lines:",
        "",
        *format_table(("a", "b"), [(1, 2), (3, "x")]),
        "",
        "## B",
        *format_table("c", "d"),
    ]
    first, second = parse_tables(lines)
    assert first == {"section": "A", "text": "Two lines:", "rows": [{"a": "1", "b": "2"}, {"a": "3", "b": "x"}]}
    assert (second["section"], second["rows"]) == ("B", [{"c": "d"}])


def keyed() -> Clip:
    """A word whose every twelfth frame is a key, with slerp between."""
    signed = word("LEARN").clip
    keys = [signed[k : k + 1] for k in range(10, len(signed), 12)]
    slerp = find_transition("slerp")
    return concatenate([part for a, b in pairwise(keys) for part in (a, slerp.between(Gap(a, b, 11)))])


def test_sheets_show_the_side_where_the_hand_moves_forward(pairs: Pairs) -> None:
    strips = corpus_pictures._add_side_view(corpus_pictures._word_strip(made(*FORWARD)))
    assert [(strip.view, strip.caption) for strip in strips] == [("front", "WORD"), ("side", "WORD, from the side")]
    assert len(corpus_pictures._add_side_view(corpus_pictures._word_strip(made(*UPWARD)))) == 1
    left_handed = Pairs(pairs.folder)
    left_handed.signers = tuple(replace(one, left_handed=True) for one in pairs.signers)
    assert [corpus_pictures._pair_strip(one, 0).hand for one in (pairs, left_handed)] == ["right", "left"]


def test_pseudo_signs_are_known_by_their_gloss(tmp_path: Path) -> None:
    recipe = Recipe((pseudo.draw_sign(0), sign("I")), seed=1, n_other=0)
    corpus = Pairs(write_pairs(recipe, tmp_path / "pairs", processes=1))
    signs = corpus_page.signs_by_gloss(corpus)
    assert signs["PSEUDO-0"] == pseudo.draw_sign(0)
    assert corpus_checks.replan(corpus, signs) == (4, 0)


def test_real_clips_are_those_that_move(tmp_path: Path) -> None:
    still = word("I").clip[:5]
    for name, clip in (("signing", word("I").clip), ("Idle-1", word("BOOK").clip), ("still", still)):
        save(clip, tmp_path / f"{name}.bvh")
    (tmp_path / "notes.txt").write_text("no clip")
    assert list(corpus_page.load_real_clips(tmp_path)) == ["signing"]
    assert corpus_page.load_real_clips(None) == {}


def test_only_a_range_of_each_real_clip_is_taken(tmp_path: Path) -> None:
    clip = word("MOTHER").clip
    save(clip, tmp_path / "signing.bvh")
    (name, part), *more = corpus_page.load_real_clips(tmp_path, (10, 50)).items()
    assert (name, len(part), more) == ("signing, frames 10 to 49", 40, [])
    assert rotation.angle_between(part.local_rotations, clip[10:50].local_rotations).max() < 1e-4
    (whole,) = corpus_page.load_real_clips(tmp_path, (0, 10_000))
    assert whole == f"signing, frames 0 to {len(clip) - 1}"
    for frames, n in (((0, 20), 20), ((10_000, 10_100), 0)):
        with pytest.raises(InputError, match=rf"signing\.bvh: has {n} frames in {frames[0]}:.*expected at least 34"):
            corpus_page.load_real_clips(tmp_path, frames)
