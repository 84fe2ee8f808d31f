"""Commands that splice: whole clips, gaps within one, and what there is to splice with."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice.cli.clips import check_outputs, load, with_roles, write
from signsplice.cli.lexicon import open_words
from signsplice.cli.terminal import progress, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.splicing.engine import SpliceOptions, SpliceResult
    from signsplice.splicing.transition import Transition

Command = TypeVar("Command", bound=Callable[..., Any])


_BUNDLE = click.option(
    "--bundle", metavar="DIR", help="Folder of trained networks.  [default: those that ship]", default=None
)
_BODY_SENSE = click.option(
    "--body-sense/--no-body-sense",
    default=None,
    help="Lead hands around head, trunk and each other.  [default: where the transition is learned]",
)


def splicing_options(command: Command) -> Command:
    """The dials that ``splice`` and ``sentence`` share."""
    for option in reversed(
        (
            click.option(
                "-o",
                "--output",
                required=True,
                metavar="OUT",
                help="File to write: .bvh .glb .vrma .npz .png .gif .mp4",
            ),
            click.option(
                "--cutter",
                metavar="NAME",
                help="How splice points are found: see `signsplice methods`, or a trained system's folder.",
            ),
            click.option(
                "--transition",
                metavar="NAME",
                help="How the frames between are made: see `signsplice methods`, or a trained system's folder.",
            ),
            click.option(
                "--transition-time",
                default="auto",
                show_default=True,
                metavar="auto|tempo|fixed|travel|speed|SECONDS",
                help="Length of a transition: auto is learned, and follows the hand's travel and both signs.",
            ),
            click.option(
                "--sign-speed", type=float, default=1.0, show_default=True, metavar="X", help="Speed of the signs."
            ),
            click.option("--fps", type=float, metavar="N", help="Output rate; default that of the first clip."),
            _BUNDLE,
            _BODY_SENSE,
            click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name."),
            click.option("--report", metavar="R.json", help="Write spans, seams and timing as JSON."),
        )
    ):
        command = option(command)
    return command


@click.command()
@click.argument("clips", nargs=-1, required=True, metavar="A.bvh B.bvh [C.bvh ...]")
@splicing_options
def splice(clips: tuple[str, ...], output: str, report: str | None, roles: str | None, **dials: Any) -> None:
    """Join clips in order into one continuous animation."""
    from signsplice.splicing import engine

    check_outputs(output, report)
    options = _options(**dials)
    began = time.perf_counter()
    loaded = [load(path, roles) for path in clips]
    load_ms = 1e3 * (time.perf_counter() - began)
    result = engine.splice(loaded, options)
    deliver(result, output, report, load_ms)


@click.command()
@click.argument("glosses", nargs=-1, required=True, metavar='"GLOSS GLOSS ..."')
@click.option("--lexicon", metavar="DIR", help="Lexicon of the words; default the one that ships.")
@click.option("--no-spell", is_flag=True, help="Refuse words that are not in the lexicon rather than spell them.")
@splicing_options
def sentence(
    glosses: tuple[str, ...],
    lexicon: str | None,
    no_spell: bool,
    output: str,
    report: str | None,
    roles: str | None,
    **dials: Any,
) -> None:
    """Sign a line of glosses with the words of a lexicon."""
    from signsplice.lexicon.sentence import parse
    from signsplice.splicing import engine

    check_outputs(output, report)
    options = _options(**dials)
    began = time.perf_counter()
    with open_words(lexicon) as words:
        units = parse(" ".join(glosses), words, spell=not no_spell)
        line = [gloss for unit in units for gloss in unit.glosses]
        clips = {gloss: words.clip(gloss) for gloss in dict.fromkeys(line)}
    if roles is not None:
        clips = dict(zip(clips, with_roles(list(clips.values()), roles), strict=True))
    load_ms = 1e3 * (time.perf_counter() - began)
    warn(unit.warning for unit in units if unit.warning)
    deliver(engine.splice([clips[gloss] for gloss in line], options), output, report, load_ms)


def _options(transition_time: str, cutter: str | None, transition: str | None, **dials: Any) -> SpliceOptions:
    from signsplice.splicing import methods as defaults
    from signsplice.splicing.engine import SpliceOptions

    try:
        seconds, rule = float(transition_time), defaults.AUTO
    except ValueError:
        seconds, rule = None, transition_time
    options = SpliceOptions(
        cutter=_method(cutter),
        transition=_method(transition),
        duration=rule,
        transition_time=seconds,
        **dials,
    )
    # Said before any file is read.
    defaults.choose(options.cutter, options.transition, options.duration, options.bundle)
    return options


def _method(name: str | None) -> Any:
    """A method's name as it is; the trained system of the paper in a folder that is named in its place."""
    if name is None or not (Path(name) / "bundle.json").is_file():
        return name
    from signsplice.splicing.bundle import read_facts
    from signsplice.splicing.learned import SYSTEM

    if read_facts(Path(name)).get("system") == SYSTEM:
        raise InputError(f"{name}: holds this project's own networks; give it as --bundle {name}")
    from signsplice.paper.systems.clips import open_clip_splicer

    return open_clip_splicer(name)


