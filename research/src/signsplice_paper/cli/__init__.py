"""The command line `signsplice-paper`; its exit statuses and error lines are those of `signsplice`."""

from signsplice.cli import exit_after


def main() -> None:
    """Runs the command line and exits with its status."""
    exit_after(_run)


def _run() -> tuple[str, int]:
    from signsplice.cli.commands import run  # imported here: an interrupt may come during the import
    from signsplice_paper.cli.commands import app

    return run(app)
