"""The viewer's checks, which drive a headless Chromium."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from serving import PATIENCE_S

VIEWER = Path(__file__).resolve().parents[1] / "viewer"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def drive(script: str, *arguments: str | Path) -> dict[str, Any]:
    """What a script of ``viewer/checks`` prints."""
    done = subprocess.run(
        ["node", str(VIEWER / "checks" / script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=12 * PATIENCE_S,
        env={**os.environ, "CHROMIUM": str(CHROMIUM)},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    result: dict[str, Any] = json.loads(done.stdout)
    return result
