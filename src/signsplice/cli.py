"""The command line. Each command imports its wing inside itself, so that ``--help`` is quick.

Exit status: 0 done; 1 the work failed; 2 the call or an input was wrong, said in one line without a traceback.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice.errors import InputError, SignspliceError

if TYPE_CHECKING:
    from signsplice.motion.clip import Clip
    from signsplice.splicing.engine import SpliceOptions, SpliceResult

Command = TypeVar("Command", bound=Callable[..., Any])

PICTURES = (".png", ".gif", ".mp4")
Spans = Sequence[tuple[str, str, int, int]]
"""Kind, name, first frame and end of each span."""


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="signsplice")
def app() -> None:
    """Join mocap clips of sign-language words into one fluent animation."""


def main() -> None:
    """Run the command line and leave with its exit status."""
    try:
        app.main(standalone_mode=False)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; nothing was half-written", 130)
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
        _fail(f"unexpected {type(error).__name__}: {error}; set SIGNSPLICE_DEBUG=1 to see where", 1)


def _fail(message: str, status: int) -> None:
    print("error: " + " ".join(message.splitlines()), file=sys.stderr)
    sys.exit(status)


def _warn(lines: tuple[str, ...]) -> None:
    for line in lines:
        print(f"warning: {line}", file=sys.stderr)


def splicing_options(command: Command) -> Command:
    """The dials that ``splice`` and ``sentence`` share."""
    for option in reversed(
        (
            click.option(
                "-o", "--output", required=True, metavar="OUT", help="File to write: .bvh .npz .png .gif .mp4"
            ),
            click.option("--cutter", metavar="NAME", help="How splice points are found; see `signsplice methods`."),
            click.option(
                "--transition", metavar="NAME", help="How the frames between are made; see `signsplice methods`."
            ),
            click.option(
                "--transition-time",
                default="auto",
                show_default=True,
                metavar="auto|fixed|travel|speed|SECONDS",
                help="Length of a transition: auto follows the hand's travel and the signer.",
            ),
            click.option(
                "--sign-speed", type=float, default=1.0, show_default=True, metavar="X", help="Speed of the signs."
            ),
            click.option("--fps", type=float, metavar="N", help="Output rate; default that of the first clip."),
            click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name."),
            click.option("--report", metavar="R.json", help="Write spans, seams and timing as JSON."),
        )
    ):
        command = option(command)
    return command


@app.command()
@click.argument("clips", nargs=-1, required=True, metavar="A.bvh B.bvh [C.bvh ...]")
@splicing_options
def splice(clips: tuple[str, ...], output: str, report: str | None, roles: str | None, **dials: Any) -> None:
    """Join clips in order into one continuous animation."""
    from signsplice.splicing import engine

    _check_outputs(output, report)
    options = _options(**dials)
    began = time.perf_counter()
    loaded = [_load(path, roles) for path in clips]
    load_ms = 1e3 * (time.perf_counter() - began)
    result = engine.splice(loaded, options)
    _deliver(result, output, report, load_ms)


def _options(transition_time: str, cutter: str | None, transition: str | None, **dials: Any) -> SpliceOptions:
    from signsplice.splicing.cut import DEFAULT_CUTTER
    from signsplice.splicing.duration import find_duration
    from signsplice.splicing.engine import SpliceOptions
    from signsplice.splicing.transition import DEFAULT_TRANSITION

    try:
        seconds, rule = float(transition_time), "auto"
    except ValueError:
        seconds, rule = None, find_duration(transition_time).name
    return SpliceOptions(
        cutter=cutter or DEFAULT_CUTTER,
        transition=transition or DEFAULT_TRANSITION,
        duration=rule,
        transition_time=seconds,
        **dials,
    )


def _deliver(result: SpliceResult, output: str, report: str | None, load_ms: float) -> None:
    """Write the clip and the report, and say what came out."""
    from signsplice.splicing import report as reports

    began = time.perf_counter()
    _write(result.clip, output, [(span.kind, span.name or "", *span.output) for span in result.spans])
    save_ms = 1e3 * (time.perf_counter() - began)
    if report is not None:
        reports.write(reports.describe(result, {"load": load_ms, "save": save_ms}), report)
    _warn(result.warnings)
    for seam in result.seams:
        _warn(tuple(f"{seam.before} -> {seam.after}: {line}" for line in seam.warnings))
    print(f"{output}: {len(result.clip)} frames, {result.clip.seconds:.2f} s, {len(result.seams)} seams")


def _check_outputs(output: str, report: str | None = None) -> None:
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


def _write(clip: Clip, output: str, spans: Spans = (), view: str = "front") -> None:
    """Write a clip by suffix; ``spans`` are marked in pictures, which are seen from ``view``."""
    if Path(output).suffix.lower() in PICTURES:
        from signsplice.render import film

        with _progress(f"rendering {Path(output).name}") as advance:
            film.write(clip, output, [film.Mark(*span) for span in spans], view, advance)
    else:
        from signsplice.formats import save

        save(clip, output)


def _load(path: str, roles: str | None = None) -> Clip:
    from signsplice.formats import load

    clip = load(path)
    if roles is None:
        return clip
    from signsplice.formats.roles import read as read_roles
    from signsplice.motion.humanoid import find_roles

    named = read_roles(roles)
    if not set(named.values()) & set(clip.skeleton.names) and find_roles(clip.skeleton).rig != "unknown":
        return clip  # another rig in the same call, which is known by its names
    clip = replace(clip, skeleton=replace(clip.skeleton, roles=named))
    find_roles(clip.skeleton)  # says at once where a role's joint is missing
    return clip


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@app.command()
@click.argument("clip", metavar="CLIP")
@click.option(
    "--gap", "gaps", multiple=True, required=True, metavar="A:B", help="Frames A..B-1 to make anew; may be repeated."
)
@click.option("-o", "--output", required=True, metavar="OUT", help="File to write: .bvh .npz .png .gif .mp4")
@click.option("--transition", metavar="NAME", help="How the frames are made; see `signsplice methods`.")
@click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name.")
@click.option("--report", metavar="R.json", help="Write spans, seams and timing as JSON.")
def inbetween(
    clip: str, gaps: tuple[str, ...], output: str, transition: str | None, roles: str | None, report: str | None
) -> None:
    """Fill frames of a clip anew from what surrounds them; every other frame stays as it is."""
    from signsplice.splicing import engine
    from signsplice.splicing.transition import DEFAULT_TRANSITION

    _check_outputs(output, report)
    ranges = [_gap(text) for text in gaps]
    began = time.perf_counter()
    loaded = _load(clip, roles)
    load_ms = 1e3 * (time.perf_counter() - began)
    _deliver(engine.inbetween(loaded, ranges, transition or DEFAULT_TRANSITION), output, report, load_ms)


def _gap(text: str) -> tuple[int, int]:
    start, _, stop = text.partition(":")
    if not (start.isdecimal() and stop.isdecimal()):
        raise InputError(f"--gap {text!r}, expected A:B with whole frame numbers, B not included")
    return int(start), int(stop)


@app.command()
@click.argument("file", metavar="FILE")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name.")
def inspect(file: str, as_json: bool, roles: str | None) -> None:
    """Show a clip's rig, roles found, rate, frames, units, rest spans and warnings."""
    from signsplice.inspection import inspect as look

    facts = look(_load(file, roles), file)
    if as_json:
        print(json.dumps(facts, indent=2, ensure_ascii=False))
        return
    for key, value in facts.items():
        if key == "roles":
            print(f"roles      {len(value)} found")
            for role, joint in value.items():
                print(f"           {role:24} {joint}")
        elif isinstance(value, list):
            print(f"{key:10} {'none' if not value else ''}".rstrip())
            for line in value:
                print(f"           {line}")
        else:
            print(f"{key:10} {value}")


