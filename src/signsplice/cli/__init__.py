"""The command line. Each command imports the package that it needs when it is called, so that ``--help`` is quick.

Exit status: 0 success; 1 failure; 2 a wrong call or input; 130 interrupted. Errors are one line on standard error,
without a traceback.
"""

import sys
from collections.abc import Callable


def main() -> None:
    """Run the command line and exit with its status."""
    exit_after(_run)


def exit_after(run: Callable[[], tuple[str, int]]) -> None:
    """Exit with the status that a command line returns, after printing its error message if there is one."""
    try:
        message, status = run()
    except KeyboardInterrupt:
        message, status = "interrupted; no file was left half-written", 130
    if message:
        print("error: " + " ".join(message.splitlines()), file=sys.stderr)
    sys.exit(status)


def _run() -> tuple[str, int]:
    from signsplice.cli.commands import app, run  # here, since an interrupt may come while this is imported

    return run(app)
