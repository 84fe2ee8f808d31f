"""Clips in and out of a command: read with roles, written by suffix, refused before any work is done."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from signsplice.cli.terminal import progress
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.motion.clip import Clip

PICTURES = (".png", ".gif", ".mp4")
Spans = Sequence[tuple[str, str, int, int]]
"""Kind, name, first frame and end of each span."""


def load(path: str, roles: str | None = None) -> Clip:
    """The clip in a file; a roles file says which joints play which roles where its rig is not known by name."""
    from signsplice import formats

    clip = formats.load(path)
    return clip if roles is None else with_roles([clip], roles)[0]


def with_roles(clips: Sequence[Clip], roles: str) -> list[Clip]:
    """Clips with the roles that a file names, where their rig is not known by name."""
    from signsplice.formats.roles import give, read

    named = read(roles)
    return [give(clip, named) for clip in clips]


def check_outputs(output: str, report: str | None = None) -> None:
    """Refuse what cannot be written before any work is done."""
    from signsplice.formats import check_suffix
    from signsplice.formats.atomic import check_writable

    if Path(output).suffix.lower() not in PICTURES:
        check_suffix(output)
    if report is not None and Path(report).resolve() == Path(output).resolve():
        raise InputError(f"{report}: named for both the animation and the report, expected two names")
    for path in (output, report):
        if path is not None:
            check_writable(path)


def write(clip: Clip, output: str, spans: Spans = (), view: str = "front", size: tuple[int, int] | None = None) -> None:
    """Write a clip by suffix; ``spans`` are marked in pictures, which are seen from ``view``; films have a ``size``."""
    if Path(output).suffix.lower() in PICTURES:
        from signsplice.render import film

        with progress(f"rendering {Path(output).name}") as advance:
            film.write(clip, output, [film.Mark(*span) for span in spans], view, advance, size)
    else:
        from signsplice.formats import save

        save(clip, output)


def read_report(path: str, n_frames: int) -> dict[str, Any]:
    """A splice's report, checked against the clip that it tells of. Raises ``InputError``."""
    from signsplice.formats.atomic import read_bytes

    try:
        report: dict[str, Any] = json.loads(read_bytes(path))
        ends = [(str(span["kind"]), int(span["output"][0]), int(span["output"][1])) for span in report["spans"]]
        for key in ("seams", "warnings"):
            report[key] = list(report[key])
        report |= {"fps": float(report["fps"]), "frames": int(report["frames"])}
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"{path}: is no report of a splice ({error})") from error
    if ends and ends[-1][2] != n_frames:
        raise InputError(
            f"{path}: tells of {ends[-1][2]} frames, but the clip has {n_frames}; is it another clip's report?"
        )
    return report