@app.command()
@click.argument("source", metavar="IN")
@click.argument("output", metavar="OUT")
def convert(source: str, output: str) -> None:
    """Turn one file into another, by suffix."""
    _check_outputs(output)
    clip = _load(source)
    _write(clip, output)
    print(f"{output}: {len(clip)} frames, {clip.seconds:.2f} s")


@app.command()
@click.argument("source", metavar="IN")
@click.argument("output", metavar="OUT.(png|gif|mp4)")
@click.option("--report", metavar="R.json", help="The splice's report, so that its transitions are marked.")
@click.option("--view", default="front", show_default=True, metavar="VIEW", help="front, three-quarter or side.")
def render(source: str, output: str, report: str | None, view: str) -> None:
    """Draw the signer: a contact sheet (.png), or a film (.gif, .mp4)."""
    if Path(output).suffix.lower() not in PICTURES:
        raise InputError(f"{output}: expected a name that ends in {', '.join(PICTURES)}; use convert for other files")
    _check_outputs(output)
    clip = _load(source)
    _write(clip, output, _reported_spans(report, len(clip)) if report is not None else (), view)
    print(f"{output}: {len(clip)} frames, {clip.seconds:.2f} s")


def _reported_spans(path: str, n_frames: int) -> Spans:
    """Spans of a splice's report, checked against the clip they are to mark."""
    from signsplice.formats.atomic import read_bytes

    try:
        report = json.loads(read_bytes(path))
        spans = [(str(s["kind"]), s["name"] or "", int(s["output"][0]), int(s["output"][1])) for s in report["spans"]]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is no report of a splice ({error})") from error
    if spans and spans[-1][3] != n_frames:
        raise InputError(
            f"{path}: tells of {spans[-1][3]} frames, but the clip has {n_frames}; is it another clip's report?"
        )
    return spans


