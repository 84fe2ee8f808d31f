"""Commands for the browser: ``view`` and ``serve``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.clips import check_output, limits, load, load_avatar, read_as, reads_clips, report_of
from signsplice.cli.options import LEXICONS, option, preset
from signsplice.cli.terminal import require, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.service.settings import Settings


_LIMIT_HELP = "Change a limit, e.g. max_body_bytes=1000000; may be repeated; see docs/http.md."


@click.command()
@preset("--host", "127.0.0.1", "H", "Address to listen on.")
@preset("--port", 8000, "N", "Port; 0: any free one.")
@LEXICONS
@option(
    "--workers n_workers",
    "N",
    "Processes for quick jobs, and as many for long ones.  [default: one per core]",
    type=int,
    default=0,
)
@option(
    "--avatar avatars",
    "A.vrm|DIR",
    "Avatar that callers may name, or a folder of some; may be repeated.",
    multiple=True,
)
@option("--allow-host allowed_hosts", "NAME", "Another host name to answer to; *: any; may be repeated.", multiple=True)
@option(
    "--allow-embed",
    "URL",
    "Origin, scheme://host[:port], of another page that may frame the viewer; may be repeated.",
    multiple=True,
)
@option(
    "--allow-origin",
    "URL",
    "Origin, scheme://host[:port], of another page that may call; may be repeated.",
    multiple=True,
)
@option(
    "--proxy proxies", "ADDRESS", "A reverse proxy, whose X-Forwarded-For is believed; may be repeated.", multiple=True
)
@option("--limit limits", "NAME=N", _LIMIT_HELP, multiple=True)
def serve(
    limits: tuple[str, ...],
    allow_origin: tuple[str, ...],
    allow_embed: tuple[str, ...],
    avatars: tuple[str, ...],
    **given: Any,
) -> None:
    """Serve splices over HTTP and WebSocket, and the viewer. Ctrl-C stops it."""
    from signsplice.formats.avatar import avatars_in

    origins, embedders = ([url.rstrip("/").lower() for url in urls] for urls in (allow_origin, allow_embed))
    files = [file for path in avatars for file in avatars_in(Path(path))]
    for file in files:
        load_avatar(str(file))  # fails now, not at the first request
    parsed = {"allowed_origins": tuple(origins), "allowed_embedders": tuple(embedders), "avatars": tuple(files)}
    settings = _settings(limits, **parsed, **given)

    def on_open(address: str) -> None:
        if not settings.is_local:
            print(
                f"warning: whoever reaches {address} can use it: there are no accounts and no encryption; "
                "put a reverse proxy that has them in front (docs/http.md)",
                file=sys.stderr,
            )
        print(f"signsplice listens at {address} (Ctrl-C stops it)", flush=True)

    _listen(settings, (), on_open)


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE [OTHER]")
@option(
    "--report reports",
    "R.json",
    "Report of the splice, for each file in order, if not in the file.",
    multiple=True,
)
@option("--avatar", "A.vrm", "Avatar (.vrm, .glb, .fbx) that the motion is brought to.")
@option("-o --output", "PAGE.html", "Write one self-contained page instead of opening a browser.")
@option("--port", "N", "Port.  [default: any free one]", type=int, default=0)
@LEXICONS
@option("--browser/--no-browser", None, "Open the page in a browser.  [default: yes]", default=True)
@reads_clips
def view(
    files: tuple[str, ...],
    reports: tuple[str, ...],
    avatar: str | None,
    output: str | None,
    browser: bool,
    **given: Any,
) -> None:
    """Show a clip in the browser: FILE, and OTHER next to it, in step. Ctrl-C stops it."""
    if len(files) > 2:
        raise InputError(f"{len(files)} files, expected one, or two to compare")
    if len(reports) > len(files):
        raise InputError(f"{len(reports)} reports for {len(files)} files, expected at most one for each")
    from signsplice.formats import WIRE_FORMATS, atomic, glb

    if output is not None:
        if Path(output).suffix.lower() not in (".html", ".htm"):
            raise InputError(f"{output}: expected a name that ends in .html")
        check_output(output, [*files, *reports, avatar])
    if output is None:
        _require_extra()
    from signsplice.service import page, scene

    page.html([], live=False)  # reports a missing viewer before any work
    parsed = [load(file) for file in files]
    stored = [report_of(*part) for part in zip_longest(parsed, files, reports)]
    if avatar is None:
        clips, figures = parsed, [None if read_as().fps else glb.figure(file, limits()) for file in files]
    else:
        from signsplice.body.retarget import retarget

        body = load_avatar(avatar)
        retargeted = [retarget(clip, body) for clip in parsed]
        warn([line for done in retargeted for line in done.warnings])
        clips, figures = [done.clip for done in retargeted], []
    rows = zip_longest(clips, stored, figures)
    scenes = [scene.from_clip(clip, report, WIRE_FORMATS, figure) for clip, report, figure in rows]
    text = page.html(scenes, live=output is None)
    if output is not None:
        atomic.write(output, text)
        print(f"{output}: opens from disk in any browser, {len(text.encode()) / 1e6:.1f} MB")
        return

    def on_open(address: str) -> None:
        print(f"{', '.join(files)}: at {address} (Ctrl-C stops it)", flush=True)
        if browser:
            import webbrowser

            webbrowser.open(address)

    _listen(_settings((), **given), scenes, on_open)


def _settings(limits: Sequence[str], **values: Any) -> Settings:
    """Return settings with these fields and limits, each "NAME=N". Raises ``InputError`` for an unknown limit."""
    _require_extra()
    from signsplice.service.settings import Settings, limit_types

    types = limit_types()
    for text in limits:
        name, _, number = text.partition("=")
        if name not in types:
            raise InputError(f"--limit {text!r}: no limit {name!r}, expected one of {', '.join(types)}")
        try:
            values[name] = types[name](number)
        except ValueError:
            kind = "a whole number" if types[name] is int else "a number"
            raise InputError(f"--limit {text!r}: {number!r}, expected {kind}") from None
    return Settings(**values)


def _listen(settings: Settings, scenes: Sequence[Mapping[str, Any]], on_open: Callable[[str], None]) -> None:
    _require_extra()
    from signsplice.service.app import serve as listen

    try:
        listen(settings, scenes, on_open)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)


def _require_extra() -> None:
    require("the viewer and the service need", "serve", "fastapi", "prometheus_client", "python_multipart", "uvicorn")


COMMANDS = (view, serve)
