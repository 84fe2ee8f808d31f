"""Builds the viewer into the package's wheel, if Node is installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PAGE = "src/signsplice/service/page"


class ViewerHook(BuildHookInterface):  # type: ignore[misc]
    """Puts the page that ``make viewer`` builds into the wheel; without Node the wheel has no viewer."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page, unless it is newer than its sources or the install is editable."""
        root = Path(self.root)
        page, sources = root / PAGE / "index.html", [*(root / "viewer").glob("*.*"), *(root / "viewer/src").glob("*")]
        built = page.stat().st_mtime if page.is_file() else 0.0
        if version == "editable" or built > max((source.stat().st_mtime for source in sources), default=0.0):
            return
        npm = shutil.which("npm")
        try:
            for command in (["ci", "--no-audit", "--no-fund", "--silent"], ["run", "--silent", "build"]):
                subprocess.run([npm or "npm", *command], cwd=root / "viewer", check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"the viewer was not built, so this wheel has none, or an older one: {error}", file=sys.stderr)
