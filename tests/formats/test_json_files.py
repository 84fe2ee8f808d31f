"""formats.json_files: whatever a JSON file holds is values of the types asked for, or one line that says where."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from signsplice.errors import FormatError, LimitError
from signsplice.formats import json_files
from signsplice.formats.json_files import check_type, parse_json, read_json


def test_json_is_read_with_or_without_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('\ufeff{"a": [1, 2.5, null, "é", "\\ud83d\\ude00"]}', encoding="utf-8")
    assert read_json(path, "an object") == {"a": [1, 2.5, None, "é", "😀"]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"a": 1,\n"b": }', "a.json:2: is no JSON (Expecting value), expected an object"),
        (b"", "a.json:1: is no JSON"),
        (b'"\xff"', "valid UTF-8"),
        (b'"\\ud800"', "valid UTF-8"),
        (b'"\\uD83d"', "valid UTF-8"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a":' * 50_000, "nested too deeply"),
        (b"9" * 5000, "4300 digits"),
        (b"[NaN]", "NaN is no number of JSON"),
        (b"-Infinity", "-Infinity is no number of JSON"),
    ],
)
def test_what_is_no_json_is_refused_in_one_line(content: bytes, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        parse_json(content, "a.json", "an object")
    text = str(caught.value)
    assert text.startswith("a.json:")
    assert message in text
    assert len(text.splitlines()) == 1


def test_a_large_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    path.write_text("[" + "1," * 100 + "1]")
    monkeypatch.setattr(json_files, "MOST_BYTES", 100)
    with pytest.raises(LimitError, match=r"a\.json"):
        read_json(path, "a list")


ROWS: list[tuple[Any, list[Any], list[Any]]] = [
    (str, ["", "a"], [None, 1, ["a"]]),
    (bool, [True, False], [0, 1, None, "true"]),
    (int, [0, -5, 2**63 - 1], [True, 1.0, "1", None, 2**63, 10**400]),
    (float, [0, 1.5, -2], [True, "1", None, float("inf"), float("nan"), 10**400]),
    (str | None, ["a", None], [1, []]),
    (Annotated[float, "null for NaN"], [1.0, None], ["a"]),
    (Literal["sign", "transition"], ["sign"], ["other", 1, ["sign"], None]),
    (tuple[int, int], [[1, 2]], [[1], [1, 2, 3], "12", [1, None], {"a": 1}]),
    (tuple[int, int] | None, [[1, 2], None], [[1]]),
    (tuple[str, ...], [[], ["a", "b"]], ["ab", [1], {"a": 1}]),
    (list[dict[str, Any]], [[], [{"a": 1}]], [[1], {"a": 1}, [None]]),
    (Mapping[str, str], [{}, {"a": "b"}], [{"a": 1}, [], "a", None]),
]


@pytest.mark.parametrize(("kind", "right", "wrong"), ROWS, ids=[str(row[0]) for row in ROWS])
def test_types_are_told_apart(kind: Any, right: list[Any], wrong: list[Any]) -> None:
    for value in right:
        check_type(value, kind, "here")
    for value in wrong:
        with pytest.raises(TypeError, match=r"^here: found .*, expected "):
            check_type(value, kind, "here")
