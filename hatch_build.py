"""Builds the viewer into the package's wheel, where Node is there to do it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PAGE = "src/signsplice/service/page"


class ViewerHook(BuildHookInterface):  # type: ignore[misc]
    """A wheel holds the page that ``make viewer`` makes; one built without Node goes without, and says so."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page, unless it is there already or the install is editable."""
        root = Path(self.root)
        if version == "editable" or (root / PAGE / "index.html").is_file():
            return
        npm = shutil.which("npm")
        if npm is None or not (root / "viewer" / "package-lock.json").is_file():
            print("no npm: this wheel goes without the viewer", file=sys.stderr)
            return
        for command in (["ci", "--no-audit", "--no-fund", "--silent"], ["run", "--silent", "build"]):
            subprocess.run([npm, *command], cwd=root / "viewer", check=True)
