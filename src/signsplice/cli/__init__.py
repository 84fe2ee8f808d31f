"""The command line. Each command imports its packages when it is called, so that ``--help`` is fast.

Exit status: 0 success; 1 failure; 2 invalid call or input; 130 interrupted. Errors are one line on standard error,
without a traceback.
"""

import signal
import sys
from collections.abc import Callable

_INTERRUPTED = "interrupted; no file was left half-written"


def main() -> None:
    """Run the command line and exit with its status."""
    exit_after(_run)


def exit_after(run: Callable[[], tuple[str, int]]) -> None:
    """Print the error message of a command line, if any, and exit with its status."""
    interrupts: list[int] = []  # C libraries turn an interrupt during their import into other errors

    def interrupt(number: int, _: object) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    try:
        if is_default:
            signal.signal(signal.SIGINT, interrupt)
        message, status = run()
        if interrupts and status != 0:
            message, status = _INTERRUPTED, 130
    except KeyboardInterrupt as interruption:
        message, status = "; ".join((_INTERRUPTED, *map(str, interruption.args))), 130
    except Exception:  # raised by an import, before ``run`` could turn it into a line
        if not interrupts:
            raise
        message, status = _INTERRUPTED, 130
    finally:
        if is_default:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    if message:
        print("error: " + " ".join(message.splitlines()), file=sys.stderr)
    sys.exit(status)


def _run() -> tuple[str, int]:
    from signsplice.cli.commands import app, run  # here, since an interrupt may arrive during this import

    return run(app)
