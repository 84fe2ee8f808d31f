"""The command ``evaluate``: every method measured on hidden frames, at seams, for collisions, on bodies, in tempo; and
the synthetic corpus beside real signing.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.clips import SKIN, limits, load, load_avatar, read_as, reads_clips
from signsplice.cli.options import AS_JSON, BUNDLE, preset, two_numbers
from signsplice.cli.terminal import progress, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.motion import Clip
    from signsplice.splicing.contracts import Transition

Measured = tuple[str, Sequence[Any], list[str]]
"""Signature, rows, and the rows as lines of Markdown."""

_FPS = click.option("--fps", type=float, metavar="N", help="Resample the clips to this rate first.")


@click.group()
def evaluate() -> None:
    """Measure every method, and print tables of it."""


def _add_command(measure: Callable[..., Measured]) -> click.Command:
    """Adds a command to `evaluate` that prints what a function measures: as tables, or as one JSON document."""

    @evaluate.command()
    @AS_JSON
    @wraps(measure)
    def command(as_json: bool, **options: Any) -> None:
        signature, rows, lines = measure(**options)
        if as_json:
            print(json.dumps({"signature": signature, "rows": rows}, indent=2, default=vars))
        else:
            print("\n".join(lines))

    return command


@_add_command
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@_FPS
@BUNDLE
@reads_clips
def clips(files: tuple[str, ...], fps: float | None, bundle: str | None) -> Measured:
    """Transitions on frames hidden from clips."""
    from signsplice.splicing.curves import TRANSITIONS
    from signsplice_workshop.measure.hidden_frames import SIGNATURE, score_hidden_frames, table

    transitions = [*TRANSITIONS.values(), *_find_learned_transition(bundle)]
    loaded = _load_clips(files, fps)
    with progress("evaluate") as advance:
        rows = score_hidden_frames(loaded, transitions, progress=advance)
    return SIGNATURE, rows, table(rows, loaded)


@_add_command
@click.argument("n_pairs", type=click.IntRange(1), default=100, metavar="[N]")
@preset("--rest", "hanging", "NAME", "How the signer's arms rest: hanging, folded, bent or low.")  # fmt: skip
@BUNDLE
def seams(n_pairs: int, rest: str, bundle: str | None) -> Measured:
    """Methods at the seams of N pairs (100) of words recorded apart."""
    from signsplice_workshop.measure import seams as measuring

    with progress("seams") as advance:
        pairs = measuring.word_pairs(n_pairs, rest=rest)
        rows = measuring.compare(pairs, measuring.methods_to_compare(bundle), advance)
    return measuring.signature(rest), rows, measuring.table(rows, rest)


@_add_command
@click.argument("folder", metavar="DIR")
@click.option("--limit", type=click.IntRange(1), metavar="N", help="Only the first N pairs.")
@BUNDLE
def pairs(folder: str, limit: int | None, bundle: str | None) -> Measured:
    """How deep transitions lead hands into the body."""
    from signsplice_workshop.corpora.pairs import Pairs
    from signsplice_workshop.measure import collisions

    corpus = Pairs(folder)
    methods = collisions.transitions_to_compare(*_find_learned_transition(bundle))
    numbers = range(len(corpus.index))[:limit]
    with progress("pairs") as advance:
        rows = collisions.compare(corpus, numbers, methods, advance)
    return collisions.SIGNATURE, rows, collisions.table(rows)


@_add_command
@click.argument("n_words", type=int, required=False, metavar="[N_WORDS]")
@click.option("--clips", "files", multiple=True, metavar="FILE", help="This clip, in place of words that ship; may be "
              "repeated.")  # fmt: skip
@click.option("--picture", metavar="FILE.png", help="Also draw eight words on five bodies; takes minutes.")
@_FPS
@reads_clips
def bodies(n_words: int | None, files: tuple[str, ...], picture: str | None, fps: float | None) -> Measured:
    """What words (40 that ship), or clips, keep on other bodies."""
    from signsplice_workshop.measure import bodies as measuring

    if files and n_words is not None:
        raise InputError(f"{n_words} words and --clips, expected one of them")
    if picture is not None and Path(picture).suffix.lower() != ".png":
        raise InputError(f"--picture {picture}, expected a name that ends in .png")
    if files:
        n_drawn, words = None, _load_clips(files, fps)
        held_out = words
    else:
        n_drawn = 40 if n_words is None else n_words
        words, held_out = measuring.draw_words(n_drawn)
    with progress("bodies") as advance:
        rows = measuring.compare(words, held_out, progress=advance)
    if picture is not None:
        from signsplice.lexicon import open_shipped_lexicon
        from signsplice_workshop.measure.body_pictures import WORDS, write_pictures

        with open_shipped_lexicon() as lexicon, progress("picture") as advance:
            write_pictures([lexicon.clip(word) for word in WORDS], Path(picture), advance)
    return measuring.signature(n_drawn), rows, measuring.table(rows, n_drawn)


@_add_command
@click.argument("n_sentences", type=click.IntRange(1), required=False, metavar="[N]")
@click.option("--clips", "files", multiple=True, metavar="FILE", help="This clip, in place of sentences; may be "
              "repeated.")  # fmt: skip
@_FPS
@reads_clips
def person(n_sentences: int | None, files: tuple[str, ...], fps: float | None) -> Measured:
    """Idle hands, head, trunk and face in N sentences (5) of each kind of words, or in clips."""
    from signsplice.splicing.durations import CITATION, NATURAL
    from signsplice_workshop.measure import person as measuring

    if files and n_sentences is not None:
        raise InputError(f"{n_sentences} sentences and --clips, expected one of them")
    with progress("person") as advance:
        if files:
            rows = measuring.measure_clips(_load_clips(files, fps), advance)
        else:
            rows = measuring.compare(n_sentences or 5, (CITATION, NATURAL), advance)
    return measuring.SIGNATURE, rows, measuring.table(rows)


@_add_command
@click.argument("files", nargs=-1, required=True, metavar="AVATAR...")
@click.option("--clips", "recorded", multiple=True, metavar="FILE", help="This clip, in place of six words that ship; "
              "may be repeated.")  # fmt: skip
@SKIN
@reads_clips
def avatars(files: tuple[str, ...], recorded: tuple[str, ...], skin: tuple[str, ...]) -> Measured:
    """How far hands lie from the skin that they touch on avatars."""
    from signsplice.lexicon import open_shipped_lexicon
    from signsplice_workshop.measure import avatars as measuring

    loaded = [load_avatar(file, read_as().roles, skin) for file in files]
    with open_shipped_lexicon() as lexicon:
        words = [lexicon.clip(word) for word in measuring.WORDS] if not recorded else _load_clips(recorded, None)
    with progress("avatars") as advance:
        rows = measuring.measure_words(loaded, words, advance)
    return measuring.signature(words), rows, measuring.table(rows)


@_add_command
@click.argument("n_words", type=int, default=40, metavar="[N_WORDS]")
@BUNDLE
def tempo(n_words: int, bundle: str | None) -> Measured:
    """What running tempo leaves of N words (40), and of others."""
    from signsplice_workshop.measure import tempo as measuring

    with progress("tempo") as advance:
        rows = measuring.compare(measuring.make_lexicons(n_words), bundle=bundle, progress=advance)
    return measuring.signature(n_words), rows, measuring.table(rows, n_words)


@evaluate.command()
@click.argument("corpus", metavar="DIR")
@click.option("--page", metavar="FILE.md", help="Page between whose two marks the tables go; needs --images.")
@click.option("--images", metavar="DIR", help="Folder for plots and contact sheets.")
@click.option("--real", metavar="DIR", help="Folder of BVH files of real signing, to compare with.")
@click.option("--real-frames", metavar="FIRST:STOP", help="With --real: only these frames of each file, half-open.")
@AS_JSON
def corpus(
    corpus: str, page: str | None, images: str | None, real: str | None, real_frames: str | None, as_json: bool
) -> None:
    """A synthetic corpus beside real signing and simple rules."""
    from signsplice_workshop.corpora.pairs import Pairs
    from signsplice_workshop.measure import corpus_page
    from signsplice_workshop.measure.measures import parse_tables

    if page is not None and images is None:
        raise InputError("--page shows pictures; expected --images DIR too")
    if images is not None and not Path(images).is_dir():
        raise InputError(f"{images}: no such folder; make it first")
    if real is not None and not Path(real).is_dir():
        raise InputError(f"{real}: no such folder, expected one with .bvh files")
    if real_frames is not None and real is None:
        raise InputError("--real-frames chooses frames of the files of --real; expected --real DIR too")
    frames = None if real_frames is None else _parse_frame_range(real_frames)
    real_clips = corpus_page.load_real_clips(None if real is None else Path(real), frames)
    folder = None if images is None else Path(images)
    if page is None:
        lines = corpus_page.measure_corpus(Pairs(corpus), folder, real_clips, progress)
    else:
        lines = corpus_page.write(Pairs(corpus), Path(page), Path(str(images)), real_clips, progress)
    if as_json:
        print(json.dumps({"signature": lines[0], "tables": parse_tables(lines)}, indent=2))
    elif page is None:
        print("\n".join(lines))
    else:
        print(f"{page}: tables; {images}: plots and contact sheets")


def _parse_frame_range(text: str) -> tuple[int, int]:
    expected = f"--real-frames {text}, expected FIRST:STOP with FIRST below STOP, as in 0:315"
    first, stop = two_numbers(text, ":", expected)
    if first >= stop:
        raise InputError(expected)
    return first, stop


def _load_clips(files: tuple[str, ...], fps: float | None) -> list[Clip]:
    """Returns the clips, at another rate if one is given."""
    from signsplice.motion import resample

    loaded = [load(file) for file in files]
    if fps is None:
        return loaded
    for clip in loaded:
        limits().check_resampling(clip, fps)
    return [resample(clip, fps) for clip in loaded]


def _find_learned_transition(bundle: str | None) -> list[Transition]:
    """Returns the learned transition, if there is one; warns if there is none."""
    from signsplice.splicing.options import choose

    chosen = choose("ends", None, "fixed", bundle)
    warn(chosen.warnings)
    return [chosen.transition] if chosen.transition.learned else []
