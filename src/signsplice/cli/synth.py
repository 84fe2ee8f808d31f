"""The commands `synth`: make words of the synthetic signer, from its notation and from written signs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli import plugins
from signsplice.cli.clips import check_apart, check_output, check_outputs
from signsplice.cli.options import combine_options, flag, option, preset
from signsplice.cli.terminal import progress, size, warn
from signsplice.errors import InputError
from signsplice.formats.atomic import check_writable, replacing

if TYPE_CHECKING:
    from signsplice.signer.phonology import Sign
    from signsplice.signer.planner import IsolatedWord


SEED = preset("--seed", 0, "N", "Seed of signers, takes and random choices.")
FPS = preset("--fps", 30.0, "N", "Frame rate.")
DRAWN = combine_options(
    option("-o --output", "DIR", "Folder to make; replaces one made before.", required=True),
    option("--signs", "FILE", "Signs in notation, instead of the package's."),
    option("--words", "N", "Number of words, drawn by seed.  [default: all; pairs: 100]", type=int),
    option("--pseudo", "N", "Number of random pseudo-signs to add.", type=int, default=0),
    SEED,
    FPS,
)
"""Options of commands that make motion of the package's words, or of a file's."""


@click.group(cls=plugins.OpenGroup)
def synth() -> None:
    """Make motion of the synthetic signer."""


@synth.command()
@DRAWN
@option("--letters/--no-letters", None, "Add the manual alphabet and digits, unless --signs is given.", default=True)
@option("--form forms", "GLOSS", "Add a form of a word: 2-GIVE-1, LOOK-HABITUAL; may be given again.", multiple=True)
def lexicon(output: str, letters: bool, forms: tuple[str, ...], seed: int, fps: float, **drawn: Any) -> None:
    """Write isolated words as BVH files with glosses.csv; by default every word and letter of the package."""
    from signsplice.signer import checks, folders, notation

    check_apart(output, [drawn["signs"]])
    chosen = list(notation.alphabet().values()) if letters and drawn["signs"] is None else []
    chosen += chosen_signs(**drawn, seed=seed)
    chosen += _forms(drawn["signs"], forms, {sign.gloss for sign in chosen})
    signer = folders.lexicon_signer(seed)
    written = set() if drawn["signs"] is None else {sign.gloss for sign in chosen if sign.kind != "pseudo"}
    faults: list[str] = []

    def check(word: IsolatedWord) -> None:
        if word.sign.gloss in written:
            faults.extend(checks.warnings(word))

    with progress(f"signing {len(chosen)} words") as advance:
        folders.write_lexicon(chosen, signer, Path(output), check_frame_rate(fps), advance, check)
    warn(faults)
    print(f"{output}: {len(chosen)} words, signer {signer.name}; no signer has checked them")


@synth.command()
@click.argument("file", metavar="[FILE]", required=False)
@click.argument("gloss", metavar="[GLOSS]", required=False)
@option("-o --output", "PNG", "Picture to write.  [default: GLOSS.png]")
@option("--all folder", "DIR", "Draw every name of the notation instead, into this folder.")
def preview(file: str | None, gloss: str | None, output: str | None, folder: str | None) -> None:
    """Draw one sign, or form of a sign, of a file in notation: postures and movements, from the front and the side.

    FILE may be `-`: the words that ship.
    """
    from signsplice.signer import checks, folders, inflection, notation, planner
    from signsplice.signer import preview as pictures

    if folder is not None:
        if file is not None or output is not None:
            raise InputError("--all draws the names of the notation, expected no FILE, GLOSS or -o")
        if not Path(folder).is_dir():
            raise InputError(f"{folder}: no such folder, expected one to draw into")
        for path in pictures.write_names(Path(folder)):
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
    word = planner.synthesize_word(sign)
    pictures.write_preview(word, path)
    warn(checks.warnings(word))
    print(f"{path}: {sign.gloss}, {len(sign.segments)} segments, {word.clip.seconds:.2f} s with rest")


@synth.command()
@click.argument("file", metavar="FILE")
@click.argument("gloss", metavar="[GLOSS]", required=False)
@option(
    "-o --output",
    "OUT",
    "File to write; a .glb keeps the face, .signs is the notation, to mend by hand.  [default: GLOSS.bvh]",
)
@flag("--lenient", "Leave out what is not understood, with a warning.")
@FPS
def sign(file: str, gloss: str | None, output: str | None, lenient: bool, fps: float) -> None:
    """Sign one sign that is written in SiGML or HamNoSys, or in the notation of this project.

    GLOSS may be left out where FILE has one sign. No signer has checked such signs.
    """
    from signsplice import formats
    from signsplice.signer import folders, notation, planner
    from signsplice.signer.notation import notation_text
    from signsplice.written import signing
    from signsplice.written.compiler import compile_sign

    if Path(file).suffix.lower() == ".signs":
        from signsplice.signer import inflection

        signs = notation.read(file)
        clip = planner.synthesize_word(
            inflection.form(signs, gloss or _only(file, signs)), fps=check_frame_rate(fps)
        ).clip
    else:
        written = signing.find(file, gloss or "", lenient)
        if output and Path(output).suffix.lower() == ".signs":
            check_output(output, [file])
            with replacing(Path(output)) as temporary:
                temporary.write_text(notation_text(compile_sign(written, lenient)), encoding="utf-8")
            warn(signing.warnings(written))
            print(f"{output}: {written.gloss} in this project's notation, without its face")
            return
        clip = signing.animate_sign(written, check_frame_rate(fps), lenient)
        warn([*signing.warnings(written), *clip.notes])
    path = output or f"{folders.file_name(clip.name)}.bvh"
    check_outputs(path, None, [file])
    formats.save(clip, path)
    print(f"{path}: {clip.name}, {clip.seconds:.2f} s with rest; no signer has checked it")


def _only(file: str, signs: dict[str, Sign]) -> str:
    """Return the gloss of a file's only sign."""
    if len(signs) != 1:
        raise InputError(f"{file}: {len(signs)} signs, expected the gloss of one of them: {', '.join([*signs][:5])}")
    return next(iter(signs))


