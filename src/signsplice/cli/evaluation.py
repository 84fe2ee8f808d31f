"""The command ``evaluate``: every method measured on hidden frames, at seams, for collisions, on bodies, in tempo."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.aliases import former_names
from signsplice.cli.clips import limits, load, reads_clips
from signsplice.cli.terminal import progress, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.motion.clip import Clip
    from signsplice.splicing.methods.transition import Transition

Measured = tuple[str, Sequence[Any], list[str]]
"""Signature, rows, and the rows as lines of Markdown."""

N_WORDS = 40
"""Words that ``--bodies`` draws where no number follows it."""


@click.command(context_settings=former_names({"joins": "seams"}))
@click.argument("bundle", required=False, metavar="[BUNDLE]")
@click.option("--clips", "files", multiple=True, metavar="FILE", help="Clip to hide frames of, or to bring to other "
              "bodies with --bodies; may be repeated.")  # fmt: skip
@click.option("--fps", type=float, metavar="N", help="With --clips: resample the clips to this rate first.")
@click.option("--seams", "n_seams", type=int, metavar="N", help="Join N pairs of words that ship, measure the seams.")
@click.option("--rest", metavar="NAME", help="With --seams: how the signer's arms rest: hanging [default], folded, "
              "bent or low.")  # fmt: skip
@click.option("--pairs", metavar="DIR", help="Corpus of pairs: measure how deep hands get into the body.")
@click.option("--limit", type=int, metavar="N", help="With --pairs: only the first N pairs.")
@click.option("--bodies", "n_bodies_words", type=int, is_flag=False, flag_value=N_WORDS, metavar="N_WORDS",
              help="Bring N words that ship, or with --clips these clips, to other bodies.")  # fmt: skip
@click.option(
    "--picture", metavar="FILE.png", help="With --bodies: also draw eight words on five bodies; takes minutes."
)
@click.option("--tempo", "n_tempo_words", type=int, metavar="N_WORDS",
              help="Bring N words that ship, and as many by three other signers, to running tempo.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@reads_clips
def evaluate(
    bundle: str | None,
    files: tuple[str, ...],
    fps: float | None,
    n_seams: int | None,
    rest: str | None,
    pairs: str | None,
    limit: int | None,
    n_bodies_words: int | None,
    picture: str | None,
    n_tempo_words: int | None,
    as_json: bool,
) -> None:
    """Measure every method: on frames hidden from clips (--clips), at the seams of words that were recorded apart
    (--seams), or for collisions of the hands with the body (--pairs); or what words keep on other bodies (--bodies)
    or at the tempo of running signing (--tempo). BUNDLE: networks in place of those that ship.
    """
    from signsplice.evaluation.tables import to_json

    on_bodies = n_bodies_words is not None
    in_tempo = n_tempo_words is not None
    if sum((bool(files) and not on_bodies, n_seams is not None, pairs is not None, on_bodies, in_tempo)) != 1:
        raise InputError("expected exactly one of --clips FILE, --seams N, --pairs DIR, --bodies [N] and --tempo N")
    if rest is not None and n_seams is None:
        raise InputError("--rest sets how the signer of --seams rests; expected --seams N too")
    if picture is not None:
        _check_picture(picture, on_bodies)
    if n_seams is not None:
        signature, rows, lines = _seams(n_seams, rest or "hanging", bundle)
    elif n_bodies_words is not None:
        signature, rows, lines = _bodies(n_bodies_words, files, fps)
    elif n_tempo_words is not None:
        signature, rows, lines = _tempo(n_tempo_words, bundle)
    elif pairs is not None:
        signature, rows, lines = _collisions(pairs, limit, bundle)
    else:
        signature, rows, lines = _hidden_frames(files, fps, bundle)
    if picture is not None:
        _draw_bodies(picture)
    if as_json:
        print(json.dumps({"signature": signature, "rows": [to_json(row) for row in rows]}, indent=2))
        return
    print("\n".join(lines))


def _hidden_frames(files: tuple[str, ...], fps: float | None, bundle: str | None) -> Measured:
    from signsplice.evaluation.hidden_frames import SIGNATURE, hidden_frames, table
    from signsplice.splicing.methods.transition import TRANSITIONS

    transitions = [*TRANSITIONS.values(), *_learned_transition(bundle)]
    clips = _loaded(files, fps)
    with progress("evaluate") as advance:
        rows = hidden_frames(clips, transitions, progress=advance)
    return SIGNATURE, rows, table(rows, clips)


def _loaded(files: tuple[str, ...], fps: float | None) -> list[Clip]:
    """The clips, at another rate where one is given."""
    from signsplice.motion.clip import resample

    clips = [load(file) for file in files]
    if fps is None:
        return clips
    for clip in clips:
        limits().check_resampling(clip, fps)
    return [resample(clip, fps) for clip in clips]


def _learned_transition(bundle: str | None) -> list[Transition]:
    """The learned transition, where there is one; a warning where there is none."""
    from signsplice.splicing.methods.choice import choose

    chosen = choose("ends", None, "fixed", bundle)
    warn(chosen.warnings)
    return [chosen.transition] if chosen.transition.learned else []


def _collisions(folder: str, limit: int | None, bundle: str | None) -> Measured:
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


def _seams(n_pairs: int, rest: str, bundle: str | None) -> Measured:
    from signsplice.evaluation import seams

    if n_pairs < 1:
        raise InputError(f"--seams {n_pairs}, expected at least 1")
    with progress("seams") as advance:
        rows = seams.compare(seams.word_pairs(n_pairs, rest=rest), seams.compared_methods(bundle), advance)
    return seams.signature(rest), rows, seams.table(rows, rest)


def _bodies(n_words: int, files: tuple[str, ...], fps: float | None) -> Measured:
    from signsplice.evaluation import bodies

    if files:
        words = aside = _loaded(files, fps)
    else:
        words, aside = bodies.draw_words(n_words)
    drawn = None if files else n_words
    with progress("bodies") as advance:
        rows = bodies.compare(words, aside, progress=advance)
    return bodies.signature(drawn), rows, bodies.table(rows, drawn)


def _check_picture(picture: str, on_bodies: bool) -> None:
    if not on_bodies:
        raise InputError("--picture draws what --bodies measures; expected --bodies too")
    if Path(picture).suffix.lower() != ".png":
        raise InputError(f"--picture {picture}, expected a name that ends in .png")


def _draw_bodies(picture: str) -> None:
    from signsplice.evaluation.body_pictures import WORDS, write_pictures
    from signsplice.lexicon import shipped

    words = shipped()
    with progress("picture") as advance:
        write_pictures([words.clip(word) for word in WORDS], Path(picture), advance)


def _tempo(n_words: int, bundle: str | None) -> Measured:
    from signsplice.evaluation import tempo

    with progress("tempo") as advance:
        rows = tempo.compare(tempo.lexicons(n_words), bundle=bundle, progress=advance)
    return tempo.signature(n_words), rows, tempo.table(rows, n_words)


COMMANDS = (evaluate,)
