"""The command line. Each command imports the package that it needs when it is called, so that ``--help`` is quick.

Exit status: 0 success; 1 failure; 2 a wrong call or input. Errors are one line on standard error, without a traceback.
"""

from __future__ import annotations

import os
import sys

import click

from signsplice.cli import evaluation, files, lexicon, paper, service, showing, splicing, synth, train
from signsplice.errors import InputError, SignspliceError


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="signsplice")
def app() -> None:
    """Splice mocap clips of sign-language words into one fluent animation."""


def main() -> None:
    """Run the command line and exit with its status."""
    try:
        app.main(standalone_mode=False)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; no file was left half-written", 130)
    except click.ClickException as error:
        _fail(" ".join(error.format_message().split()), 2)
    except InputError as error:
        _fail(str(error), 2)
    except SignspliceError as error:
        _fail(str(error), 1)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Exception as error:
        if os.environ.get("SIGNSPLICE_DEBUG"):
            raise
        _fail(f"unexpected {type(error).__name__}: {error}; set SIGNSPLICE_DEBUG=1 for a traceback", 1)


def _fail(message: str, status: int) -> None:
    print("error: " + " ".join(message.splitlines()), file=sys.stderr)
    sys.exit(status)


for _command in (
    *splicing.COMMANDS,
    *evaluation.COMMANDS,
    *files.COMMANDS,
    *lexicon.COMMANDS,
    *synth.COMMANDS,
    *paper.COMMANDS,
    *train.COMMANDS,
    *service.COMMANDS,
    *showing.COMMANDS,
):
    app.add_command(_command)
