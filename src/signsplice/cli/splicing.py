"""The commands ``splice``, ``sentence``, ``inbetween``, ``methods``, which lists their methods, and ``demo``."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice.cli.clips import (
    OUTPUT_SUFFIXES,
    PICTURES,
    SKIN,
    apply_rest_pose,
    check_apart,
    check_outputs,
    check_skin,
    faces_of,
    limits,
    load,
    load_avatar,
    load_body,
    parse_size,
    read_as,
    reads_clips,
    reads_faces,
    reads_words,
    write,
)
from signsplice.cli.lexicon import open_words
from signsplice.cli.options import (
    AS_JSON,
    BUNDLE,
    LEXICONS,
    READING,
    SEEDS,
    GroupedCommand,
    combine_options,
    flag,
    option,
    preset,
    two_numbers,
)
from signsplice.cli.terminal import note, progress, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.body.capsules import Avatar
    from signsplice.motion import Clip
    from signsplice.splicing.engine import SpliceOptions, SpliceResult

Chosen = TypeVar("Chosen")

_joining_options = combine_options(
    option("-o --output", "OUT", f"File to write: {' '.join(OUTPUT_SUFFIXES)}", required=True),
    option(
        "--transition",
        "NAME",
        "How the frames between signs are made: see `signsplice methods`.",
    ),
    BUNDLE,
    option("--avatar", "A.vrm", "Avatar (.vrm, .glb, .fbx) that signs; a .glb is its own file."),
    SKIN,
    PICTURES,
    option(
        "--avoid-collisions/--no-avoid-collisions",
        None,
        "Keep hands out of head, trunk and each other in transitions.  [default: if the transition is learned]",
        default=None,
    ),
    option("--report", "R.json", "Write spans, seams and timing to this JSON file."),
)
_splicing_options = combine_options(
    option("--cutter", "NAME", "How splice points are found: see `signsplice methods`."),
    preset(
        "--transition-time",
        "auto",
        "auto|RULE|SECONDS",
        "Length of a transition: a rule of `signsplice methods`, or seconds (0 to 10); auto: by distance.",
    ),
    preset("--sign-speed", 1.0, "X", "How many times as fast the signs play, 0.1 to 10."),
    preset(
        "--tempo",
        "citation",
        "citation|natural|SECONDS",
        "Signs as recorded, as fast as in running signing, or SECONDS (0.4 to 1.5) a sign with its transition.",
    ),
    option("--fps", "N", "Output frame rate.  [default: the first clip's; if under 20, the highest]", type=float),
    option("--onto", "RIG", "Clip whose skeleton signs.  [default: the first clip's, or one that loses fewer joints]"),
    preset(
        "--free-hand",
        "natural",
        "natural|transition",
        "An arm without a sign: it stays up and sinks late and slowly, or falls and rises within the transitions.",
    ),
    preset(
        "--person",
        1.0,
        "X",
        "How much head, trunk and gaze move where no sign moves them: 0, not at all, to 1, nearly as people's do.",
    ),
    preset("--seed", 0, "N", "Another N gives other movements of arms, head and trunk without a sign.", type=SEEDS),
    option(
        "--system",
        "lptransformer|lpt-plus|DIR",
        "The paper's LpTransformer, LPT+, or a trained system in a folder, run whole: its positions and its frames.",
    ),
    flag(
        "--fill-misses/--no-fill-misses",
        "Join words for which the system finds no positions by the defaults, with a warning, or stop.",
        default=True,
    ),
    _joining_options,
)
"""Options shared by ``splice`` and ``sentence``."""


@click.command(cls=GroupedCommand)
@click.argument("clips", nargs=-1, required=True, metavar="A.bvh B.bvh [C.bvh ...]")
@reads_faces
@_splicing_options
@reads_clips
def splice(clips: tuple[str, ...], faces: tuple[str, ...], face_offset: float, **others: Any) -> None:
    """Join clips in order into one continuous animation."""
    from signsplice.splicing import engine

    if len(clips) < 2:
        raise InputError(f"one clip, {clips[0]}, expected two or more: signsplice splice A.bvh B.bvh -o OUT.bvh")
    target, options = _begin(_splice_options, [*clips, *faces], **others)
    began = time.perf_counter()
    clip_faces = zip(clips, faces_of(clips, faces), strict=True)
    loaded = [load(path, warns=False, face=face, face_offset=face_offset) for path, face in clip_faces]
    load_ms = 1e3 * (time.perf_counter() - began)
    result = engine.splice(loaded, options)
    _note_rates(loaded, result, options)
    target.deliver(result, load_ms)


@click.command(cls=GroupedCommand)
@click.argument("glosses", nargs=-1, required=True, metavar='"GLOSS GLOSS ..."')
@LEXICONS
@option(
    "--fallback", "FILE", "Written signs (SiGML, HamNoSys) for words that the lexicon lacks, before they are spelled."
)
@flag(
    "--no-spell", "Refuse a line with words that are not in the lexicon instead of spelling them or leaving them out."
)
@flag("--no-compounds", "Read I LOVE YOU as three words where the lexicon has I-LOVE-YOU.")
@READING
@flag("--no-pauses", "Hold no sign at punctuation.")
@option(
    "--face-rules/--no-face-rules",
    None,
    "Blinks, and brows of questions, in words without a face of their own.  [default: unless OUT is a .bvh]",
    default=None,
)
@option(
    "--mouthing",
    "FILE",
    "Guess mouths of faces by rule from a pronunciation dictionary in the format of CMUdict (BSD-style licence, "
    "https://github.com/cmusphinx/cmudict). Signers of ASL mouth few words whole; no signer has judged it.",
)
@_splicing_options
@reads_words
def sentence(
    glosses: tuple[str, ...],
    lexicons: tuple[str, ...],
    fallback: str | None,
    no_spell: bool,
    no_compounds: bool,
    drop_function_words: bool,
    language: str,
    one_language: bool,
    no_pauses: bool,
    face_rules: bool | None,
    mouthing: str | None,
    output: str,
    **others: Any,
) -> None:
    """Sign a line of glosses with the words of a lexicon."""
    from signsplice.formats.roles import with_roles
    from signsplice.lexicon.sentence import count_words, line_warnings, list_spelled_words, parse, token_glosses
    from signsplice.splicing import engine
    from signsplice.splicing.faces import RULES
    from signsplice.splicing.word import words_of

    has_rules = Path(output).suffix.lower() != ".bvh" if face_rules is None else face_rules
    read = partial(_splice_options, face_rules=RULES if has_rules else (), mouthing=mouthing)
    target, options = _begin(read, [fallback, mouthing], output, **others)
    began = time.perf_counter()
    with open_words(*lexicons, fallback=fallback, language=language) as words:
        for path in (output, target.report or output):
            check_apart(path, [source.path for source in words.sources])
        spell, compounds = not no_spell, not no_compounds
        units = parse(" ".join(glosses), words, spell, compounds, drop_function_words, language, one_language)
        clips = {gloss: words.clip(gloss) for gloss in dict.fromkeys(token_glosses(units))}
        owns = {gloss: words.owns(gloss) for gloss in clips}
    if (roles := read_as().roles) is not None:
        clips = {gloss: with_roles(clip, roles) for gloss, clip in clips.items()}
    clips = {gloss: apply_rest_pose(clip) for gloss, clip in clips.items()}
    load_ms = 1e3 * (time.perf_counter() - began)
    note(unit.note for unit in units if unit.note)
    warn(unit.warning for unit in units if unit.warning)
    result = engine.splice(words_of(units, clips.__getitem__, not no_pauses, owns.get), options)
    _note_rates(clips.values(), result, options)
    result = replace(result, warnings=(*line_warnings(units, language), *result.warnings))
    report_keys = {"units": [asdict(unit) for unit in units], "spelled": list_spelled_words(units)}
    target.deliver(result, load_ms, report_keys, count_words(units))


def _begin(
    read: Callable[..., Chosen],
    inputs: Iterable[str | None],
    output: str,
    report: str | None,
    avatar: str | None,
    skin: tuple[str, ...],
    view: str,
    size: str | None,
    **dials: Any,
) -> tuple[_Target, Chosen]:
    """Return the target of a call, and the result of ``read`` for its dials, before any clip is read. Raises
    ``InputError`` for an output that is one of ``inputs`` or another file that the call reads.
    """
    check_outputs(output, report, [*inputs, avatar, dials.get("onto"), *_networks(**dials)])
    film_size, chosen = parse_size(output, view, size), read(**dials)
    check_skin(skin, avatar)
    signer = None if avatar is None else load_avatar(avatar, skin=skin)
    return _Target(output, report, signer, view, film_size), chosen


def _splice_options(
    transition_time: str,
    cutter: str | None,
    transition: str | None,
    system: str | None,
    onto: str | None,
    **others: Any,
) -> SpliceOptions:
    """Return the ``SpliceOptions`` of a call. Raises ``InputError`` for unknown methods, before any file is read."""
    from signsplice.splicing.engine import SpliceOptions
    from signsplice.splicing.options import AUTO

    try:
        seconds, duration = float(transition_time), AUTO
    except ValueError:
        seconds, duration = None, transition_time
    options = SpliceOptions(
        cutter=cutter,
        transition=transition,
        duration=duration,
        transition_time=seconds,
        limits=limits(),
        system=system,
        **others,
    )
    options.choose_methods()
    return options if onto is None else replace(options, onto=load_body(onto))


def _note_rates(clips: Iterable[Clip], result: SpliceResult, options: SpliceOptions) -> None:
    """Note the clips that were brought to another frame rate, that of the sentence, unless the user gave it."""
    from signsplice.rig.align import list_names

    fps = result.clip.fps
    others = [f"{clip.name} ({clip.fps:.6g})" for clip in clips if abs(clip.fps - fps) > 1e-3 * fps]
    if others and options.fps is None:
        note([f"brought to the sentence's {fps:.6g} fps: {list_names(list(dict.fromkeys(others)))}"])


def _networks(
    bundle: str | None, cutter: str | None = None, transition: str | None = None, system: str | None = None, **_: Any
) -> list[str | Path | None]:
    """Return the folders of networks that a call may read."""
    from signsplice.splicing.bundle import WEIGHTS

    return [bundle or WEIGHTS, cutter, transition, system]


@dataclass(frozen=True)
class _Target:
    """Target of a call's result: the files of the clip and of its report, the avatar that signs, and the view and the
    size of pictures.
    """

    output: str
    report: str | None
    avatar: Avatar | None
    view: str
    size: tuple[int, int] | None

    def deliver(self, result: SpliceResult, load_ms: float, more: Mapping[str, Any] = {}, count: str = "") -> None:
        """Write the clip and the report with the keys ``more``, and print warnings and a line about the clip, with a
        ``count`` of words.
        """
        from signsplice.motion import copy_unchecked
        from signsplice.splicing import report as reports

        if self.avatar is not None:
            from signsplice.splicing.engine import onto_avatar

            result = onto_avatar(result, self.avatar)
        began = time.perf_counter()
        is_recorded = result.face is not None and bool(result.face.recorded)
        spans = [(span.kind, span.name or "", *span.output) for span in result.spans]
        clip = copy_unchecked(result.clip, report={**(result.clip.report or {}), **more})
        write(clip, self.output, spans, self.view, self.size, warns_of_lost=is_recorded)
        save_ms = 1e3 * (time.perf_counter() - began)
        if self.report is not None:
            reports.write(reports.describe(result, {"load": load_ms, "save": save_ms}) | {**more}, self.report)
        warn(result.warnings)
        for seam in result.seams:
            warn(f"{seam.before} -> {seam.after}: {line}" for line in seam.warnings)
        n, tempo = len(result.seams), result.tempo
        summary = f"{self.output}: {len(result.clip)} frames, {result.clip.seconds:.2f} s, {n} seam{'s' * (n != 1)}"
        if tempo.asked_seconds is not None and tempo.seconds is not None:
            summary += f", {tempo.seconds:.2f} s a sign (asked: {tempo.asked_seconds:g})"
        print(summary + f"; {count}" * bool(count))


@click.command(cls=GroupedCommand)
@click.argument("clip", metavar="CLIP")
@option("--gap gaps", "A:B", "Frames A..B-1 to make anew; may be repeated.", multiple=True, required=True)
@_joining_options
@reads_clips
def inbetween(clip: str, gaps: tuple[str, ...], **others: Any) -> None:
    """Make frames of a clip anew from those around them; all other frames stay as they are."""
    from signsplice.splicing.engine import inbetween as fill_gaps

    target, dials = _begin(dict[str, Any], [clip], **others)
    ranges = [two_numbers(gap, ":", f"--gap {gap!r}, expected A:B, frame numbers with B not included") for gap in gaps]
    began = time.perf_counter()
    loaded = load(clip, warns=False)
    load_ms = 1e3 * (time.perf_counter() - began)
    target.deliver(fill_gaps(loaded, ranges, **dials), load_ms)


@click.command()
@AS_JSON
def methods(as_json: bool) -> None:
    """List every cutter, transition, duration and system by name."""
    from signsplice.splicing.options import all_methods

    rows = [
        {"kind": kind, "name": method.name, "summary": method.summary, "learned": method.learned, "default": default}
        for kind, method, default in all_methods()
    ]
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        notes = "".join(f" [{note}]" for note in ("learned", "default") if row[note])
        print(f"{row['kind']:11} {row['name']:14} {row['summary']}{notes}")


@click.command()
@preset("--out", "out/demo", "DIR", "Folder for the files.")
def demo(out: str) -> None:
    """Splice words of the lexicon that ships, and write files to look at."""
    from signsplice.demo import run

    with progress("demo") as advance:
        lines = run(Path(out), advance)
    print(*lines, sep="\n")


COMMANDS = (demo, sentence, splice, inbetween, methods)
