"""Makes paper_pairs.npz, a corpus of two words in one file, and paper_rows.json, what classical rows score on it.

The splices come from the package; their scores do not: they are computed here by research/tests/reference.py, loop by
loop from the paper's equations. Positions are those of 53 joints, (n, 159), scaled into [-0.5, 0.5];
sigma^2 = lambda^2 / 159 = 0.002.

    python research/tests/golden/make_paper_pairs.py
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import reference  # noqa: E402
from signsplice.signer import notation  # noqa: E402
from signsplice.splicing.cutters import CUTTERS  # noqa: E402
from signsplice_paper.clip_methods import TRUE_POSITIONS, ClipAnswers, ClipMethod  # noqa: E402
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs  # noqa: E402

GLOSSES = ("HELLO", "DEAF")
TRANSITIONS = ("slerp", "hermite")
TOLERANCE = 1e-4
SIGMA, LAMBDA = math.sqrt(0.002), math.sqrt(159 * 0.002)


def main() -> None:
    signs = notation.everyday()
    with tempfile.TemporaryDirectory() as where:
        folder = write_pairs(Recipe(tuple(signs[g] for g in GLOSSES), fps=30.0, n_other=0), Path(where) / "p", None, 1)
        head = json.loads((folder / "corpus.json").read_text())
        numbers = list(range(len(GLOSSES) ** 2))
        head["splits"]["random"] = {"train": [], "valid": [], "test": numbers}
        (folder / "corpus.json").write_text(json.dumps(head))
        arrays = {path.stem: np.load(path) for path in sorted(folder.glob("*.npy"))}
        np.savez_compressed(HERE / "paper_pairs.npz", head=np.array(json.dumps(head)), **arrays)
        pairs = Pairs(folder)
        rows = [score(pairs, method, numbers) for method in methods()]
    (HERE / "paper_rows.json").write_text(json.dumps(rows, indent=1) + "\n")


def methods() -> list[ClipMethod]:
    """Every classical cutter with both transitions, without and with the true length; then the true positions."""
    rows = [(c, t, given) for given in ("nothing", "length") for c in CUTTERS for t in TRANSITIONS]
    rows += [(TRUE_POSITIONS, t, given) for given in ("positions", "positions and length") for t in TRANSITIONS]
    return [ClipMethod(*row) for row in rows]


def score(pairs: Pairs, method: ClipMethod, numbers: list[int]) -> dict[str, object]:
    answer = ClipAnswers(pairs, method)
    made = [answer(k) for k in numbers]
    true = [pairs.truth(k) for k in numbers]
    both = [(p.frames, t[2].astype(np.float64)) for p, t in zip(made, true, strict=True)]
    exact = [(p.pre, p.post) == t[:2] for p, t in zip(made, true, strict=True)]
    return {
        "system": method.name,
        "told": method.given,
        "accuracy": float(np.mean([reference.accuracy(p, t, SIGMA) for p, t in both])),
        "mse": float(np.mean([reference.squared_error(p, t, LAMBDA) for p, t in both])),
        **{f"bleu-{n}": reference.bleu(both, n, TOLERANCE) for n in range(1, 5)},
        "pta": 1.0,
        "paa": sum(exact) / len(exact),
    }


if __name__ == "__main__":
    main()
