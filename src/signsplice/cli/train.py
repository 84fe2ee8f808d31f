"""The commands `train paper`, `train cutter`, `train transition`, `train traits` and `export`."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice.cli.clips import load, reads_clips
from signsplice.cli.terminal import warn
from signsplice.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from signsplice.train.loop import ProgressCallback

Command = TypeVar("Command", bound=Callable[..., Any])


@click.group()
def train() -> None:
    """Train networks; needs the extra `train`."""


@train.command()
@click.option("--pairs", required=True, metavar="DIR", help="Corpus of pairs, of `pairs build` or `synth pairs`.")
@click.option("--system", required=True, metavar="NAME|all", help="lpt, lpt-wa, ..., or all: a folder in --out each.")
@click.option("--scale", type=click.Choice(("smoke", "cpu", "paper")), default="cpu", show_default=True,
              help="How large the networks are and how long they are trained.")  # fmt: skip
@click.option("--optimiser", type=click.Choice(("adamw", "sgd")), default="adamw", show_default=True,
              help="sgd: as in the paper, rate 1e-3.")  # fmt: skip
@click.option("--split", type=click.Choice(("random", "unseen-words", "unseen-signer")), default="random",
              show_default=True, help="Which pairs are trained on.")  # fmt: skip
@click.option("--out", required=True, metavar="DIR", help="Folder for the bundle.")
@click.option(
    "--parts", metavar="DIR", help="Checkpoints, shared by systems of the same parts.  [default: beside --out]"
)
@click.option("--steps", type=int, metavar="N", help="Steps of every part, in place of the scale's.")
@click.option("--fr", type=int, metavar="N", help="Frames that Culling keeps on each side.  [default: 8]")
@click.option("--seed", type=int, default=0, show_default=True, metavar="N", help="Of weights, batches and noise.")
@click.option("--device", default="auto", show_default=True, metavar="NAME", help="auto, cpu or cuda.")
@click.option("--bf16/--no-bf16", default=None, help="Half precision; by default on GPUs alone.")
@click.option("--minutes", type=float, metavar="M", help="Stop after M minutes; the same command continues.")
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
    minutes: float | None,
) -> None:
    """Train a system of the paper and export it. The same command continues after an interruption.

    Several processes can divide the work: torchrun --nproc-per-node 2 -m signsplice train paper ...
    """
    check_extra()
    from signsplice.synth.corpus import Pairs
    from signsplice.train import processes
    from signsplice.train.stopping import DeadlineError
    from signsplice_paper.train import scales, training

    systems = list(scales.SYSTEMS) if system == "all" else [system]
    with processes.joined(device) as process:
        deadline = deadline_in(minutes)
        corpus = Pairs(pairs)
        if system == "all" and fr is not None:
            raise InputError(f"--fr {fr} with --system all; name one system with a Culling layer")
        for name in systems:
            scales.parts(name, scale, fr, steps, optimiser, split)
        for name in systems:
            folder = Path(out) / name if system == "all" else Path(out)
            shared = Path(parts) if parts is not None else Path(out).parent / "parts"
            config = training.Training(name, scale, optimiser, split, seed, fr, steps, bf16, deadline=deadline)
            try:
                training.make(config, corpus, folder, shared, process, progress_printer if process.first else None)
            except DeadlineError as error:
                if process.first:
                    warn([f"{folder}: {error}"])
                return
            if process.first:
                print(f"{folder}: {name}, scale {scale}, {optimiser}, {split}")


def deadline_in(minutes: float | None) -> float | None:
    """The value of ``time.monotonic`` in so many minutes. Raises ``InputError`` for a negative number."""
    if minutes is None:
        return None
    if not minutes >= 0.0:
        raise InputError(f"--minutes {minutes:g}, expected at least 0")
    return time.monotonic() + 60.0 * minutes


def _product_options(command: Command) -> Command:
    """Add the options that `train cutter` and `train transition` share."""
    for option in reversed(
        (
            click.option("--out", required=True, metavar="DIR", help="Bundle that the network is written into."),
            click.option("--scale", type=click.Choice(("smoke", "small", "ship", "more", "corpus")), default="ship",
                         show_default=True, help="How large the network is and how long it is trained."),
            click.option("--steps", type=int, metavar="N", help="Steps in place of the scale's."),
            click.option("--batch", type=click.IntRange(min=1), metavar="N",
                         help="Draws in a batch in place of the scale's; several processes divide them."),
            click.option("--seed", type=int, default=0, show_default=True, metavar="N", help="Of weights and pairs."),
            click.option("--device", default="auto", show_default=True, metavar="NAME", help="auto, cpu or cuda."),
        )
    ):  # fmt: skip
        command = option(command)
    return command


def _train_product(
    network: str,
    signing: Sequence[str],
    out: str,
    scale: str,
    steps: int | None,
    batch: int | None,
    seed: int,
    device: str,
    earlier: Sequence[str] = (),
) -> None:
    _check_steps(steps, least=0 if earlier else 1)
    check_extra()
    from signsplice.train import processes, training

    with processes.joined(device) as process:
        config = training.ProductTraining(network, scale, seed, steps, batch=batch)
        data, starts = ([Path(folder) for folder in folders] for folders in (signing, earlier))
        progress = progress_printer(network) if process.first else None
        training.make(config, data, Path(out), process, progress, starts)
        if process.first:
            print(f"{out}: {network}, scale {scale}, {config.n_steps} steps")


def _check_steps(steps: int | None, least: int = 1) -> None:
    if steps is not None and steps < least:
        raise InputError(f"--steps {steps}, expected at least {least}")


_SIGNING = "Signing to train on, of `signsplice synth endless`; several folders are used equally often."


@train.command()
@click.option("--signing", required=True, multiple=True, metavar="DIR", help=_SIGNING)
@click.option("--from", "earlier", multiple=True, metavar="DIR",
              help="Folder of an earlier training, or a bundle, to start from; of several the mean.")  # fmt: skip
@_product_options
def cutter(signing: tuple[str, ...], earlier: tuple[str, ...], **options: Any) -> None:
    """Train the network that finds where to leave and enter words, and how long the transition takes. The same command
    continues after an interruption.

    Several processes can divide the work: torchrun --nproc-per-node 2 -m signsplice train cutter ...
    """
    _train_product("cutter", signing, earlier=earlier, **options)


@train.command()
@click.option("--signing", multiple=True, metavar="DIR", help=_SIGNING)
@click.option("--lexicon", metavar="DIR", help="Lexicon to tune a trained network to, of `signsplice lexicon build`.")
@click.option("--from", "earlier", multiple=True, metavar="DIR", help="With --lexicon the bundle to tune [default: "
              "what ships]; with --signing a bundle or an earlier training's folder; of several the mean.")  # fmt: skip
@_product_options
def transition(
    signing: tuple[str, ...],
    lexicon: str | None,
    earlier: tuple[str, ...],
    out: str,
    scale: str,
    steps: int | None,
    batch: int | None,
    seed: int,
    device: str,
) -> None:
    """Train the network that makes the transition's frames, or tune it to your own lexicon, and keep it if it is better
    there. The same command continues after an interruption.

    With --signing, several processes can divide the work: torchrun --nproc-per-node 2 -m signsplice train transition
    --signing ...
    """
    if bool(signing) == (lexicon is not None):
        raise InputError("expected either --signing DIR, to train, or --lexicon DIR, to tune")
    if signing:
        _train_product("transition", signing, out, scale, steps, batch, seed, device, earlier)
        return
    if len(earlier) > 1:
        raise InputError(f"--lexicon tunes one network: expected one --from, not {len(earlier)}")
    if batch is not None:
        raise InputError("--batch is for --signing; tuning has a batch of its own")
    _check_steps(steps)
    check_extra()
    from signsplice.splicing.methods.choice import WEIGHTS
    from signsplice.train import processes, tuning

    source = Path(earlier[0]) if earlier else WEIGHTS
    with processes.joined(device) as process:
        config = tuning.Tuning(seed=seed) if steps is None else tuning.Tuning(steps=steps, seed=seed)
        progress = progress_printer("transition") if process.first else None
        result = tuning.make(config, Path(str(lexicon)), source, Path(out), process, progress)
    errors = f"{result.after:.1f} tuned, {result.before:.1f} before, {result.classical:.1f} classical"
    print(f"trained on {result.n_train} words; error on {result.n_held} held back, arm length / 1000: {errors}")
    print(f"{out}: written" if result.better else f"{out}: not written, because the tuned network is no better")


@train.command()
@click.argument("clip", metavar="CLIP")
@click.option("--frames", required=True, metavar="A:B", help="Frames A..B-1 of the clip are used, no others.")
@click.option(
    "-o", "--output", required=True, metavar="OUT.json", help="File of the results; the table goes to OUT.md."
)
@click.option("--same-as", metavar="FILE.json", help="Measure the networks of these results, for a last look.")
@click.option("--work", default="out/traits", show_default=True, metavar="DIR", help="Folder for signing and networks.")
@click.option("--scale", type=click.Choice(("smoke", "small")), default="small", show_default=True,
              help="How much signing, how large the networks are and how long they are trained.")  # fmt: skip
@click.option("--processes", type=int, default=2, show_default=True, metavar="N", help="Networks trained at once.")
@reads_clips
def traits(clip: str, frames: str, output: str, same_as: str | None, work: str, scale: str, processes: int) -> None:
    """Train small transition networks on signing with each trait of the signer's manner alone, and measure them on
    frames hidden from a captured clip. The same command continues after an interruption.
    """
    check_extra()
    if processes < 1:
        raise InputError(f"--processes {processes}, expected at least 1")
    if Path(output).suffix != ".json":
        raise InputError(f"-o {output}, expected a name that ends in .json")
    from signsplice.motion.clip import resample
    from signsplice.rig.canonical import FEATURE_FPS
    from signsplice.train import trait_ablation

    loaded = load(clip)
    first, end = _frames(frames, len(loaded))
    seen = resample(loaded[first:end], FEATURE_FPS)
    ablation = trait_ablation.Ablation(Path(clip).name, seen, (first, end), Path(work), scale)
    earlier = None if same_as is None else Path(same_as)
    rows = trait_ablation.run(ablation, Path(output), processes, lambda line: print(line, file=sys.stderr), earlier)
    trait_ablation.write_page(Path(output).with_suffix(".md"), ablation, rows)
    print(f"{output}, {Path(output).with_suffix('.md')}: {len(rows)} networks")


def _frames(text: str, n_frames: int) -> tuple[int, int]:
    """The first frame and the end of A:B."""
    first, colon, end = text.partition(":")
    if not (colon and first.isdecimal() and end.isdecimal() and int(first) < int(end) <= n_frames):
        raise InputError(f"--frames {text!r}, expected A:B with A < B <= {n_frames}, B not included")
    return int(first), int(end)


@click.command()
@click.argument("bundle", metavar="BUNDLE")
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for the bundle to write.")
@click.option("--int8", is_flag=True, required=True, help="With 8-bit weights: smaller, and less exact.")
def export(bundle: str, output: str, int8: bool) -> None:
    """Write the networks of a bundle with 8-bit weights; needs the extra `train`. `signsplice evaluate` measures the
    loss of accuracy.
    """
    check_extra()
    from signsplice.train import quantization

    before, after = quantization.quantize_bundle(Path(bundle), Path(output))
    print(f"{output}: {before / 1e6:.1f} MB in {after / 1e6:.1f} MB")


@click.command()
@click.argument("bundles", nargs=-1, required=True, metavar="BUNDLE ...")
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder of the published bundles, and their page.")
@click.option("--pairs", required=True, metavar="DIR", help="Corpus of pairs that they learned from.")
@click.option("--limit", type=int, default=200, show_default=True, metavar="N",
              help="Test pairs on which both forms are compared.")  # fmt: skip
def publish(bundles: tuple[str, ...], output: str, pairs: str, limit: int) -> None:
    """Write trained systems of the paper with 16-bit weights, each into a folder of its name, and a page that lists
    them; needs the extra `train`. The page tells how far they choose as before.
    """
    if limit < 1:
        raise InputError(f"--limit {limit}, expected at least 1")
    check_extra()
    from signsplice.synth.corpus import Pairs
    from signsplice_paper.train import publishing

    for line in publishing.publish([Path(name) for name in bundles], Path(output), Pairs(pairs), limit):
        print(line)


def check_extra() -> None:
    """Raise ``MissingExtraError`` if a package of the extra `train` is missing."""
    missing = [name for name in ("torch", "onnxscript", "filelock") if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training needs {missing[0]}: pip install 'signsplice[train]'")


def progress_printer(part: str) -> ProgressCallback:
    """A callback that prints a part's progress to standard error: in a terminal one line that is overwritten, and each
    validation's scores; elsewhere the scores alone.
    """
    terminal = sys.stderr.isatty()

    def report(step: int, steps: int, numbers: dict[str, float]) -> None:
        scores = "loss" not in numbers
        if not terminal and not scores:
            return
        left = "" if scores else f", {numbers['seconds_a_step'] * (steps - step) / 60.0:.1f} min left"
        values = " ".join(f"{name} {value:.4g}" for name, value in numbers.items() if name != "seconds_a_step")
        print(f"{part} {step}/{steps}: {values}{left}", end="\n" if scores or not terminal else "\r", file=sys.stderr)

    return report


COMMANDS = (train, export, publish)
