"""The commands `synth`: lexicons, sentences and pairs of the synthetic signer, with the ground truth of splices."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from signsplice_workshop.cli.evaluate import corpus

from signsplice.cli.aliases import moved
from signsplice.cli.clips import check_apart, check_output, check_outputs
from signsplice.cli.options import PROCESSES, added, preset
from signsplice.cli.terminal import progress, size, warn
from signsplice.errors import InputError
from signsplice.formats.atomic import check_writable, replacing

if TYPE_CHECKING:
    from signsplice.signer.phonology import Sign
    from signsplice.signer.planner import IsolatedWord

_SEED = preset("--seed", 0, "N", "Seed of signers, takes and random choices.")
_FPS = preset("--fps", 30.0, "N", "Frame rate.")
_DRAWN = added(
    click.option("-o", "--output", required=True, metavar="DIR", help="Folder to make; replaces one made before."),
    click.option("--signs", metavar="FILE", help="Signs in notation, instead of the package's."),
    click.option("--words", type=int, metavar="N", help="Number of words, drawn by seed.  [default: all; pairs: 100]"),
    click.option("--pseudo", type=int, default=0, metavar="N", help="Number of random pseudo-signs to add."),
    _SEED,
    _FPS,
)
"""Options of what is made of the package's words, or of a file's."""


@click.group()
def synth() -> None:
    """Make motion of the synthetic signer, with the exact ground truth of every splice."""


@synth.command()
@_DRAWN
@click.option(
    "--letters/--no-letters", default=True, help="Add the manual alphabet and digits, unless --signs is given."
)
@click.option(
    "--form",
    "forms",
    multiple=True,
    metavar="GLOSS",
    help="Add a form of a word: 2-GIVE-1, LOOK-HABITUAL; may be given again.",
)
def lexicon(output: str, letters: bool, forms: tuple[str, ...], seed: int, fps: float, **drawn: Any) -> None:
    """Write isolated words as BVH files with glosses.csv; by default every word and letter of the package."""
    from signsplice_workshop.corpora.pairs import Recipe

    from signsplice.signer import checks, notation
    from signsplice.synth import folders

    check_apart(output, [drawn["signs"]])
    chosen = list(notation.alphabet().values()) if letters and drawn["signs"] is None else []
    chosen += _chosen(**drawn, seed=seed)
    chosen += _forms(drawn["signs"], forms, {sign.gloss for sign in chosen})
    recipe = Recipe(tuple(chosen), seed, _rate(fps))
    written = set() if drawn["signs"] is None else {sign.gloss for sign in chosen if sign.kind != "pseudo"}
    faults: list[str] = []

    def check(word: IsolatedWord) -> None:
        if word.sign.gloss in written:
            faults.extend(checks.warnings(word))

    with progress(f"signing {len(chosen)} words") as advance:
        folders.write_lexicon(chosen, recipe.signers()[0], Path(output), fps, advance, check)
    warn(faults)
    print(f"{output}: {len(chosen)} words, signer {recipe.signers()[0].name}; no signer has checked them")


@synth.command()
@click.argument("file", metavar="[FILE]", required=False)
@click.argument("gloss", metavar="[GLOSS]", required=False)
@click.option("-o", "--output", metavar="PNG", help="Picture to write.  [default: GLOSS.png]")
@click.option("--all", "folder", metavar="DIR", help="Draw every name of the notation instead, into this folder.")
def preview(file: str | None, gloss: str | None, output: str | None, folder: str | None) -> None:
    """Draw one sign, or form of a sign, of a file in notation: postures and movements, from the front and the side.

    FILE may be `-`: the words that ship.
    """
    from signsplice.signer import checks, inflection, notation, planner
    from signsplice.synth import folders
    from signsplice.synth import preview as notation_pictures
    from signsplice.synth import preview as sign_pictures

    if folder is not None:
        if file is not None or output is not None:
            raise InputError("--all draws the names of the notation, expected no FILE, GLOSS or -o")
        if not Path(folder).is_dir():
            raise InputError(f"{folder}: no such folder, expected one to draw into")
        for path in notation_pictures.write_names(Path(folder)):
            print(f"{path}: {size(path.stat().st_size)}")
        return
    if file is None or gloss is None:
        raise InputError("expected a file and a gloss: signsplice synth preview FILE GLOSS [-o PNG]")
    path = Path(output or f"{folders.file_name(gloss)}.png")
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: expected a name that ends in .png")
    check_writable(path)
    check_apart(str(path), [file])
    signs = notation.everyday() | notation.alphabet() if file == "-" else notation.read(file)
    try:
        sign = inflection.form(signs, gloss)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    word = planner.isolated(sign)
    sign_pictures.write_preview(word, path)
    warn(checks.warnings(word))
    print(f"{path}: {sign.gloss}, {len(sign.segments)} segments, {word.clip.seconds:.2f} s with rest")


@synth.command()
@click.argument("file", metavar="FILE")
@click.argument("gloss", metavar="[GLOSS]", required=False)
@click.option(
    "-o",
    "--output",
    metavar="OUT",
    help="File to write; a .glb keeps the face, .signs is the notation, to mend by hand.  [default: GLOSS.bvh]",
)
@click.option("--lenient", is_flag=True, help="Leave out what is not understood, with a warning.")
@_FPS
def sign(file: str, gloss: str | None, output: str | None, lenient: bool, fps: float) -> None:
    """Sign one sign that is written in SiGML or HamNoSys, or in the notation of this project.

    GLOSS may be left out where FILE has one sign. No signer has checked such signs.
    """
    from signsplice import formats
    from signsplice.signer import notation, planner
    from signsplice.signer.notation import notation_text
    from signsplice.synth import folders
    from signsplice.written import signing
    from signsplice.written.compiler import compile_sign

    if Path(file).suffix.lower() == ".signs":
        from signsplice.signer import inflection

        signs = notation.read(file)
        clip = planner.isolated(inflection.form(signs, gloss or _only(file, signs)), fps=_rate(fps)).clip
    else:
        written = signing.find(file, gloss or "", lenient)
        if output and Path(output).suffix.lower() == ".signs":
            check_output(output, [file])
            with replacing(Path(output)) as temporary:
                temporary.write_text(notation_text(compile_sign(written, lenient)), encoding="utf-8")
            warn(signing.warnings(written))
            print(f"{output}: {written.gloss} in this project's notation, without its face")
            return
        clip = signing.signed(written, _rate(fps), lenient)
        warn([*signing.warnings(written), *clip.notes])
    path = output or f"{folders.file_name(clip.name)}.bvh"
    check_outputs(path, None, [file])
    formats.save(clip, path)
    print(f"{path}: {clip.name}, {clip.seconds:.2f} s with rest; no signer has checked it")


def _only(file: str, signs: dict[str, Sign]) -> str:
    """The gloss of a file's only sign."""
    if len(signs) != 1:
        raise InputError(f"{file}: {len(signs)} signs, expected the gloss of one of them: {', '.join([*signs][:5])}")
    return next(iter(signs))