def deliver(result: SpliceResult, output: str, report: str | None, load_ms: float) -> None:
    """Write the clip and the report, and say what came out."""
    from signsplice.splicing import report as reports

    began = time.perf_counter()
    write(result.clip, output, [(span.kind, span.name or "", *span.output) for span in result.spans])
    save_ms = 1e3 * (time.perf_counter() - began)
    if report is not None:
        reports.write(reports.describe(result, {"load": load_ms, "save": save_ms}), report)
    warn(result.warnings)
    for seam in result.seams:
        warn(f"{seam.before} -> {seam.after}: {line}" for line in seam.warnings)
    print(f"{output}: {len(result.clip)} frames, {result.clip.seconds:.2f} s, {len(result.seams)} seams")


@click.command()
@click.argument("clip", metavar="CLIP")
@click.option(
    "--gap", "gaps", multiple=True, required=True, metavar="A:B", help="Frames A..B-1 to make anew; may be repeated."
)
@click.option("-o", "--output", required=True, metavar="OUT", help="File to write: .bvh .glb .vrma .npz .png .gif .mp4")
@click.option("--transition", metavar="NAME", help="How the frames are made; see `signsplice methods`.")
@_BUNDLE
@_BODY_SENSE
@click.option("--roles", metavar="FILE", help="JSON of role -> joint name, for rigs not known by name.")
@click.option("--report", metavar="R.json", help="Write spans, seams and timing as JSON.")
def inbetween(
    clip: str,
    gaps: tuple[str, ...],
    output: str,
    transition: str | None,
    bundle: str | None,
    body_sense: bool | None,
    roles: str | None,
    report: str | None,
) -> None:
    """Fill frames of a clip anew from what surrounds them; every other frame stays as it is."""
    from signsplice.splicing.inbetween import inbetween as make_anew

    check_outputs(output, report)
    ranges = [_gap(text) for text in gaps]
    began = time.perf_counter()
    loaded = load(clip, roles)
    load_ms = 1e3 * (time.perf_counter() - began)
    result = make_anew(loaded, ranges, _method(transition), body_sense, bundle)
    deliver(result, output, report, load_ms)


def _gap(text: str) -> tuple[int, int]:
    start, _, stop = text.partition(":")
    if not (start.isdecimal() and stop.isdecimal()):
        raise InputError(f"--gap {text!r}, expected A:B with whole frame numbers, B not included")
    return int(start), int(stop)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def methods(as_json: bool) -> None:
    """List every cutter, transition and duration by name."""
    from signsplice.splicing import methods as defaults

    rows = [
        {"kind": kind, "name": part.name, "summary": part.summary, "learned": part.learned, "default": default}
        for kind, part, default in defaults.all_methods()
    ]
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        notes = "".join(f" [{note}]" for note in ("learned", "default") if row[note])
        print(f"{row['kind']:11} {row['name']:14} {row['summary']}{notes}")


