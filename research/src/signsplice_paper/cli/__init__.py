"""The command line `signsplice-paper`; its exit statuses and error lines are those of `signsplice`."""

from signsplice.cli import exit_after


def main() -> None:
    """Run the command line and exit with its status."""
    exit_after(_run)


def _run() -> tuple[str, int]:
    from signsplice.cli.commands import run  # here, since an interrupt may come while this is imported
    from signsplice_paper.cli.commands import app

    return run(app)
