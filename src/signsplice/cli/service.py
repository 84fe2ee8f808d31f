"""Commands with a browser at their other end: the viewer, and the service."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.clips import load, read_report
from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from signsplice.service.settings import Settings

_HOST = click.option("--host", default="127.0.0.1", show_default=True, metavar="H", help="Address to listen on.")
_LEXICON = click.option("--lexicon", metavar="DIR", help="Lexicon of the words; default the one that ships.")


@click.command()
@_HOST
@click.option("--port", type=int, default=8000, show_default=True, metavar="N", help="Port; 0: any that is free.")
@_LEXICON
@click.option(
    "--workers",
    type=int,
    default=0,
    metavar="N",
    help="Processes for requests, and for streams.  [default: one a core]",
)
@click.option("--allow-host", multiple=True, metavar="NAME", help="Another name by which it may be called; *: any.")
@click.option("--allow-origin", multiple=True, metavar="URL", help="Another page's origin that may call it.")
@click.option(
    "--limit",
    "limits",
    multiple=True,
    metavar="NAME=N",
    help="Another limit, e.g. max_body_bytes=1000000; see docs/http.md.",
)
def serve(
    host: str,
    port: int,
    lexicon: str | None,
    workers: int,
    allow_host: tuple[str, ...],
    allow_origin: tuple[str, ...],
    limits: tuple[str, ...],
) -> None:
    """Answer over HTTP and WebSocket, with the viewer as its page. Ctrl-C ends it."""
    _listen(
        _settings(
            limits,
            host=host,
            port=port,
            lexicon=None if lexicon is None else Path(lexicon),
            n_workers=workers,
            allowed_hosts=allow_host,
            allowed_origins=tuple(origin.rstrip("/").lower() for origin in allow_origin),
        ),
        (),
        lambda address: print(f"signsplice listens at {address} (Ctrl-C ends it)", flush=True),
    )


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE [OTHER]")
@click.option(
    "--report", "reports", multiple=True, metavar="R.json", help="The splice's report, in the order of the files."
)
@click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name.")
@click.option(
    "-o", "--output", metavar="PAGE.html", help="Write one self-contained page in place of opening a browser."
)
@click.option("--port", type=int, default=0, metavar="N", help="Port.  [default: any that is free]")
@_LEXICON
@click.option("--browser/--no-browser", default=True, help="Open the page in a browser.  [default: yes]")
def view(
    files: tuple[str, ...],
    reports: tuple[str, ...],
    roles: str | None,
    output: str | None,
    port: int,
    lexicon: str | None,
    browser: bool,
) -> None:
    """Look at a clip in the browser: FILE, and OTHER beside it, in step. Ctrl-C ends it."""
    if len(files) > 2:
        raise InputError(f"{len(files)} files, expected one, or two to see them side by side")
    if len(reports) > len(files):
        raise InputError(f"{len(reports)} reports for {len(files)} files, expected one for each at most")
    _need()
    from signsplice.formats.atomic import check_writable, replacing
    from signsplice.service import page, scene
    from signsplice.service.wire import FORMATS

    if output is not None:
        if Path(output).suffix.lower() not in (".html", ".htm"):
            raise InputError(f"{output}: expected a name that ends in .html")
        check_writable(output)
    scenes = []
    for number, file in enumerate(files):
        clip = load(file, roles)
        told = read_report(reports[number], len(clip)) if number < len(reports) else None
        scenes.append(scene.shown(clip, told, FORMATS))
    if output is not None:
        text = page.html(scenes, live=False)
        with replacing(output) as temporary:
            temporary.write_text(text, encoding="utf-8")
        print(f"{output}: opens from disk in any browser, {len(text.encode()) / 1e6:.1f} MB")
        return
    page.html(scenes, live=True)  # said before anything listens

    def opened(address: str) -> None:
        print(f"{', '.join(files)}: at {address} (Ctrl-C ends it)", flush=True)
        if browser:
            import webbrowser

            webbrowser.open(address)

    _listen(_settings((), port=port, lexicon=None if lexicon is None else Path(lexicon)), scenes, opened)


def _settings(told: Sequence[str], **known: Any) -> Settings:
    _need()
    from signsplice.service.settings import Settings, limits

    kinds = limits()
    for text in told:
        name, _, number = text.partition("=")
        if name not in kinds:
            raise InputError(f"--limit {text!r}: no limit {name!r}, expected one of {', '.join(kinds)}")
        try:
            known[name] = kinds[name](number)
        except ValueError:
            raise InputError(f"--limit {text!r}: {number!r} is no number of that kind") from None
    return Settings(**known)


def _listen(settings: Settings, scenes: Sequence[Mapping[str, Any]], told: Any) -> None:
    _need()
    from signsplice.service.run import serve as listen

    try:
        listen(settings, scenes, told)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)


def _need() -> None:
    """Raise ``MissingExtraError`` where the service's libraries are not there."""
    try:
        import fastapi  # noqa: F401
        import prometheus_client  # noqa: F401
        import python_multipart  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            f"the viewer and the service need {error.name}; install them by: pip install 'signsplice[serve]'"
        ) from error


COMMANDS = (view, serve)
