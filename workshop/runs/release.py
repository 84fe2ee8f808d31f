"""Builds wheel and source archive, their hashes, and a record of their sources, in a folder (out/dist).

    python workshop/runs/release.py [FOLDER]

``SHA256SUMS`` is for ``sha256sum --check``. ``provenance.json`` is an in-toto statement (v1) with a SLSA provenance
(v1): the commit, the locks and the tools. It is not signed. Equal commits and tools make equal bytes: archives have the
commit's time, and the statement has none.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

LOCKS = ("requirements/dev.lock", "requirements/demo.lock", "requirements/serve.lock", "viewer/package-lock.json")
"""Files that fix the versions of everything that is installed for a build."""


def main() -> None:
    """Builds, and writes both files beside the archives."""
    folder = Path(sys.argv[1] if sys.argv[1:] else "out/dist")
    epoch = os.environ.get("SOURCE_DATE_EPOCH") or _run_git("log", "-1", "--format=%ct")
    command = ["-m", "hatchling", "build", "--target", "wheel", "--target", "sdist"]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": epoch}
    subprocess.run([sys.executable, *command, "--directory", str(folder)], env=environment, check=True)
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    name = f"{project['name']}-{project['version']}"
    archives = [folder / f"{name}-py3-none-any.whl", folder / f"{name}.tar.gz"]
    sums = {path.name: _hash_file(path) for path in archives}
    (folder / "SHA256SUMS").write_text("".join(f"{digest}  {name}\n" for name, digest in sums.items()))
    statement = _make_statement(sums, ["python", *command], epoch)
    (folder / "provenance.json").write_text(json.dumps(statement, indent=1) + "\n")


def _make_statement(sums: dict[str, str], command: list[str], epoch: str) -> dict[str, Any]:
    """Returns the in-toto statement about files, name -> SHA-256."""
    source: dict[str, Any] = {"name": "source", "digest": {"gitCommit": _run_git("rev-parse", "HEAD")}}
    if _run_git("status", "--porcelain"):
        source["annotations"] = {"changed": "the working tree differs from the commit"}
    locks = [{"name": name, "digest": {"sha256": _hash_file(Path(name))}} for name in LOCKS]
    return {
        "_type": "https://in-toto.io/Statement/v1",
        "subject": [{"name": name, "digest": {"sha256": digest}} for name, digest in sums.items()],
        "predicateType": "https://slsa.dev/provenance/v1",
        "predicate": {
            "buildDefinition": {
                "buildType": "urn:signsplice:hatchling-build:1",
                "externalParameters": {"command": command, "environment": {"SOURCE_DATE_EPOCH": epoch}},
                "resolvedDependencies": [source, *locks],
            },
            "runDetails": {
                "builder": {
                    "id": "urn:signsplice:make-wheel",
                    "version": {"python": platform.python_version(), "hatchling": metadata.version("hatchling")},
                }
            },
        },
    }


def _hash_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _run_git(*words: str) -> str:
    return subprocess.run(["git", *words], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


if __name__ == "__main__":
    main()