@synth.command()
@_DRAWN
@preset("--count", 20, "N", "How many sentences.")
@click.option(
    "--exact",
    is_flag=True,
    help="Join words as pairs: no weak hand stays up, no pronoun assimilates, no transition pauses.",
)
def sentences(output: str, count: int, exact: bool, seed: int, fps: float, **drawn: Any) -> None:
    """Write random sentences of 3 to 12 words as BVH, their isolated words, and the ground truth of every seam."""
    from signsplice_workshop.corpora.pairs import Recipe

    from signsplice.synth import folders

    check_apart(output, [drawn["signs"]])
    if count < 1:
        raise InputError(f"--count {count}, expected at least 1")
    recipe = Recipe(tuple(_chosen(**drawn, seed=seed, least=2)), seed, _rate(fps))
    with progress(f"signing {count} sentences") as advance:
        folders.write_sentences(recipe, count, Path(output), not exact, advance)
    print(f"{output}: {count} sentences of {len(recipe.signs)} words, recipe {recipe.hash}")


@synth.command()
@_DRAWN
@preset("--other-signer", 1000, "N", "How many pairs a second signer makes, to test on.")
@preset(
    "--truth",
    "partner",
    None,
    "Where a word is left and entered: by both words, or at one frame of its own whoever its partner is.",
    type=click.Choice(["partner", "word"]),
)
@PROCESSES
def pairs(output: str, other_signer: int, truth: str, processes: int, seed: int, fps: float, **drawn: Any) -> None:
    """Write all ordered pairs of words (by default 100: 10,000 pairs) with true cut frames, transitions and splits."""
    from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs

    check_apart(output, [drawn["signs"]])
    if other_signer < 0 or processes < 1:
        raise InputError(f"--other-signer {other_signer} --processes {processes}, expected at least 0 and 1")
    if drawn["words"] is None and drawn["signs"] is None and not drawn["pseudo"]:
        drawn["words"] = 100
    chosen = tuple(_chosen(**drawn, seed=seed, least=2))
    recipe = Recipe(chosen, seed, _rate(fps), min(other_signer, len(chosen) ** 2), truth)
    with progress(f"splicing {len(chosen) ** 2} pairs") as advance:
        write_pairs(recipe, Path(output), advance, processes)
    made = Pairs(output)
    takes = size(sum(path.stat().st_size for path in Path(output).iterdir()))
    print(f"{output}: {len(made)} pairs of {len(chosen)} words, {takes}, recipe {recipe.hash}")


