"""Training: a system of the paper from a corpus of pairs to a bundle."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from signsplice.train.loop import ProgressCallback

Command = TypeVar("Command", bound=Callable[..., Any])


@click.group()
def train() -> None:
    """Train networks; needs the extra `train`."""


@train.command()
@click.option("--pairs", required=True, metavar="DIR", help="Corpus of pairs, of `signsplice synth pairs`.")
@click.option("--system", required=True, metavar="NAME|all", help="lpt, lpt-wa, ..., or all: a folder in --out each.")
@click.option("--scale", type=click.Choice(("smoke", "cpu", "paper")), default="cpu", show_default=True,
              help="How large the networks are and how long they learn.")  # fmt: skip
@click.option("--optimiser", type=click.Choice(("adamw", "sgd")), default="adamw", show_default=True,
              help="sgd: as in the paper, rate 1e-3.")  # fmt: skip
@click.option("--split", type=click.Choice(("random", "unseen-words", "unseen-signer")), default="random",
              show_default=True, help="Which pairs are learned from.")  # fmt: skip
@click.option("--out", required=True, metavar="DIR", help="Folder for the bundle.")
@click.option(
    "--parts", metavar="DIR", help="Checkpoints, shared by systems of the same parts.  [default: beside --out]"
)
@click.option("--steps", type=int, metavar="N", help="Steps of every part, in place of the scale's.")
@click.option("--fr", type=int, metavar="N", help="Frames that Culling keeps on each side.  [default: 8]")
@click.option("--seed", type=int, default=0, show_default=True, metavar="N", help="Of weights, batches and noise.")
@click.option("--device", default="auto", show_default=True, metavar="NAME", help="auto, cpu or cuda.")
@click.option("--bf16/--no-bf16", default=None, help="Half precision; by default on GPUs alone.")
def paper(
    pairs: str,
    system: str,
    scale: str,
    optimiser: str,
    split: str,
    out: str,
    parts: str | None,
    steps: int | None,
    fr: int | None,
    seed: int,
    device: str,
    bf16: bool | None,
) -> None:
    """Train a system of the paper and export it. Called again after an interruption, it goes on where it was.

    Several processes share the work: torchrun --nproc-per-node 2 -m signsplice train paper ...
    """
    _check_extra()
    from signsplice.synth.corpus import Pairs
    from signsplice.train import processes
    from signsplice.train.paper import scales, training

    corpus = Pairs(pairs)
    systems = list(scales.SYSTEMS) if system == "all" else [system]
    if system == "all" and fr is not None:
        raise InputError(f"--fr {fr} with --system all; name one system with a Culling layer")
    for name in systems:
        scales.parts(name, scale, fr, steps, optimiser, split)
    with processes.joined(device) as here:
        for name in systems:
            folder = Path(out) / name if system == "all" else Path(out)
            shared = Path(parts) if parts is not None else Path(out).parent / "parts"
            told = training.Training(name, scale, optimiser, split, seed, fr, steps, bf16)
            training.make(told, corpus, folder, shared, here, _teller if here.first else None)
            if here.first:
                print(f"{folder}: {name}, scale {scale}, {optimiser}, {split}")


def _own_options(command: Command) -> Command:
    """What the product's own networks share."""
    for option in reversed(
        (
            click.option("--out", required=True, metavar="DIR", help="Bundle that the network is written into."),
            click.option("--scale", type=click.Choice(("smoke", "ship", "more", "corpus")), default="ship",
                         show_default=True, help="How large the network is and how long it learns."),
            click.option("--steps", type=int, metavar="N", help="Steps in place of the scale's."),
            click.option("--seed", type=int, default=0, show_default=True, metavar="N", help="Of weights and pairs."),
            click.option("--device", default="auto", show_default=True, metavar="NAME", help="auto, cpu or cuda."),
        )
    ):  # fmt: skip
        command = option(command)
    return command


def _train_own(
    network: str,
    signing: Sequence[str],
    out: str,
    scale: str,
    steps: int | None,
    seed: int,
    device: str,
    earlier: Sequence[str] = (),
) -> None:
    _check_steps(steps, least=0 if earlier else 1)
    _check_extra()
    from signsplice.train import processes
    from signsplice.train.product import training as own

    with processes.joined(device) as here:
        told = own.ProductTraining(network, scale, seed, steps)
        folders = [[Path(folder) for folder in given] for given in (signing, earlier)]
        own.make(told, folders[0], Path(out), here, _teller if here.first else None, folders[1])
        if here.first:
            print(f"{out}: {network}, scale {scale}, {told.n_steps} steps")


