"""The report of a splice: JSON for other programs, version 1."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_type_hints

from signsplice.body.retarget import Retargeted
from signsplice.errors import FormatError, InputError
from signsplice.formats import atomic
from signsplice.formats.json_files import check_type, read_json
from signsplice.motion import copy_unchecked
from signsplice.splicing.result import ReachedTempo, Span, SpliceResult
from signsplice.splicing.seam import SeamScore

VERSION = 1
_KINDS = {
    "version": int,
    "fps": float,
    "frames": int,
    "cutter": str,
    "transition": str,
    "bundle": str | None,
    "spans": list[dict[str, Any]],
    "seams": list[dict[str, Any]],
    "warnings": list[str],
    "tempo": dict[str, Any],
    "timing_ms": dict[str, float],
}
_DEFAULTS: Mapping[str, Any] = {
    "version": VERSION,
    "cutter": "",
    "transition": "",
    "bundle": None,
    "tempo": asdict(ReachedTempo()),
    "timing_ms": {},
}


def describe(result: SpliceResult, timing_ms: Mapping[str, float] | None = None) -> dict[str, Any]:
    """Returns the report as JSON-ready values. ``timing_ms`` adds to the result's own (load, save). Unknown scores are
    null.

    Copying every sign and retraction span from its source (the clip aligned to the first one, at the output rate) and
    every transition span from the output rebuilds the output exactly, except the joints of a span's ``remade`` (of
    planned channels, or of a spelled letter), which only the output holds. Stray frames left out at a clip's ends are
    replaced in its source by the nearest frame of the motion (``rig.inspection.with_ends_held``). A span with ``warp``
    shows the listed frames of the source, by slerp between neighbours. A span with a ``pause`` begins
    with it. Optional keys: ``contacts``, if a clip was retargeted: what its hands touch, and whether that is kept;
    ``system``, if a system spliced whole words; ``face``, if the output has one: which clips have their own, and the
    rules for the others (frames of a sign have the source's face, unless it is by rule); ``person``, unless a system
    spliced whole words: the channels of each clip whose frames are planned; ``skeleton``, if the output has another
    skeleton than the first clip: whose, and why; ``avatar``, if the output is on an avatar: the copies then rebuild the
    sentence before it was retargeted.
    """
    timing = {"load": 0.0, "cut": 0.0, "transition": 0.0, "join": 0.0, "save": 0.0}
    report = {
        "version": VERSION,
        "fps": result.clip.fps,
        "frames": len(result.clip),
        "cutter": result.cutter,
        "transition": result.transition,
        "bundle": result.bundle,
        "spans": [asdict(span) for span in result.spans],
        "seams": [asdict(seam) for seam in result.seams],
        "warnings": list(result.warnings),
        "tempo": asdict(result.tempo),
        "timing_ms": {part: round(ms, 3) for part, ms in (timing | result.timing_ms | dict(timing_ms or {})).items()},
    }
    if result.contacts:
        report["contacts"] = [
            {"clip": index, **asdict(contact)} for index, contacts in result.contacts.items() for contact in contacts
        ]
    if result.face is not None:
        report["face"] = asdict(result.face)
    if result.person is not None:
        planned = [{"clip": index, "channels": channels} for index, channels in result.person.planned.items()]
        report["person"] = {"amount": result.person.amount, "seed": result.person.seed, "planned": planned}
    if result.system is not None:
        report["system"] = dict(result.system)
    if result.skeleton is not None:
        report["skeleton"] = dict(result.skeleton)
    if result.avatar is not None:
        report["avatar"] = dict(result.avatar)
    rounded: dict[str, Any] = plain(report)
    return rounded


def describe_retargeting(done: Retargeted, source: str, onto: str) -> dict[str, Any]:
    """Returns a clip's contacts on another body as JSON-ready values; ``source`` and ``onto``: file names."""
    return {
        "version": VERSION,
        "source": source,
        "onto": onto,
        "fps": done.clip.fps,
        "frames": len(done.clip),
        "warnings": list(done.warnings),
        "contacts": [plain(asdict(contact)) for contact in done.contacts],
    }


def with_report(result: SpliceResult) -> SpliceResult:
    """Returns the result with its report, without times, in its clip: the formats that can hold it write it."""
    return replace(result, clip=copy_unchecked(result.clip, report={**describe(result), "timing_ms": {}}))


def write(report: Mapping[str, Any], path: str | Path) -> None:
    """Writes a report as JSON, atomically."""
    atomic.write(path, json.dumps(report, indent=2, ensure_ascii=False) + "\n")


def write_report(result: SpliceResult, path: str | Path) -> None:
    """Writes the report of a splice as JSON (``describe``), atomically."""
    write(describe(result), path)


def read(path: str | Path, n_frames: int) -> dict[str, Any]:
    """Reads the report in a file, as ``check`` returns it. Raises the errors of ``check``, and ``InputError`` if the
    file cannot be read.
    """
    return check(read_json(path, "the report of a splice"), n_frames, str(path))


def check(stored: Any, n_frames: int, file: str) -> dict[str, Any]:
    """Checks the report ``stored`` in a file against its clip of ``n_frames``, and returns it. Keys that earlier
    versions of the program did not write get their defaults; unknown keys of later versions stay.

    Raises ``FormatError`` if it is not a report of version 1, ``InputError`` if it describes another clip.
    """
    try:
        report = {**_DEFAULTS, **stored}
        for name, kind in _KINDS.items():
            check_type(report[name], kind, name)
        absent = dict.fromkeys(("clip", "name", "source", "warp", "remade", "pause"))
        report["spans"] = [_row(Span, row, "spans", absent) for row in report["spans"]]
        report["seams"] = [
            _row(SeamScore, row, "seams", {"warnings": [], "intrusion_mm": None}) for row in report["seams"]
        ]
        if report["version"] != VERSION:
            raise ValueError(f"version {report['version']}, expected {VERSION}")
        for start, stop in (row["output"] for row in report["spans"]):
            if not 0 <= start <= stop:
                raise ValueError(f"spans: output {start} to {stop}, expected frames in order")
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"is no report of a splice ({str(error)[:200]})", file=file) from error
    ends = [row["output"][1] for row in report["spans"]]
    if ends and (ends[-1] != n_frames or max(ends) > n_frames):
        raise InputError(
            f"{file}: describes {max(ends)} frames, but the clip has {n_frames}; is it another clip's report?"
        )
    return report


def _row(
    kind: type[Span] | type[SeamScore], row: Mapping[str, Any], where: str, defaults: Mapping[str, Any]
) -> dict[str, Any]:
    filled = {**defaults, **row}
    for name, annotation in get_type_hints(kind, include_extras=True).items():
        check_type(filled[name], annotation, f"{where}: {name}")
    return filled


def plain(value: Any) -> Any:
    """Converts values to JSON: tuples to lists, numbers that are not finite to null."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
