"""How the accuracy of positions in unseen words and signers grows with the words and bodies that are taught.

    python -m signsplice_paper.train.growth JUDGED TAUGHT OUT.csv [--cell 60x10020] [--system LPT+]

Trains LpTransformer's SPSN (equal treatment) and LPT+'s, word by word, for each cell of words and bodies that OUT
lacks, and scores them on the four tests of the judged corpus. A cell that was interrupted is trained again.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from signsplice.signer.signer import stream
from signsplice_paper import published
from signsplice_paper.figures import import_pyplot
from signsplice_paper.style import make_plot_options
from signsplice_paper.train.losses import token_loss
from signsplice_paper.train.networks.word_spsn import WordSpsn, position_loss
from signsplice_paper.train.scales import SystemPart, make_network, make_parts
from signsplice_paper.train.tasks import find_positions
from signsplice_paper.train.training import fit_to_skeleton
from signsplice_paper.train.words_data import WordsData, load_card_words
from signsplice_workshop.corpora.pairs import Pairs

KNOWN = 100
CELLS = ((1, KNOWN), (20, 1000), (60, 1020), (60, 10020))
"""Numbers of bodies and words. The first cell has the known words of the judged corpus; the others have pseudo-signs,
different ones for each body."""
WARM_UP, WEIGHT_DECAY = 0.05, 1e-2
SYSTEMS = {"LPT+": published.LPT_PLUS, "LpTransformer": published.LPTRANSFORMER}
"""Systems by name, whose networks for positions are trained with the sizes, steps and rates of scale cpu."""
COLUMNS = ("corpus", "taught", "system", "bodies", "words", "steps", "minutes", "test", "pairs")
SCORES = ("pre", "post", "exact", "within one")


def load_cell_words(judged: Pairs, taught: Pairs, bodies: int, words: int) -> WordsData:
    """Returns the words of a cell."""
    if words == KNOWN:
        held_back = [k for part in ("valid", "test") for k in judged.split("random", part)]
        known_words = [k for k, row in enumerate(judged.head["words"]) if judged.signer(k) == 0 and row["known"]]
        return load_card_words(
            judged, [known_words], frozenset((p, q) for p, q in judged.index[held_back, :2].tolist())
        )
    by_signer: list[list[int]] = [[] for _ in taught.signers]
    for word in range(len(taught.head["words"])):
        by_signer[taught.signer(word)].append(word)
    return load_card_words(taught, [row[: words // bodies] for row in by_signer[:bodies]])


def draw_pair_batch(data: WordsData, step: int, size: int, seed: int) -> tuple[Tensor, ...]:
    """Returns x, n_before, mask, pre and post of ``size`` random pairs, as SPSN reads them."""
    xs: list[Tensor] = []
    n_frames_before: list[int] = []
    cuts: list[tuple[int, int]] = []
    rng = stream("pairs", seed, step)
    while len(xs) < size:
        p, q = data.rows(int(rng.integers(2**40)), 2, seed).tolist()
        cut = data.pair_cut(p, q)
        if cut is not None:
            xs.append(torch.cat([data.words[p], data.words[q]]))
            n_frames_before.append(len(data.words[p]))
            cuts.append(cut)
    pre, post = torch.tensor(cuts).unbind(-1)
    n_before = torch.tensor(n_frames_before)
    mask = pad_sequence([torch.ones(len(x), dtype=torch.bool) for x in xs], batch_first=True)
    return pad_sequence(xs, batch_first=True), n_before, mask, pre, post + n_before


def train(network: nn.Module, compute_loss: Callable[[int], Tensor], steps: int, highest_rate: float) -> float:
    """Trains by AdamW with a rate that warms up, then falls along half a cosine. Returns processor minutes."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=highest_rate, weight_decay=WEIGHT_DECAY)
    start = time.process_time()
    network.train()
    for step in range(steps):
        fraction = step / steps
        rate = highest_rate * min(1.0, (fraction + 1e-3) / WARM_UP) * 0.5 * (1.0 + math.cos(math.pi * fraction))
        for group in optimiser.param_groups:
            group["lr"] = rate
        loss = compute_loss(step)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        if step % 500 == 499:
            print(
                f"  step {step + 1}: loss {loss.item():.3f}, {(time.process_time() - start) / 60:.1f} min", flush=True
            )
    return (time.process_time() - start) / 60.0


@torch.no_grad()
def predict_positions(network: nn.Module, pairs: Pairs, numbers: list[int]) -> np.ndarray:
    """Returns pre and post (P, 2) of pairs, each a frame of its word."""
    network.eval()
    rows = []
    for chunk in (numbers[k : k + 64] for k in range(0, len(numbers), 64)):
        index = pairs.index[chunk, :2].tolist()
        words = {
            word: torch.from_numpy(np.array(pairs.word(word), np.float32))
            for word in {word for row in index for word in row}
        }
        xs = [torch.cat([words[p], words[q]]) for p, q in index]
        mask = pad_sequence([torch.ones(len(x), dtype=torch.bool) for x in xs], batch_first=True)
        n_before = torch.tensor([len(words[p]) for p, _ in index])
        frames, _ = find_positions(network(pad_sequence(xs, batch_first=True), n_before, mask), mask)
        rows.append(frames - torch.stack([torch.zeros_like(n_before), n_before], dim=1))
    return torch.cat(rows).numpy()


