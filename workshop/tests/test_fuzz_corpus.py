"""Files that once broke a reader, or a splice with what was read: kept by ``attacks/fuzz.py``, read here for ever."""

from __future__ import annotations

from pathlib import Path

import pytest

from fuzz_targets import CORPUS, TARGETS

CASES = sorted(path for path in CORPUS.glob("*/*") if path.is_file())


@pytest.mark.parametrize("path", CASES, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_a_file_that_broke_a_reader_is_read_as_it_is_or_refused_in_one_line(path: Path, tmp_path: Path) -> None:
    target, content = TARGETS[path.parent.name], path.read_bytes()
    loaded, was_used = target.exercise(content, tmp_path)  # raises for any other error
    assert was_used in (True, False)
    target.judge(content, loaded)  # raises for another motion than the file's


@pytest.mark.parametrize("name", TARGETS)
def test_what_fuzzing_starts_from_is_read_and_used(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    for content in dict.fromkeys(target.seeds()):
        loaded, was_used = target.exercise(content, tmp_path)
        assert was_used
        assert target.judge(content, loaded) == (target.oracle is not None)
