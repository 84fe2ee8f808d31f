"""The command line. Each command imports the package that it needs when it is called, so that ``--help`` is quick.

Exit status: 0 success; 1 failure; 2 a wrong call or input; 130 interrupted. Errors are one line on standard error,
without a traceback.
"""

import sys


def main() -> None:
    """Run the command line and exit with its status."""
    try:
        from signsplice.cli.commands import run  # here, since an interrupt may come while this is imported

        message, status = run()
    except KeyboardInterrupt:
        message, status = "interrupted; no file was left half-written", 130
    if message:
        print("error: " + " ".join(message.splitlines()), file=sys.stderr)
    sys.exit(status)