def make_network_and_loss(
    part: SystemPart, data: WordsData, seed: int = 0
) -> tuple[nn.Module, Callable[[int], Tensor]]:
    """Returns an untrained network for positions, and the function that computes its loss at a step."""
    torch.manual_seed(seed)
    network = make_network(part.config, data.normaliser())
    if isinstance(network, WordSpsn):
        network.fit_measures(data.words)

    def compute_loss(step: int) -> Tensor:
        if isinstance(network, WordSpsn):
            batch = data.batch(data.rows(step, part.batch, seed))
            return position_loss(network.pair_scores(batch.x, batch.mask), batch.cuts, batch.taught)
        x, n_before, mask, pre, post = draw_pair_batch(data, step, part.batch, seed)
        return token_loss(network(x, n_before, mask), pre, post, mask)

    return network, compute_loss


TESTS = {
    "random": "the 100 words, first signer",
    "unseen-words": "45 other words, first signer",
    "unseen-signer": "the 100 words, other signers",
    "unseen-both": "other words, other signers",
}


def draw(rows: list[dict[str, str]], path: Path) -> None:
    """Writes the figure as PNG and SVG: solid lines for exact positions, dotted ones for positions within one frame."""
    pyplot = import_pyplot()
    figure, axes = pyplot.subplots(1, len(TESTS), figsize=(13.0, 3.6), sharey=True, layout="constrained")
    cells = dict.fromkeys((row["bodies"], row["words"]) for row in rows)
    ticks = {cell: k for k, cell in enumerate(cells)}
    for axis, (test, title) in zip(axes, TESTS.items(), strict=True):
        for system, system_id in SYSTEMS.items():
            system_rows = [row for row in rows if (row["system"], row["test"]) == (system, test)]
            cell_ticks = [ticks[row["bodies"], row["words"]] for row in system_rows]
            axis.plot(
                cell_ticks, [float(row["exact"]) for row in system_rows], label=system, **make_plot_options(system_id)
            )
            dotted = {**make_plot_options(system_id), "ls": ":", "mfc": "white"}
            axis.plot(
                cell_ticks,
                [float(row["within one"]) for row in system_rows],
                label=f"{system}, within a frame",
                **dotted,
            )
        axis.set(title=title, ylim=(0.0, 1.03))
        axis.set_xticks(list(ticks.values()), [f"{int(words):,}\n{bodies}" for bodies, words in ticks], fontsize=8)
        axis.set_xlabel("words taught, by so many bodies")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("pairs with both positions")
    axes[0].legend(fontsize=7)
    for suffix in (".png", ".svg"):
        figure.savefig(path.with_suffix(suffix), dpi=110)


def main() -> None:
    """Trains and scores the cells that are missing, and draws the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("judged"), parser.add_argument("taught"), parser.add_argument("out", type=Path)
    parser.add_argument("--cell", help="bodies x words, such as 60x10020; all if left out")
    parser.add_argument("--system", help="LPT+ or LpTransformer; both if left out")
    parser.add_argument("--steps", type=int, help="in place of those of scale cpu")
    args = parser.parse_args()
    torch.set_num_threads(1)
    judged, taught = Pairs(args.judged), Pairs(args.taught)
    for bodies, words in CELLS:
        if args.cell not in (None, f"{bodies}x{words}"):
            continue
        rows = list(csv.DictReader(args.out.open(encoding="utf-8"))) if args.out.exists() else []
        training_corpus = judged if words == KNOWN else taught
        corpora = (judged.head["hash"], training_corpus.head["hash"])
        if any(row["corpus"] != corpora[0] for row in rows):
            raise SystemExit(f"{args.out}: has rows of another corpus; name another file")
        done = {(row["taught"], row["system"], row["bodies"], row["words"], row["steps"]) for row in rows}
        data = load_cell_words(judged, taught, bodies, words)
        for name, system in SYSTEMS.items():
            part = fit_to_skeleton(make_parts(system, "cpu", steps=args.steps)[0], judged)
            if (corpora[1], name, str(bodies), str(words), str(part.steps)) in done or args.system not in (None, name):
                continue
            print(f"{name}, {bodies} bodies, {words} words", flush=True)
            network, compute_loss = make_network_and_loss(part, data)
            minutes = train(network, compute_loss, part.steps, part.rate)
            lines = []
            for test in judged.head["splits"]:
                numbers = judged.split(test, "test")
                errors = np.abs(predict_positions(network, judged, numbers) - judged.index[numbers, 2:4])
                scores = ((errors[:, 0] == 0), (errors[:, 1] == 0), (errors == 0).all(1), (errors <= 1).all(1))
                rates = [f"{score.mean():.3f}" for score in scores]
                cell = (*corpora, name, bodies, words, part.steps, f"{minutes:.1f}")
                lines.append((*cell, test, len(numbers), *rates))
                print("  ", *lines[-1][7:], flush=True)
            new = not args.out.exists()
            with args.out.open("a", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(([(*COLUMNS, *SCORES)] if new else []) + lines)
    if args.out.exists():
        order = {(str(bodies), str(words)): k for k, (bodies, words) in enumerate(CELLS)}
        rows = list(csv.DictReader(args.out.open(encoding="utf-8")))
        draw(sorted(rows, key=lambda row: order[row["bodies"], row["words"]]), args.out)


if __name__ == "__main__":
    main()
