"""Recipes: read, checked, drawn, all pairs."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from decimal import Decimal
from itertools import permutations
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from signsplice.bulk import drawing, recipes, shards
from signsplice.bulk.recipes import SentenceRecipe
from signsplice.errors import FormatError, InputError
from signsplice.lexicon import open_shipped_lexicon

ROWS = [
    SentenceRecipe(("HELLO", "I"), sign_speed=1.25, transition_time="0.3", seed=7),
    SentenceRecipe(("fs-ANNA",), signer="standard", fps=60.0, tempo="natural", cutter="pose-velocity", spell=False),
    SentenceRecipe(("YES", "NO", "YES"), avoid_collisions=False),
]


def rows_of(path: Path) -> list[SentenceRecipe]:
    return [row for batch in recipes.read(path) for row in recipes.recipes_of(batch)]


@pytest.mark.parametrize("name", ["r.csv", "r.parquet"])
def test_recipes_come_back_as_they_were_written(tmp_path: Path, name: str) -> None:
    assert recipes.write(tmp_path / name, [recipes.batch_of(ROWS)]) == 3
    assert rows_of(tmp_path / name) == ROWS


def test_only_glosses_are_needed_and_numbers_may_be_numbers(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("glosses,tempo\n  HELLO   I ,\nYES,0.8\n")
    assert rows_of(tmp_path / "r.csv") == [SentenceRecipe(("HELLO", "I")), SentenceRecipe(("YES",), tempo="0.8")]
    pq.write_table(pa.table({"glosses": [["YES"]], "transition_time": [0.25], "seed": [3.0]}), tmp_path / "r.parquet")
    assert rows_of(tmp_path / "r.parquet") == [SentenceRecipe(("YES",), transition_time="0.25", seed=3)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("glosses,tone\nYES,1\n", "column 'tone', expected glosses and any other of signer, seed"),
        ("gloss\nYES\n", "column 'gloss', expected glosses"),
        ("glosses,sign_speed\nYES,fast\n", "column sign_speed: .*fast.*expected double"),
        ("glosses,seed\n,1\n", "column glosses: a row has no glosses"),
        ("", "is no valid table of recipes"),
        ("glosses,seed,seed\nYES,1,2\n", "column seed is there 2 times, expected once"),
    ],
)
def test_wrong_tables_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(FormatError, match=message) as error:
        rows_of(tmp_path / "r.csv")
    assert str(error.value).startswith(str(tmp_path / "r.csv"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", [pa.large_string(), pa.string_view()])
@pytest.mark.parametrize("as_list", [False, True])
def test_every_kind_of_text_is_read(tmp_path: Path, kind: pa.DataType, as_list: bool) -> None:
    glosses = pa.array([["YES", "I"], ["NO"]], pa.list_(kind)) if as_list else pa.array([" YES I", "NO"], kind)
    table = {"glosses": glosses, "signer": pa.array(["kim", None], kind), "fps": pa.array(["25", None], kind)}
    pq.write_table(pa.table(table), tmp_path / "r.parquet")
    expected = [SentenceRecipe(("YES", "I"), signer="kim", fps=25.0), SentenceRecipe(("NO",))]
    assert rows_of(tmp_path / "r.parquet") == expected


@pytest.mark.parametrize(
    ("value", "kind", "text"),
    [
        (12345678, pa.int64(), "12345678"),
        (12345678.0, pa.float64(), "12345678"),
        (0.123456789, pa.float64(), "0.123456789"),
        (0.3, pa.float32(), "0.3"),
        (2.0, pa.float64(), "2"),
        (Decimal("0.25"), pa.decimal128(5, 2), "0.25"),
        (float("nan"), pa.float64(), ""),
        (None, pa.int64(), ""),
    ],
)
def test_numbers_in_columns_of_text_keep_their_digits(
    tmp_path: Path, value: object, kind: pa.DataType, text: str
) -> None:
    pq.write_table(pa.table({"glosses": ["YES"], "signer": pa.array([value], kind)}), tmp_path / "r.parquet")
    assert rows_of(tmp_path / "r.parquet")[0].signer == text


def test_nan_is_left_out_and_the_same_when_read_again(tmp_path: Path) -> None:
    nan = [float("nan")]
    numbers = dict.fromkeys(("sign_speed", "fps", "seed", "transition_time", "avoid_collisions"), nan)
    pq.write_table(pa.table({"glosses": ["YES"], **numbers}), tmp_path / "r.parquet")
    (tmp_path / "r.csv").write_text("glosses,sign_speed,fps\nYES,nan,NaN\n")
    for name in ("r.parquet", "r.csv"):
        assert rows_of(tmp_path / name) == [SentenceRecipe(("YES",))]
        recipes.write(tmp_path / "stored.parquet", recipes.read(tmp_path / name))
        assert recipes.is_same(tmp_path / "stored.parquet", recipes.read(tmp_path / name))


def test_a_parquet_file_with_a_column_twice_or_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.parquet"
    pq.write_table(pa.Table.from_arrays([pa.array(["YES"])] * 2, names=["glosses", "glosses"]), path)
    with pytest.raises(FormatError, match="column glosses is there 2 times, expected once"):
        rows_of(path)
    pq.write_table(pa.table({"glosses": ["YES"], "tempo": [True]}), path)
    with pytest.raises(FormatError, match="column tempo: 'True' is no text and no number, expected string"):
        rows_of(path)


def no_utf8(n: int) -> pa.Array:
    return pa.Array.from_buffers(pa.string(), n, pa.array([b"\xffA"] * n, pa.binary()).buffers())


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"glosses": ["YES"], "signer": no_utf8(1)}, "column signer: .*UTF8.*, expected string"),
        ({"glosses": pa.ListArray.from_arrays([0, 1], no_utf8(1))}, "column glosses: .*UTF8.*, expected list"),
        ({b"glosses\xff": ["YES"]}, "is no valid table of recipes .*utf-8"),
        ({"glosses": ["YES"], "tempo": pa.array([2**31 - 1], pa.date32())}, "column tempo: .*, expected string"),
        ({"glosses": pa.array([None], pa.string())}, "column glosses: a row has no glosses"),
        ({"glosses": [[["YES"]]]}, "column glosses: .*, expected list"),
        ({"glosses": [["YES", None]]}, "column glosses: a row has no glosses, or null among them"),
    ],
)
def test_text_that_is_no_utf8_and_other_types_are_refused_in_one_line(
    tmp_path: Path, table: dict[str, Any], message: str
) -> None:
    path = tmp_path / "r.parquet"
    pq.write_table(pa.Table.from_arrays([pa.array(column) if isinstance(column, list) else column
                                         for column in table.values()], names=list(table)), path)  # fmt: skip
    with pytest.raises(FormatError, match=message) as error:
        rows_of(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    for name in ("r.csv", "r.parquet"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(InputError, match="is a pipe, expected a regular file"):
            rows_of(tmp_path / name)


@pytest.mark.parametrize("broken", ["missing", "folder", "cut", "other", "short"])
def test_a_broken_file_of_recipes_is_named(tmp_path: Path, broken: str) -> None:
    path = tmp_path / "r.parquet"
    batch = recipes.batch_of(ROWS)
    if broken == "folder":
        path.mkdir()
    elif broken == "other":
        pq.write_table(pa.table({"a": [1, 2, 3]}), path)
    elif broken != "missing":
        recipes.write(path, [batch[:2]])
    if broken == "cut":
        path.write_bytes(path.read_bytes()[:300])
    told = f"^{re.escape(str(path))}: cannot be read as the recipes .*put that file back, or name a new folder$"
    for start, stop in ((0, 3), (recipes.ROWS, recipes.ROWS + 1)):
        with pytest.raises(FormatError, match=told):
            recipes.rows(path, start, stop)
    if broken in ("other", "short"):
        assert not recipes.is_same(path, [batch])
    else:
        with pytest.raises(FormatError, match=told):
            recipes.is_same(path, [batch])


@pytest.mark.parametrize("broken", ["folder", "cut", "other", "short", "swapped"])
def test_a_broken_file_of_the_index_is_named(tmp_path: Path, broken: str) -> None:
    path = tmp_path / "r.parquet"
    good = pa.table({"row": [4, 5], "motion_sha256": ["a", None]})
    pq.write_table(good, path)
    assert [shards._motion_of(path, row, row - 4) for row in (4, 5)] == ["a", None]
    if broken == "folder":
        path.unlink()
        path.mkdir()
    elif broken == "cut":
        path.write_bytes(path.read_bytes()[:300])
    else:
        swapped = pa.table({"row": [6, 7], "motion_sha256": ["a", "b"]})
        pq.write_table({"other": pa.table({"a": [1]}), "short": good[:1], "swapped": swapped}[broken], path)
    told = (
        f"^{re.escape(str(path))}: cannot be read as the index of row 5 .*; remove it, and the call .* makes it anew$"
    )
    with pytest.raises(FormatError, match=told):
        shards._motion_of(path, 5, 1)


def test_any_stretch_of_a_long_file_is_found(tmp_path: Path) -> None:
    glosses = [f"W{k}" for k in range(300)]
    batches = list(drawing.pairs(glosses))
    assert [len(batch) for batch in batches] == [recipes.ROWS, 300 * 299 - recipes.ROWS]
    recipes.write(tmp_path / "r.parquet", batches)
    across = recipes.rows(tmp_path / "r.parquet", recipes.ROWS - 2, recipes.ROWS + 3)
    assert across == [*recipes.recipes_of(batches[0][-2:]), *recipes.recipes_of(batches[1][:3])]
    assert recipes.is_same(tmp_path / "r.parquet", drawing.pairs(glosses))
    assert not recipes.is_same(tmp_path / "r.parquet", batches[:1])
    assert not recipes.is_same(tmp_path / "r.parquet", drawing.pairs(glosses, dials={"sign_speed": 1.1}))


def test_all_ordered_pairs_come_once_and_near_ones_share_words() -> None:
    glosses = [f"W{k}" for k in range(230)]
    pairs = [tuple(row) for batch in drawing.pairs(glosses) for row in batch.column("glosses").to_pylist()]
    assert sorted(pairs) == sorted(permutations(glosses, 2))
    for start in range(0, len(pairs), 5000):
        assert len({gloss for pair in pairs[start : start + 1000] for gloss in pair}) < 250
    drawn = [tuple(row) for batch in drawing.pairs(glosses, 500, 3) for row in batch.column("glosses").to_pylist()]
    again = [tuple(row) for batch in drawing.pairs(glosses, 500, 3) for row in batch.column("glosses").to_pylist()]
    other = [tuple(row) for batch in drawing.pairs(glosses, 500, 4) for row in batch.column("glosses").to_pylist()]
    assert drawn == again != other
    assert len(set(drawn)) == 500
    assert set(drawn) < set(pairs)
    with pytest.raises(InputError, match="count 52671, expected 1 to 52,670"):
        next(drawing.pairs(glosses, 52671))


def test_drawn_sentences_follow_the_seed_alone() -> None:
    def draw(count: int, seed: int) -> list[SentenceRecipe]:
        ranges = {"sign_speed": (0.8, 1.2), "transition_time": (0.1, 0.4)}
        batches = drawing.random_recipes("ABCDE", count, (2, 6), seed, ("kim", "lee"), ranges, {"tempo": "natural"})
        return [row for batch in batches for row in recipes.recipes_of(batch)]

    rows = draw(400, 1)
    assert draw(50, 1) == rows[:50] != draw(50, 2)
    assert {len(row.glosses) for row in rows} == {2, 3, 4, 5, 6}
    assert all(before != after for row in rows for before, after in zip(row.glosses, row.glosses[1:], strict=False))
    assert {row.signer for row in rows} == {"kim", "lee"}
    assert {row.tempo for row in rows} == {"natural"}
    assert all(0.8 <= row.sign_speed <= 1.2 and 0.1 <= float(row.transition_time) <= 0.4 for row in rows)


def test_lines_are_read_as_sentence_reads_them(tmp_path: Path) -> None:
    (tmp_path / "lines.txt").write_text("hello, I deaf\n\nthank you fs-anna! 👋 ?\n你 HELLO\n")
    with open_shipped_lexicon() as words:
        batches, warnings = drawing.lines(tmp_path / "lines.txt", words)
    found = [row.glosses for batch in batches for row in recipes.recipes_of(batch)]
    assert found == [("HELLO,", "I", "DEAF"), ("THANK-YOU", "fs-ANNA?"), ("HELLO",)]
    assert len(warnings) == 2
    assert warnings[1].startswith(f"{tmp_path / 'lines.txt'}:4: ")


def test_every_field_decides_the_hash() -> None:
    one = SentenceRecipe(("YES",))
    other: dict[str, Any] = {"glosses": ("NO",), "signer": "a", "seed": 1, "transition_time": "0.2", "sign_speed": 1.1}
    other |= {"tempo": "0.8", "fps": 25.0, "cutter": "ends", "transition": "linear", "free_hand": "transition"}
    other |= {"avoid_collisions": True, "spell": False, "pauses": False, "face_rules": True, "person": 0.5}
    changed = [replace(one, **{name: value}) for name, value in other.items()]
    assert len({row.sha256 for row in (one, *changed)}) == 16
    assert replace(one).sha256 == one.sha256


def test_a_recipe_has_the_hash_that_it_had_before_a_field_came() -> None:
    recipe = SentenceRecipe(("YES", "NO"), free_hand="transition")
    assert recipe.sha256 == "056aab296a7880692708214cb3755fda35b3e27665341643fc9947e66168b55a"


def test_the_seed_of_a_recipe_is_that_of_its_sentence() -> None:
    options = SentenceRecipe(("YES", "NO"), seed=7, person=0.5).options(None)
    assert (options.seed, options.person, options.free_hand) == (7, 0.5, "natural")


def test_a_table_without_the_new_columns_has_their_defaults_and_keeps_its_free_hand(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("glosses,seed,free_hand\nYES NO,3,transition\nNO,,\n")
    expected = [SentenceRecipe(("YES", "NO"), seed=3, free_hand="transition"), SentenceRecipe(("NO",))]
    assert rows_of(tmp_path / "r.csv") == expected
    assert [(row.free_hand, row.person) for row in expected] == [("transition", 1.0), ("natural", 1.0)]


@pytest.mark.parametrize("count", [None, 6, 4])
def test_every_pair_has_the_seed(count: int | None) -> None:
    pairs = [row for batch in drawing.pairs("ABC", count, 3) for row in recipes.recipes_of(batch)]
    assert {row.seed for row in pairs} == {3}


@pytest.mark.parametrize("missing", ["face_rules", "person"])
def test_recipes_from_before_a_field_came_are_the_same(missing: str, tmp_path: Path) -> None:
    batch = recipes.batch_of([SentenceRecipe(("YES", "NO"))])
    older = batch.select([name for name in batch.schema.names if name != missing])
    with pq.ParquetWriter(tmp_path / "r.parquet", older.schema) as file:
        file.write_batch(older)
    assert recipes.is_same(tmp_path / "r.parquet", [batch])
    assert not recipes.is_same(tmp_path / "r.parquet", [recipes.batch_of([SentenceRecipe(("YES",), face_rules=True)])])