@app.command()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def methods(as_json: bool) -> None:
    """List every cutter, transition and duration by name."""
    from signsplice.splicing.cut import CUTTERS, DEFAULT_CUTTER
    from signsplice.splicing.duration import DURATIONS
    from signsplice.splicing.transition import DEFAULT_TRANSITION, TRANSITIONS

    rows = [
        {"kind": kind, "name": m.name, "summary": m.summary, "learned": m.learned, "default": m.name == default}
        for kind, table, default in (
            ("cutter", CUTTERS, DEFAULT_CUTTER),
            ("transition", TRANSITIONS, DEFAULT_TRANSITION),
        )
        for m in table.values()
    ]
    rows += [
        {"kind": "duration", "name": d.name, "summary": d.summary, "learned": False, "default": d.name == "auto"}
        for d in DURATIONS.values()
    ]
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        notes = "".join(f" [{note}]" for note in ("learned", "default") if row[note])
        print(f"{row['kind']:11} {row['name']:14} {row['summary']}{notes}")


@app.command()
@click.option("--out", default="out/demo", show_default=True, metavar="DIR", help="Folder to leave the files in.")
def demo(out: str) -> None:
    """Splice the words that ship with the package, and leave files to look at."""
    from signsplice.demo import run

    with _progress("demo") as advance:
        lines = run(Path(out), advance)
    for line in lines:
        print(line)


@app.command()
@click.option(
    "--clips", "files", multiple=True, required=True, metavar="FILE", help="Clip to hide frames of; may be repeated."
)
@click.option("--fps", type=float, metavar="N", help="Bring the clips to this rate first.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def evaluate(files: tuple[str, ...], fps: float | None, as_json: bool) -> None:
    """Hide frames of real clips and measure how well every transition fills them."""
    from dataclasses import asdict

    from signsplice.motion.clip import resample
    from signsplice.splicing.evaluate import SIGNATURE, hidden_frames, table
    from signsplice.splicing.transition import TRANSITIONS

    clips = [_load(file) for file in files]
    if fps is not None:
        clips = [resample(clip, fps) for clip in clips]
    with _progress("evaluate") as advance:
        rows = hidden_frames(clips, list(TRANSITIONS.values()), progress=advance)
    if as_json:
        print(json.dumps({"signature": SIGNATURE, "rows": [asdict(row) for row in rows]}, indent=2))
        return
    print("\n".join(table(rows)))


@app.command()
@click.option(
    "--repeats", type=click.IntRange(3), default=15, show_default=True, help="Runs of each part; medians are shown."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def bench(repeats: int, as_json: bool) -> None:
    """Measure the speed of every part beside its baselines, in one run."""
    from signsplice.bench import measure, table

    with _progress("bench") as advance:
        figures = measure(repeats, advance)
    print(json.dumps(figures, indent=2) if as_json else table(figures))


if __name__ == "__main__":
    main()