@click.command()
@click.argument("bundle", required=False, metavar="[BUNDLE]")
@click.option("--clips", "files", multiple=True, metavar="FILE", help="Clip to hide frames of; may be repeated.")
@click.option("--fps", type=float, metavar="N", help="Bring the clips to this rate first.")
@click.option("--joins", type=int, metavar="N", help="Join N pairs of words that ship, and look at the seams.")
@click.option("--rest", metavar="NAME", help="With --joins: how the signer of the words rests: hanging [default], "
              "folded, bent or low.")  # fmt: skip
@click.option("--pairs", metavar="DIR", help="Corpus of pairs: how deep transitions lead hands into the body.")
@click.option("--limit", type=int, metavar="N", help="So many of the pairs; default all.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def evaluate(
    bundle: str | None,
    files: tuple[str, ...],
    fps: float | None,
    seams: int | None,
    rest: str | None,
    pairs: str | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """Measure every method, those of BUNDLE (default: those that ship) among them: on frames hidden from real clips
    (--clips), where words that were recorded apart meet (--joins), or in the body's way (--pairs).
    """
    if sum((bool(files), seams is not None, pairs is not None)) != 1:
        raise InputError("expected --clips FILE, --joins N or --pairs DIR, one of them")
    if rest is not None and seams is None:
        raise InputError("--rest tells how the signer of --joins rests; give --joins N too")
    if seams is not None:
        signature, rows, lines = _seams(seams, rest or "hanging", bundle)
    elif pairs is not None:
        signature, rows, lines = _intrusion(pairs, limit, bundle)
    else:
        signature, rows, lines = _hidden(files, fps, bundle)
    if as_json:
        print(json.dumps({"signature": signature, "rows": [asdict(row) for row in rows]}, indent=2))
        return
    print("\n".join(lines))


def _hidden(files: tuple[str, ...], fps: float | None, bundle: str | None) -> tuple[str, Sequence[Any], list[str]]:
    """Signature, rows and table of frames hidden from clips."""
    from signsplice.evaluation.hidden_frames import SIGNATURE, hidden_frames, table
    from signsplice.motion.clip import resample
    from signsplice.splicing.transition import TRANSITIONS

    learned = _learned_transition(bundle)

    clips = [load(file) for file in files]
    if fps is not None:
        clips = [resample(clip, fps) for clip in clips]
    with progress("evaluate") as advance:
        rows = hidden_frames(clips, [*TRANSITIONS.values(), *learned], progress=advance)
    return SIGNATURE, rows, table(rows)


def _learned_transition(bundle: str | None) -> list[Transition]:
    """The learned transition, where there is one; a warning where there is none."""
    from signsplice.splicing.methods import choose

    chosen = choose("ends", None, "fixed", bundle)
    warn(chosen.warnings)
    return [chosen.transition] if chosen.transition.learned else []


def _intrusion(folder: str, limit: int | None, bundle: str | None) -> tuple[str, Sequence[Any], list[str]]:
    """Signature, rows and table of hands led into the body, over the pairs of a corpus."""
    from signsplice.evaluation import collisions
    from signsplice.synth.corpus import Pairs

    pairs = Pairs(folder)
    if limit is not None and limit < 1:
        raise InputError(f"--limit {limit}, expected at least 1")
    methods = collisions.compared_transitions(*_learned_transition(bundle))
    numbers = range(len(pairs.index))[:limit]
    with progress("pairs") as advance:
        rows = collisions.compare(pairs, numbers, methods, advance)
    return collisions.SIGNATURE, rows, collisions.table(rows)


def _seams(n_pairs: int, rest: str, bundle: str | None) -> tuple[str, Sequence[Any], list[str]]:
    """Signature, rows and table of words that were recorded apart."""
    from signsplice.evaluation import seams

    if n_pairs < 1:
        raise InputError(f"--joins {n_pairs}, expected at least 1")
    with progress("joins") as advance:
        rows = seams.compare(seams.pairs(n_pairs, rest=rest), seams.compared_methods(bundle), advance)
    return seams.signature(rest), rows, seams.table(rows, rest)


COMMANDS = (splice, sentence, inbetween, methods, evaluate)
