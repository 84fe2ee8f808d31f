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
        """Build the page, unless it is newer than its source or the install is editable."""
        root = Path(self.root)
        page, sources = root / PAGE / "index.html", [*(root / "viewer").glob("*.*"), *(root / "viewer/src").glob("*")]
        made = page.stat().st_mtime if page.is_file() else 0.0
        if version == "editable" or made > max((source.stat().st_mtime for source in sources), default=0.0):
            return
        npm = shutil.which("npm")
        try:
            for command in (["ci", "--no-audit", "--no-fund", "--silent"], ["run", "--silent", "build"]):
                subprocess.run([npm or "npm", *command], cwd=root / "viewer", check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"this wheel goes without a viewer of today: {error}", file=sys.stderr)
