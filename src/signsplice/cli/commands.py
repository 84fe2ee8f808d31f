"""All commands in one group, and the exit status for their exceptions."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress

import click

from signsplice.cli import bench, bulk, files, lexicon, service, splicing, synth
from signsplice.cli.plugins import OpenGroup
from signsplice.cli.terminal import visible, visible_output, with_option_names
from signsplice.errors import InputError, SignspliceError

_OUTPUT_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""Error numbers of failed writes to standard output, which have no file name; other files raise ``InputError``."""


@click.group(cls=OpenGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="signsplice")
def app() -> None:
    """Splice mocap clips of sign-language words into one fluent animation."""


for _room in (splicing, files, lexicon, service, synth, bulk, bench):  # the order of a user's day, as in --help
    for _command in _room.COMMANDS:
        app.add_command(_command)


def run(commands: click.Group) -> tuple[str, int]:
    """Run the command of this process; return its error message, empty without an error, and its exit status."""
    with visible_output():
        message, status = _run(commands)
    return visible(message), status


def _run(commands: click.Group) -> tuple[str, int]:
    try:
        commands.main(standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
    except click.exceptions.Exit as stop:
        return "", stop.exit_code
    except click.Abort as abort:
        raise KeyboardInterrupt(*getattr(abort.__cause__, "args", ())) from None
    except click.exceptions.NoArgsIsHelpError as error:  # no command was named
        print(error.format_message(), file=sys.stderr)
        return "", 2
    except click.ClickException as error:
        return " ".join(error.format_message().split()), 2
    except SignspliceError as error:
        return with_option_names(str(error)), 2 if isinstance(error, InputError) else 1
    except BrokenPipeError:
        _drop_output()
        return "", 1
    except Exception as error:
        if isinstance(error, OSError) and error.filename is None and error.errno in _OUTPUT_FAULTS:
            _drop_output()
            return f"standard output cannot be written ({error.strerror}); what was printed is not complete", 1
        if _is_lack_of_memory(error):
            return "there is not enough memory for this; send fewer or shorter clips, or free some", 1
        if os.environ.get("SIGNSPLICE_DEBUG"):
            raise
        return f"unexpected {type(error).__name__}: {error}; set SIGNSPLICE_DEBUG=1 for a traceback", 1
    return "", 0


def _drop_output() -> None:
    """Discard the buffer of standard output, which is flushed again at exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _is_lack_of_memory(error: Exception) -> bool:
    """Return whether memory ran out, also while loading a library."""
    is_refused = isinstance(error, OSError) and error.errno == errno.ENOMEM
    words = ("cannot allocate memory", "failed to map segment")
    return isinstance(error, MemoryError) or is_refused or any(word in str(error).lower() for word in words)