def _check_steps(steps: int | None, least: int = 1) -> None:
    if steps is not None and steps < least:
        raise InputError(f"--steps {steps}, expected at least {least}")


_SIGNING = "Signing to learn from, of `signsplice synth endless`; several are drawn from as often."


@train.command()
@click.option("--signing", required=True, multiple=True, metavar="DIR", help=_SIGNING)
@click.option("--from", "earlier", multiple=True, metavar="DIR",
              help="An earlier training's folder, or a bundle: the first weights; of several the mean.")  # fmt: skip
@_own_options
def cutter(
    signing: tuple[str, ...], earlier: tuple[str, ...], out: str, scale: str, steps: int | None, seed: int, device: str
) -> None:
    """Train the network that finds where to leave and enter, and how long the way between takes. Called again after an
    interruption, it goes on where it was.
    """
    _train_own("cutter", signing, out, scale, steps, seed, device, earlier)


@train.command()
@click.option("--signing", multiple=True, metavar="DIR", help=_SIGNING)
@click.option("--lexicon", metavar="DIR", help="Lexicon to tune a trained network to, of `signsplice lexicon build`.")
@click.option("--from", "earlier", multiple=True, metavar="DIR", help="With --lexicon the bundle to tune [default: "
              "what ships]; with --signing a bundle or an earlier training's folder, of several the mean.")  # fmt: skip
@_own_options
def transition(
    signing: tuple[str, ...],
    lexicon: str | None,
    earlier: tuple[str, ...],
    out: str,
    scale: str,
    steps: int | None,
    seed: int,
    device: str,
) -> None:
    """Train the network that makes the frames between, or tune it to a lexicon of your own, and keep it if it is better
    there. Called again after an interruption, it goes on where it was.
    """
    if bool(signing) == (lexicon is not None):
        raise InputError("expected --signing DIR, to train anew, or --lexicon DIR, to tune; one of them")
    if signing:
        _train_own("transition", signing, out, scale, steps, seed, device, earlier)
        return
    if len(earlier) > 1:
        raise InputError(f"--lexicon tunes one network, expected one --from and not {len(earlier)}")
    _check_steps(steps)
    _check_extra()
    from signsplice.splicing.methods import WEIGHTS
    from signsplice.train import processes
    from signsplice.train.product import tuning

    source = Path(earlier[0]) if earlier else WEIGHTS
    with processes.joined(device) as here:
        told = tuning.Tuning(seed=seed) if steps is None else tuning.Tuning(steps=steps, seed=seed)
        tell = _teller("transition") if here.first else None
        outcome = tuning.make(told, Path(str(lexicon)), source, Path(out), here, tell)
    errors = f"{outcome.after:.1f} tuned, {outcome.before:.1f} before, {outcome.classical:.1f} classical"
    print(f"{outcome.n_learned} words taught; error on {outcome.n_held} held back, arm / 1000: {errors}")
    print(f"{out}: written" if outcome.better else f"{out}: not written, since the tuned network is no better")


@click.command()
@click.argument("bundle", metavar="BUNDLE")
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for the bundle to write.")
@click.option("--int8", is_flag=True, required=True, help="With 8-bit weights: smaller and quicker, and less exact.")
def export(bundle: str, output: str, int8: bool) -> None:
    """Write the networks of a bundle in another form; needs the extra `train`. `signsplice evaluate` tells what it
    costs.
    """
    _check_extra()
    from signsplice.train import quantization

    before, after = quantization.quantize_bundle(Path(bundle), Path(output))
    print(f"{output}: {before / 1e6:.1f} MB in {after / 1e6:.1f} MB")


def _check_extra() -> None:
    missing = [name for name in ("torch", "onnxscript", "filelock") if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training needs {missing[0]}: pip install 'signsplice[train]'")


def _teller(part: str) -> ProgressCallback:
    """Writes a part's progress to standard error: on one line in a terminal, else the scores alone."""
    lively = sys.stderr.isatty()

    def tell(step: int, steps: int, numbers: dict[str, float]) -> None:
        scores = "loss" not in numbers
        if not lively and not scores:
            return
        left = ""
        if not scores:
            minutes = numbers["seconds_a_step"] * (steps - step) / 60.0
            left = f", {minutes:.1f} min left"
        shown = " ".join(f"{name} {value:.4g}" for name, value in numbers.items() if name != "seconds_a_step")
        print(f"{part} {step}/{steps}: {shown}{left}", end="\n" if scores or not lively else "\r", file=sys.stderr)

    return tell


COMMANDS = (train, export)
