"""The command line. Each command imports the package that it needs when it is called, so that ``--help`` is quick.

Exit status: 0 success; 1 failure; 2 a wrong call or input; 130 interrupted. Errors are one line on standard error,
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
    """Exit with the status that a command line returns, after printing its error message if there is one."""
    interrupts: list[int] = []  # libraries written in C make other errors of one that comes while they are imported

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
    except Exception:  # of an import, before ``run`` could make a line of it
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
    from signsplice.cli.commands import app, run  # here, since an interrupt may come while this is imported

    return run(app)
