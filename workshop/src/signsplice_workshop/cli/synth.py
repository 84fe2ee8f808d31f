"""The commands of `synth` that write corpora with the truth of every seam: pairs, sentences, signing to train on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from signsplice.cli.clips import check_apart
from signsplice.cli.options import flag, preset
from signsplice.cli.synth import DRAWN, FPS, SEED, check_frame_rate, chosen_signs
from signsplice.cli.terminal import progress, size
from signsplice.errors import InputError

PROCESSES = preset("--processes", 2, "N", "Number of processes.")


@click.command()
@DRAWN
@preset("--count", 20, "N", "How many sentences.")
@click.option(
    "--exact",
    is_flag=True,
    help="Join words as pairs: no weak hand stays up, no pronoun assimilates, no transition pauses.",
)
def sentences(output: str, count: int, exact: bool, seed: int, fps: float, **drawn: Any) -> None:
    """Write random sentences of 3 to 12 words as BVH, their isolated words, and the ground truth of every seam."""
    from signsplice_workshop.corpora.pairs import Recipe
    from signsplice_workshop.corpora.sentences import write_sentences

    check_apart(output, [drawn["signs"]])
    if count < 1:
        raise InputError(f"--count {count}, expected at least 1")
    recipe = Recipe(tuple(chosen_signs(**drawn, seed=seed, least=2)), seed, check_frame_rate(fps))
    with progress(f"signing {count} sentences") as advance:
        write_sentences(recipe, count, Path(output), not exact, advance)
    print(f"{output}: {count} sentences of {len(recipe.signs)} words, recipe {recipe.hash}")


OTHER_SIGNER = 1000


@click.command()
@DRAWN
@preset("--other-signer", OTHER_SIGNER, "N", "How many pairs a second signer makes, to test on.")
@preset(
    "--truth",
    "partner",
    None,
    "Where a word is left and entered: by both words, at one frame of its own whoever its partner is, or at one of "
    "its events, which the partner chooses (version 4; always 30 fps).",
    type=click.Choice(["partner", "word", "events"]),
)
@preset(
    "--teach",
    0,
    "N",
    "With --truth events: pseudo-signs of N signers to teach on, --words of each, instead of words to judge on.",
)
@flag("--own-manner", "With --teach: signers do not hold postures; for systems that are used, not judged.")
@PROCESSES
def pairs(
    output: str,
    other_signer: int,
    truth: str,
    teach: int,
    own_manner: bool,
    processes: int,
    seed: int,
    fps: float,
    **drawn: Any,
) -> None:
    """Write all ordered pairs of words (by default 100: 10,000 pairs) with true cut frames, transitions and splits."""
    from signsplice.signer import planner
    from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs

    check_apart(output, [drawn["signs"]])
    if other_signer < 0 or processes < 1:
        raise InputError(f"--other-signer {other_signer} --processes {processes}, expected at least 0 and 1")
    if teach < 0 or (teach and truth != "events"):
        raise InputError(f"--teach {teach} --truth {truth}, expected at least 0, and --truth events")
    if own_manner and not teach:
        raise InputError("--own-manner says how signers to teach on sign, expected --teach too")
    if truth == "events":
        if fps != planner.FPS:
            raise InputError(f"--fps {fps:g}, expected {planner.FPS:g} with --truth events")
        if other_signer != OTHER_SIGNER or (teach and (drawn["signs"] or drawn["pseudo"])):
            raise InputError("--truth events takes no --other-signer, and --teach neither --signs nor --pseudo")
        _write_readable(output, teach, own_manner, processes, seed, drawn)
        return
    if drawn["words"] is None and drawn["signs"] is None and not drawn["pseudo"]:
        drawn["words"] = 100
    signs = tuple(chosen_signs(**drawn, seed=seed, least=2))
    recipe = Recipe(signs, seed, check_frame_rate(fps), min(other_signer, len(signs) ** 2), truth)
    with progress(f"splicing {len(signs) ** 2} pairs") as advance:
        write_pairs(recipe, Path(output), advance, processes)
    corpus = Pairs(output)
    disk_size = size(sum(path.stat().st_size for path in Path(output).iterdir()))
    print(f"{output}: {len(corpus)} pairs of {len(signs)} words, {disk_size}, recipe {recipe.hash}")


def _write_readable(
    output: str, teach: int, own_manner: bool, processes: int, seed: int, drawn: dict[str, Any]
) -> None:
    """Writes a corpus whose truth can be read: to train on, by ``teach`` signers, or to evaluate on if that is 0."""
    from signsplice_workshop.corpora.pairs import Pairs
    from signsplice_workshop.corpora.readable_pairs import JudgedCorpus, OwnMannerCorpus, TaughtCorpus, write_readable

    recipe: JudgedCorpus | TaughtCorpus
    if teach:
        kind = OwnMannerCorpus if own_manner else TaughtCorpus
        recipe = kind(teach, drawn["words"] or TaughtCorpus.n_words, seed=seed)
    else:
        n_known = drawn["words"] or JudgedCorpus.n_known
        signs = tuple(chosen_signs(**{**drawn, "words": None}, seed=seed, least=2))
        n_unseen = max(2, n_known * JudgedCorpus.n_unseen // JudgedCorpus.n_known)
        recipe = JudgedCorpus(signs, seed, n_known, n_unseen)
    with progress("making signers") as advance:
        write_readable(recipe, Path(output), advance, processes)
    corpus = Pairs(output)
    disk_size = size(sum(path.stat().st_size for path in Path(output).iterdir()))
    n_words, n_signers = len(corpus.head["words"]), len(corpus.signers)
    print(
        f"{output}: {len(corpus)} pairs, {n_words} words by {n_signers} signers, {disk_size}, "
        f"recipe {corpus.head['hash']}"
    )


@click.command()
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder to write into, one file a signer.")
@preset("--signers", 40, "N", "Number of signers.")
@preset("--words", 100, "N", "Number of pseudo-signs of each signer.")
@preset("--seams", 300, "N", "Number of transitions in each signer's sentences.")
@preset(
    "--traits", "all", "NAMES|none|all", "How signers differ from plain motion: names of traits with commas between."
)
@SEED
@FPS
@PROCESSES
def endless(
    output: str, signers: int, words: int, seams: int, traits: str, seed: int, fps: float, processes: int
) -> None:
    """Write signing to train networks on: many signers, each with their own words, on the canonical humanoid.

    Called again after an interruption, it continues.
    """
    from signsplice_workshop.corpora import training_data

    plan = training_data.TrainingDataPlan(signers, words, seams, seed, check_frame_rate(fps), _parse_traits(traits))
    with progress(f"signing by {signers} signers") as advance:
        n_parts = training_data.write(plan, Path(output), advance, processes)
    print(f"{output}: {n_parts} signers of {words} words and {seams} seams each")


@click.command()
@click.argument("folder", metavar="PAIRS")
@preset("--split", "random", "NAME", "Split to write.")
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder to write into.")
def signing(folder: str, split: str, output: str) -> None:
    """Write the training and validation parts of a corpus of pairs as signing to train networks on."""
    from signsplice_workshop.corpora import training_data
    from signsplice_workshop.corpora.pairs import Pairs

    for path in training_data.write_split(Pairs(folder), split, Path(output)):
        print(f"{path}: {size(path.stat().st_size)}")


def _parse_traits(text: str) -> tuple[str, ...] | None:
    """Returns the names of traits, none of them, or None for all."""
    if text == "all":
        return None
    return () if text == "none" else tuple(text.split(","))
