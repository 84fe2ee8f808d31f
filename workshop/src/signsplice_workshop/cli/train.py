"""The commands `train cutter`, `train transition` and `export`."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.options import combine_options, preset
from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from signsplice_workshop.train.loop import ProgressCallback

_SCALES = ("smoke", "ship", "more", "corpus")


@click.group()
def train() -> None:
    """Train networks; needs the extra `train` of signsplice-workshop."""


_product_options = combine_options(
    click.option("--out", required=True, metavar="DIR", help="Bundle that the network is written into."),
    preset("--scale", "ship", None, "How large the network is and how long it is trained.", type=click.Choice(_SCALES)),
    click.option("--steps", type=int, metavar="N", help="Steps in place of the scale's."),
    click.option(
        "--batch", type=click.IntRange(min=1), metavar="N",
        help="Size of a batch in place of the scale's; several processes divide it.",
    ),
    preset("--seed", 0, "N", "Of weights and batches."),
    preset("--device", "auto", "NAME", "auto, cpu or cuda."),
)  # fmt: skip
"""Options that `train cutter` and `train transition` share."""


def _train_product(
    network: str, signing: Sequence[str], earlier: str | None, out: str, device: str, **options: Any
) -> None:
    _check_steps(options["steps"])
    check_extra()
    from signsplice_workshop.train import processes, training

    with processes.join_process_group(device) as process:
        config = training.ProductTraining(network, **options)
        data, start = [Path(folder) for folder in signing], None if earlier is None else Path(earlier)
        progress = make_progress_printer(network) if process.first else None
        training.make(config, data, Path(out), process, progress, start)
        if process.first:
            print(f"{out}: {network}, scale {config.scale}, {config.n_steps} steps")


def _check_steps(steps: int | None) -> None:
    if steps is not None and steps < 1:
        raise InputError(f"--steps {steps}, expected at least 1")


_SIGNING = "Signing to train on, of `synth endless` or `synth signing`; several folders are used equally often."


@train.command()
@click.option("--signing", required=True, multiple=True, metavar="DIR", help=_SIGNING)
@click.option("--from", "earlier", metavar="DIR", help="Folder of an earlier training, or a bundle, to start from.")
@_product_options
def cutter(signing: tuple[str, ...], earlier: str | None, **options: Any) -> None:
    """Train the network that finds where to leave and enter words. The same command
    continues after an interruption.

    Several processes can divide the work: torchrun --nproc-per-node 2 -m signsplice train cutter ...
    """
    _train_product("cutter", signing, earlier, **options)


@train.command()
@click.option("--signing", multiple=True, metavar="DIR", help=_SIGNING)
@click.option("--lexicon", metavar="DIR", help="Lexicon to tune a trained network to, of `signsplice lexicon build`.")
@click.option("--from", "earlier", metavar="DIR", help="With --lexicon the bundle to tune [default: what ships]; with "
              "--signing a bundle or an earlier training's folder.")  # fmt: skip
@_product_options
def transition(signing: tuple[str, ...], lexicon: str | None, earlier: str | None, **options: Any) -> None:
    """Train the network that makes the transition's frames, or tune it to your own lexicon, and keep it if it is better
    there. The same command continues after an interruption.

    With --signing, several processes can divide the work: torchrun --nproc-per-node 2 -m signsplice train transition
    --signing ...
    """
    if bool(signing) == (lexicon is not None):
        raise InputError("expected either --signing DIR, to train, or --lexicon DIR, to tune")
    if lexicon is None:
        _train_product("transition", signing, earlier, **options)
        return
    if options["batch"] is not None:
        raise InputError("--batch is for --signing; tuning has a batch of its own")
    _tune(lexicon, earlier, **options)


def _tune(
    lexicon: str, source: str | None, *, out: str, steps: int | None, seed: int, device: str, **_: object
) -> None:
    _check_steps(steps)
    check_extra()
    from signsplice.splicing.bundle import WEIGHTS
    from signsplice_workshop.train import processes, tuning

    with processes.join_process_group(device) as process:
        config = tuning.Tuning(seed=seed) if steps is None else tuning.Tuning(steps=steps, seed=seed)
        progress = make_progress_printer("transition") if process.first else None
        result = tuning.make(
            config, Path(lexicon), WEIGHTS if source is None else Path(source), Path(out), process, progress
        )
    errors = f"{result.after:.1f} tuned, {result.before:.1f} before, {result.classical:.1f} classical"
    print(f"trained on {result.n_train} words; error on {result.n_held} held back, arm length / 1000: {errors}")
    print(f"{out}: written" if result.better else f"{out}: not written, because the tuned network is no better")


@click.command()
@click.argument("bundle", metavar="BUNDLE")
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for the bundle to write.")
def export(bundle: str, output: str) -> None:
    """Write the networks of a bundle with 16-bit weights, half as large; needs the extra `train`."""
    check_extra()
    from signsplice_workshop.train.export import halve_bundle

    before, after = halve_bundle(Path(bundle), Path(output))
    print(f"{output}: {before / 1e6:.1f} MB in {after / 1e6:.1f} MB")


def check_extra() -> None:
    """Raises ``MissingExtraError`` if a package of the extra `train` is missing."""
    missing = [name for name in ("torch", "onnxscript", "filelock") if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training needs {missing[0]}: pip install './workshop[train]' in signsplice's folder")


def make_progress_printer(part: str) -> ProgressCallback:
    """Returns a callback that prints a part's progress to standard error: in a terminal one line that is overwritten,
    and each validation's scores; elsewhere the scores alone.
    """
    is_terminal = sys.stderr.isatty()

    def report(step: int, steps: int, numbers: dict[str, float]) -> None:
        if not numbers:
            print(f"{part} {step}/{steps}: continues from the checkpoint of an earlier call", file=sys.stderr)
            return
        is_validation = "loss" not in numbers
        if not is_terminal and not is_validation:
            return
        remaining = "" if is_validation else f", {numbers['seconds_a_step'] * (steps - step) / 60.0:.1f} min left"
        values = " ".join(f"{name} {value:.4g}" for name, value in numbers.items() if name != "seconds_a_step")
        end = "\n" if is_validation or not is_terminal else "\r"
        print(f"{part} {step}/{steps}: {values}{remaining}", end=end, file=sys.stderr)

    return report
