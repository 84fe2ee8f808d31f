"""onnxruntime, imported here and nowhere else in the package, with its telemetry off.

Builds of onnxruntime since 1.32 write a device id to the user's cache and look up their maker's telemetry host when the
library is loaded, before ``disable_telemetry_events`` can be called. Only an environment variable that is set before
the import prevents both. Child processes inherit it.
"""

from __future__ import annotations

import os
import sys
import warnings

SWITCH = "ORT_DISABLE_TELEMETRY"
"""Environment variable that onnxruntime reads when it is loaded."""

if "onnxruntime" in sys.modules and os.environ.get(SWITCH, "").lower() not in ("1", "true", "yes", "on"):
    warnings.warn(
        f"onnxruntime was imported before signsplice could switch its telemetry off: it may have written a device id "
        f"to your cache and looked up its maker's host; set {SWITCH}=1 in the environment, or import "
        f"{__name__} first",
        stacklevel=2,
    )
os.environ[SWITCH] = "1"

import onnxruntime  # noqa: E402

onnxruntime.disable_telemetry_events()

__all__ = ["SWITCH", "onnxruntime"]