def chosen_signs(signs: str | None, words: int | None, pseudo: int, seed: int, least: int = 1) -> list[Sign]:
    """Return the signs of a call: those of a file or of the package, all or some drawn by seed, and pseudo-signs."""
    from signsplice.signer import notation
    from signsplice.signer.signer import stream

    if pseudo < 0 or (words is not None and words < 0):
        raise InputError(f"--words {words} --pseudo {pseudo}, expected numbers of at least 0")
    known = list((notation.everyday() if signs is None else notation.read(signs)).values())
    if words is not None and words > len(known):
        where = signs or "the package"
        raise InputError(f"--words {words}, but {where} has {len(known)}; add some with --pseudo N")
    order = sorted(stream("choose", seed).permutation(len(known))[:words].tolist())
    chosen = [known[k] for k in order]
    if pseudo:
        draw = plugins.load(plugins.PSEUDO)
        chosen += [draw(100_000 * seed + k) for k in range(pseudo)]
    if len(chosen) < least:
        raise InputError(f"{len(chosen)} words chosen, expected at least {least}")
    return chosen


def _forms(path: str | None, glosses: tuple[str, ...], made: set[str]) -> list[Sign]:
    """Return the named forms of a file's or the package's signs, except those that are already made."""
    from signsplice.signer import inflection, notation

    known = (notation.everyday() if path is None else notation.read(path)) if glosses else {}
    forms = {form.gloss: form for form in (inflection.form(known, gloss) for gloss in glosses)}
    return [form for gloss, form in forms.items() if gloss not in made]


def check_frame_rate(fps: float) -> float:
    """Return the frame rate of a call, Hz. Raises ``InputError`` unless it is from 10 to 240."""
    if not 10.0 <= fps <= 240.0:
        raise InputError(f"--fps {fps:g}, expected 10 to 240")
    return fps


COMMANDS = (synth,)
