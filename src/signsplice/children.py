"""Processes that end with the process that started them, also where that one is killed."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing import parent_process
from multiprocessing.process import BaseProcess


def end_with_parent() -> None:
    """Let this process, a child made by ``multiprocessing``, end as soon as its parent has ended."""
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


def killed_with_parent() -> Callable[[], None] | None:
    """What ``subprocess.Popen`` calls as ``preexec_fn`` so that the system kills the child when the calling thread has
    ended; None where the system cannot (only Linux can).
    """
    if sys.platform != "linux":
        return None
    import ctypes

    control, parent = ctypes.CDLL(None).prctl, os.getpid()
    set_signal = 1  # PR_SET_PDEATHSIG

    def bind() -> None:
        control(set_signal, signal.SIGKILL)
        if os.getppid() != parent:  # it has ended before the call
            os._exit(1)

    return bind
