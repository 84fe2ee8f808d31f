"""An environment of processes in which only the product is installed: nothing of workshop and research, no torch."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from pathlib import Path

ABSENT = ("signsplice_workshop", "signsplice_paper", "torch", "onnx", "onnxscript", "filelock", "matplotlib")
SERVE = ("fastapi", "prometheus_client", "python_multipart", "pydantic", "starlette", "uvicorn", "websockets")
_HOOK = """
import sys
from importlib.machinery import PathFinder

class Absent(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name in ABSENT else super().find_spec(name, path, target)

sys.meta_path[:] = [Absent if finder is PathFinder else finder for finder in sys.meta_path]
"""


@cache
def _folder(absent: tuple[str, ...]) -> str:
    folder = Path(tempfile.mkdtemp(prefix="signsplice-alone-"))
    (folder / "sitecustomize.py").write_text(f"ABSENT = {absent!r}\n{_HOOK}", encoding="utf-8")
    return str(folder)


def environment(absent: tuple[str, ...] = ABSENT) -> dict[str, str]:
    """Variables of such a process and of all that it starts."""
    paths = [_folder(absent), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
