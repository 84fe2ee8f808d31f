"""onnxruntime is imported in one place, with its telemetry off before the import."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from signsplice.splicing.runtime import SWITCH

_STRANGER = "import sys, types; sys.modules['onnxruntime'] = o = types.ModuleType('onnxruntime')\n"
_STRANGER += "o.disable_telemetry_events = lambda: None\n"
_ITSELF = "import signsplice.splicing.runtime, signsplice.splicing.bundle\n"
_ITSELF += "from signsplice.splicing.runtime import onnxruntime\n"


def run(code: str, folder: Path, switch: str | None = None) -> str:
    """What a fresh process writes to standard error; its home and temporary folder are ``folder``."""
    environment = {key: value for key, value in os.environ.items() if key != SWITCH and not key.startswith("XDG_")}
    environment |= {"HOME": str(folder), "TMPDIR": str(folder)} | ({} if switch is None else {SWITCH: switch})
    call = [sys.executable, "-B", "-W", "default", "-c", code]
    return subprocess.run(call, env=environment, capture_output=True, text=True, check=True, timeout=120).stderr


def test_the_runtime_leaves_nothing_in_home_and_temporary_folder(tmp_path: Path) -> None:
    words = "words = signsplice.open_lexicon(); signsplice.splice([words.clip('I'), words.clip('SIGN')])"
    assert run(f"import signsplice; {words}", tmp_path) == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("switch", [None, "0", "false", ""])
def test_who_imported_the_runtime_first_is_warned_once(switch: str | None, tmp_path: Path) -> None:
    said = run(_STRANGER + _ITSELF, tmp_path, switch)
    assert said.count("UserWarning") == 1
    assert f"set {SWITCH}=1 in the environment" in said


@pytest.mark.parametrize("switch", ["1", "true", "YES"])
def test_who_switched_it_off_before_is_not_warned(switch: str, tmp_path: Path) -> None:
    assert run(_STRANGER + _ITSELF, tmp_path, switch) == ""


def test_children_inherit_the_switch(tmp_path: Path) -> None:
    child = f"import os; assert os.environ['{SWITCH}'] == '1'"
    code = f"{_STRANGER.splitlines()[0]}\n{_STRANGER}{_ITSELF}"
    run(code + f"import subprocess; subprocess.run([sys.executable, '-c', {child!r}], check=True)", tmp_path)