@synth.command()
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder to write into, one file a signer.")
@preset("--signers", 40, "N", "Number of signers.")
@preset("--words", 100, "N", "Number of pseudo-signs of each signer.")
@preset("--seams", 300, "N", "Number of transitions in each signer's sentences.")
@preset(
    "--traits", "all", "NAMES|none|all", "How signers differ from plain motion: names of traits with commas between."
)
@_SEED
@_FPS
@PROCESSES
def endless(
    output: str, signers: int, words: int, seams: int, traits: str, seed: int, fps: float, processes: int
) -> None:
    """Write signing to train networks on: many signers, each with their own words, on the canonical humanoid.

    Called again after an interruption, it continues.
    """
    from signsplice_workshop.corpora import training_data

    plan = training_data.TrainingDataPlan(signers, words, seams, seed, _rate(fps), _traits(traits))
    with progress(f"signing by {signers} signers") as advance:
        n_parts = training_data.write(plan, Path(output), advance, processes)
    print(f"{output}: {n_parts} signers of {words} words and {seams} seams each")


@synth.command()
@click.argument("folder", metavar="PAIRS")
@preset("--split", "random", "NAME", "Split to write.")
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder to write into.")
def signing(folder: str, split: str, output: str) -> None:
    """Write the training and validation parts of a corpus of pairs as signing to train networks on."""
    from signsplice_workshop.corpora import training_data
    from signsplice_workshop.corpora.pairs import Pairs

    for path in training_data.write_split(Pairs(folder), split, Path(output)):
        print(f"{path}: {size(path.stat().st_size)}")


synth.add_command(moved("synth study", corpus, "evaluate corpus"))


def _chosen(signs: str | None, words: int | None, pseudo: int, seed: int, least: int = 1) -> list[Sign]:
    """The signs of a call: those of a file or of the package, all or some drawn by seed, and pseudo-signs."""
    from signsplice_workshop.corpora.pseudo import sign

    from signsplice.signer import notation
    from signsplice.signer.signer import stream

    if pseudo < 0 or (words is not None and words < 0):
        raise InputError(f"--words {words} --pseudo {pseudo}, expected numbers of at least 0")
    known = list((notation.everyday() if signs is None else notation.read(signs)).values())
    if words is not None and words > len(known):
        where = signs or "the package"
        raise InputError(f"--words {words}, but {where} has {len(known)}; add some with --pseudo N")
    order = sorted(stream("choose", seed).permutation(len(known))[:words].tolist())
    chosen = [known[k] for k in order] + [sign(100_000 * seed + k) for k in range(pseudo)]
    if len(chosen) < least:
        raise InputError(f"{len(chosen)} words chosen, expected at least {least}")
    return chosen


def _forms(path: str | None, glosses: tuple[str, ...], made: set[str]) -> list[Sign]:
    """The forms of a file's or the package's signs that are named, but for those that are made already."""
    from signsplice.signer import inflection, notation

    known = (notation.everyday() if path is None else notation.read(path)) if glosses else {}
    forms = {form.gloss: form for form in (inflection.form(known, gloss) for gloss in glosses)}
    return [form for gloss, form in forms.items() if gloss not in made]


def _traits(text: str) -> tuple[str, ...] | None:
    """Names of traits, none of them, or None for all."""
    if text == "all":
        return None
    return () if text == "none" else tuple(text.split(","))


def _rate(fps: float) -> float:
    if not 10.0 <= fps <= 240.0:
        raise InputError(f"--fps {fps:g}, expected 10 to 240")
    return fps


COMMANDS = (synth,)
