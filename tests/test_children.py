"""Processes end with the one that started them, also where that one is killed."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

POOL = """
import os, sys, time
from signsplice_workshop.corpora.pool import Pool

def sleep(file):
    with open(file, "w") as made:
        made.write(str(os.getpid()))
    os.rename(file, file + ".ready")
    time.sleep(600)

with Pool(2) as run:
    list(run(sleep, [sys.argv[1] + "/a", sys.argv[1] + "/b"]))
"""
SUBPROCESS = """
import subprocess, sys
from signsplice.children import parent_death_hook

code = '''
import os, sys, time
open(sys.argv[1], "w").write(str(os.getpid()))
os.rename(sys.argv[1], sys.argv[1] + ".ready")
time.sleep(600)
'''
for name in "ab":
    call = [sys.executable, "-c", code, f"{sys.argv[1]}/{name}"]
    child = subprocess.Popen(call, preexec_fn=parent_death_hook())
child.wait()
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux")
@pytest.mark.parametrize("code", [POOL, SUBPROCESS], ids=["pool", "subprocess"])
def test_children_of_a_killed_process_end(code: str, tmp_path: Path) -> None:
    parent = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.DEVNULL)
    try:
        ready = [tmp_path / "a.ready", tmp_path / "b.ready"]
        wait_until(lambda: all(path.exists() for path in ready))
        children = [int(path.read_text()) for path in ready]
        assert all(map(is_running, children))
    finally:
        parent.kill()
        parent.wait()
    try:
        wait_until(lambda: not any(map(is_running, children)))
    finally:
        for child in filter(is_running, children):
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, 9)


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait until ``condition()`` is true, for a minute at most."""
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.02)


def is_running(process: int) -> bool:
    """Whether a process runs; one that has ended, but is not collected, does not."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state not in "ZX"


WRITING = """
import sys, time
from signsplice.children import processes

def large(mark):
    open(mark, "w").close()
    return bytes(1 << 29)

if __name__ == "__main__":
    try:
        with processes(1) as pool:
            pool.submit(large, sys.argv[1])
            import pathlib
            while not pathlib.Path(sys.argv[1]).exists():
                time.sleep(0.001)
            time.sleep(float(sys.argv[2]))
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        print("ended")
"""


@pytest.mark.parametrize("after_s", [0.2, 0.35, 0.5])
def test_an_interruption_ends_while_a_child_writes_its_result(after_s: float, tmp_path: Path) -> None:
    """Half a gigabyte takes longer to write than the interruption waits, or the child has not begun; both end."""
    (tmp_path / "writing.py").write_text(WRITING, encoding="utf-8")
    command = [sys.executable, "writing.py", "mark", str(after_s)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.stdout == "ended\n", done.stderr
