"""An environment of processes in which only the product is installed: nothing of workshop and research, no torch."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from pathlib import Path

ABSENT = ("signsplice_workshop", "signsplice_paper", "torch", "onnx", "onnxscript", "filelock", "matplotlib")
_HOOK = f"""
import sys
from importlib.machinery import PathFinder

class Absent(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name in {ABSENT!r} else super().find_spec(name, path, target)

sys.meta_path[:] = [Absent if finder is PathFinder else finder for finder in sys.meta_path]
"""


@cache
def _folder() -> str:
    folder = Path(tempfile.mkdtemp(prefix="signsplice-alone-"))
    (folder / "sitecustomize.py").write_text(_HOOK, encoding="utf-8")
    return str(folder)


def environment() -> dict[str, str]:
    """Variables of such a process and of all that it starts."""
    paths = [_folder(), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
