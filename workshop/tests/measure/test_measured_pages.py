"""The pages of workshop/docs/measured are what `workshop/runs/measured.py` writes of the figures beside them."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
MEASURED = ROOT / "docs" / "measured"
SCRIPT = ROOT / "runs" / "measured.py"
if not SCRIPT.exists():
    pytest.skip("a source distribution has no runs/", allow_module_level=True)


def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("measured", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["measured"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


measured = script()


@pytest.mark.parametrize("name", measured.PAGES)
def test_a_page_is_that_of_its_figures_and_begins_with_its_finding(name: str) -> None:
    text, table = measured.make_page(name)
    assert (MEASURED / f"{name}.md").read_text(encoding="utf-8") == text
    assert not table or (MEASURED / f"{name}.csv").read_text(encoding="utf-8") == table
    assert text.splitlines()[2].startswith("- ")
    assert len(text.split()) <= (600 if name in ("bodies", "hidden-frames") else 1000)
    assert all(len(line) <= 320 for line in text.splitlines() if not line.startswith("|"))


def test_the_page_of_the_corpus_repeats_the_measured_findings() -> None:
    findings = (MEASURED / "corpus.md").read_text(encoding="utf-8")
    text = " ".join((MEASURED.parent / "corpus.md").read_text(encoding="utf-8").split())
    agree = re.search(r"\d+ of \d+ figures agree with real signing", findings)
    (by_word,) = re.findall(r"the most frequent cut of each word in ([\d.]+) %", findings)
    (reader,) = re.findall(r"sees to 5 mm gets both frames right in ([\d.]+) %", findings)
    assert agree is not None
    assert agree[0] in text
    assert f"every single word does in {float(by_word):.0f} %" in text
    assert f"gets both frames right in {float(reader):.0f} % of the pairs" in text


def test_findings_follow_from_the_figures() -> None:
    found = {name: json.loads((MEASURED / f"{name}.json").read_text()) for name in measured.RESTS.values()}
    rows = {row["method"]: row for row in found["joins"]["rows"]}
    assert f"keeps all movements of both signs in {100 * rows[measured.DEFAULT]['whole']:.1f} %" in " ".join(
        measured.make_seams_page(found)[0]
    )
    rows["pose-velocity + linear"]["velocity_jump"] = 0.111
    assert "is 0.11 (`pose-velocity + linear`)" in " ".join(" ".join(measured.make_seams_page(found)[0]).split())


def test_a_page_names_what_made_its_figures() -> None:
    made = {"commit": "c" * 40, "version": "1.2", "n_words": 223, "words": "a" * 64, "bundle": "b" * 64}
    (line,) = measured.format_versions([{"made_with": made}, {"made_with": made}])
    assert line == (
        f"Made at commit `{'c' * 40}` (version 1.2): the 223 words that ship (sha256 `aaaaaaaaaaaa`), networks "
        "`bbbbbbbbbbbb`."
    )


def test_a_measurement_is_not_made_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    class Done:
        stdout = '{"signature": "s", "rows": []}'

    def run(words: list[str], **_: object) -> type[Done]:
        calls.append(words)
        return Done

    monkeypatch.setattr(measured, "run", run)
    monkeypatch.setattr(measured, "stamp", lambda: {"commit": "c"})
    for _ in range(2):
        figures = measured.measure("tempo", "evaluate tempo 7 --json", tmp_path, None)
        assert figures == {"made_with": {"commit": "c"}, "signature": "s", "rows": []}
    assert calls == [["evaluate", "tempo", "7", "--json"]]


def test_pages_of_real_clips_are_skipped_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measured, "git", lambda *_: "")
    monkeypatch.setattr(sys, "argv", ["measured.py", "hidden-frames", "corpus", "--small", str(tmp_path)])
    measured.main()
    assert capsys.readouterr().err.splitlines() == [
        "hidden-frames: skipped, needs long_take_metres.bvh and isl_thanks.bvh: REAL=DIR names their folder",
        "corpus: skipped, needs long_take_metres.bvh: REAL=DIR names their folder",
    ]


@pytest.mark.slow
def test_the_commands_of_the_pages_run_and_give_what_the_pages_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["seams", "bodies", "tempo", "person", "bench"]
    monkeypatch.setattr(measured, "git", lambda *_: "0" * 40)
    monkeypatch.setattr(sys, "argv", ["measured.py", *names, "--small", str(tmp_path)])
    measured.main()
    for name in names:
        assert "Made at commit `0000" in (tmp_path / f"{name}.md").read_text()
