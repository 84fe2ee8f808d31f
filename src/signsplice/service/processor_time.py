"""The time that a process has worked, which a loaded machine does not lengthen."""

from __future__ import annotations

import os
import time
from pathlib import Path


class WorkTime:
    """Seconds that a process has worked since this object was made.

    On Linux this is processor time, of all threads together: other processes that keep the
    processors busy do not count. Elsewhere it is wall-clock time.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._processor_start = _processor_seconds(pid)
        self._wall_start = time.monotonic()

    def seconds(self) -> float:
        """The time so far; 0 once the process has ended."""
        if self._processor_start is None:
            return time.monotonic() - self._wall_start
        now = _processor_seconds(self._pid)
        return 0.0 if now is None else now - self._processor_start


def _processor_seconds(pid: int) -> float | None:
    """User and system time of a process, None where it is not known."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    values = text.rpartition(")")[2].split()  # behind the program's name, from field 3 of proc(5) on
    return (int(values[11]) + int(values[12])) / os.sysconf("SC_CLK_TCK")  # utime, stime
