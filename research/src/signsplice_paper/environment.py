"""The environment of a result, stored with every row: commit, versions and machine."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

N_HEX = 12
"""Digits of a commit."""
COMMIT_VARIABLE = "SIGNSPLICE_COMMIT"
"""Environment variable: the commit of a copy without a repository."""
OTHER_SOURCES = (":/src", ":/workshop/src")
"""Sources of signsplice and of the workshop, as git's paths from the top of the repository."""
PACKAGES = ("signsplice", "numpy", "scipy", "onnxruntime")


def read_environment() -> dict[str, Any]:
    """Returns the ``commit``, ``versions`` and ``machine`` of a row."""
    return {"commit": read_commit(), "versions": read_versions(), "machine": describe_machine()}


def read_commit(folder: Path | None = None) -> str:
    """Returns the git revision of this code: 12 hex digits, and "+" if tracked files of this package, of signsplice or
    of the workshop differ from the revision.

    folder: the sources of this package. Files outside all three packages' sources, such as results that are being
    written, do not count. Without a repository it is the variable ``SIGNSPLICE_COMMIT``, for copies of the files alone,
    or empty.
    """
    directory = folder or Path(__file__).resolve().parents[1]
    status = ["status", "--porcelain", "--untracked-files=no", "--", ".", *OTHER_SOURCES]
    calls = (["rev-parse", "HEAD"], status, ["ls-files", "."])
    try:
        revision, changes, tracked = (
            subprocess.run(["git", *call], cwd=directory, capture_output=True, text=True, check=True, timeout=20).stdout
            for call in calls
        )
    except (OSError, subprocess.SubprocessError):
        return os.environ.get(COMMIT_VARIABLE, "")
    if not tracked:  # installed inside the repository of something else
        return os.environ.get(COMMIT_VARIABLE, "")
    return revision[:N_HEX] + ("+" if changes.strip() else "")


def read_versions() -> dict[str, str]:
    """Returns the versions of Python and of the packages that affect results."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return versions


def describe_machine() -> str:
    """Returns the processor and its number of cores; times of different machines cannot be compared."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    except OSError:
        pass
    return f"{name}, {os.cpu_count()} cores"
