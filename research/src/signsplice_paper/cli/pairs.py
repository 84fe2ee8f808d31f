"""The commands `pairs`: corpora of pairs from clips, and back to clips."""

from __future__ import annotations

from pathlib import Path

import click

from signsplice.cli.clips import check_apart, limits, read_as, reads_clips
from signsplice.cli.terminal import progress, size, warn
from signsplice.errors import InputError

_OUT = click.option("-o", "--output", required=True, metavar="DIR", help="Folder to make; replaces one made before.")


@click.group()
def pairs() -> None:
    """Make corpora of pairs of your own words, for `train-system` and the tables."""


@pairs.command()
@click.argument("clips", metavar="CLIPS")
@_OUT
@click.option(
    "--positions",
    default="learned-fluent+learned",
    show_default=True,
    metavar="FILE.json|CUTTER+TRANSITION",
    help="Where words are left and entered: a file of positions, or a method that decides.",
)
@click.option(
    "--transition",
    metavar="NAME",
    help="What fills the pairs for which a file of positions names no transition.  [default: learned]",
)
@click.option("--words", type=int, metavar="N", help="How many words, drawn by seed.  [default: 100, or all]")
@click.option("--joints", metavar="LIST", help="Joints that the systems see, with commas between.  [default: all]")
@click.option("--seed", type=int, default=0, show_default=True, metavar="N", help="Seed of the draw and of the splits.")
@click.option("--fps", type=float, default=30.0, show_default=True, metavar="N", help="Frame rate of the corpus.")
@reads_clips
def build(
    clips: str,
    output: str,
    positions: str,
    transition: str | None,
    words: int | None,
    joints: str | None,
    seed: int,
    fps: float,
) -> None:
    """Write all ordered pairs of the words in a folder of clips of one rig.

    Called again after an interruption, it continues.
    """
    from signsplice_paper import own_words
    from signsplice_paper.own_clips import ClipChoice

    if not 10.0 <= fps <= 240.0:
        raise InputError(f"--fps {fps:g}, expected 10 to 240")
    is_file = positions.lower().endswith(".json")
    check_apart(output, [clips, positions if is_file else None])
    choice = ClipChoice(Path(clips), words, seed, fps, read_as(), limits())
    joint_names = None if joints is None else tuple(name.strip() for name in joints.split(",") if name.strip())
    result = own_words.build(own_words.PairsPlan(choice, positions, transition, joint_names), Path(output), progress)
    warn(result.warnings)
    disk_size = size(sum(path.stat().st_size for path in Path(output).iterdir()))
    print(f"{output}: {result.n_pairs} pairs of {result.n_words} words, {disk_size}, truth by {result.truth}")


@pairs.command()
@click.argument("corpus", metavar="PAIRS")
@_OUT
@click.option("--signer", type=int, default=1, show_default=True, metavar="N", help="Whose words.")
def export(corpus: str, output: str, signer: int) -> None:
    """Write a corpus of pairs as BVH: words, true transitions, and the file of positions."""
    from signsplice_paper.pair_export import export as export_pairs
    from signsplice_workshop.corpora.pairs import Pairs

    check_apart(output, [corpus])
    with progress("writing words and transitions") as advance:
        n_pairs = export_pairs(Pairs(corpus), Path(output), signer - 1, advance)
    print(f"{output}: {n_pairs} pairs; words in {Path(output) / 'words'}, positions in positions.json")


COMMANDS = (pairs,)
