"""frames.npz: the transition frames that every system made for a few pairs, for figures 6 and 7, and how their numbers
are drawn.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.motion import FloatArray
from signsplice.signer.signer import stream
from signsplice_paper.protocol import Answer, Protocol
from signsplice_paper.stick_figure import StickFigure, read_stick_figure, stick_figure, synthetic
from signsplice_workshop.corpora.pairs import Pairs

FILE = "frames.npz"
COUNT = 3
"""Number of pairs."""
SHORTEST = 6
"""Fewest frames of a transition that is shown."""

HERMITE, PRODUCT = ("true-positions+hermite", "positions and length"), ("learned-fluent+learned", "nothing")
SHOWN_METHODS = (HERMITE, PRODUCT)
"""Methods on clips that are shown next to the systems: name, and what they are given."""


@dataclass(frozen=True, eq=False)
class KeptFrames:
    """One pair and the transitions made for it.

    - number: the pair's number in the corpus
    - name: the glosses of both words
    - before: the frame before the transition (1, 159)
    - after: the frame after the transition (1, 159)
    - truth: the true transition (n, 159)
    - made: transitions (m, 159) by the ``label`` of the row that made them
    - edges: the frames (2, 159) between which each was made, at the positions that its system found, by ``label``
    - figure: how the numbers are drawn
    """

    number: int
    name: str
    before: FloatArray
    after: FloatArray
    truth: FloatArray
    made: Mapping[str, FloatArray] = field(default_factory=dict)
    edges: Mapping[str, FloatArray] = field(default_factory=dict)
    figure: StickFigure = field(default_factory=synthetic)


def label(system: str, scale: str, optimiser: str, given: str = "nothing") -> str:
    """The name of a row's frames in ``made``."""
    return "/".join((scale, optimiser, system, given))


def choose(pairs: Pairs, protocol: Protocol, count: int = COUNT) -> list[KeptFrames]:
    """A fixed choice of judged pairs with a transition long enough to be shown, without frames made for them."""
    long = [k for k in protocol.numbers if pairs.index[k, 5] >= SHORTEST] or list(protocol.numbers)
    order = stream("paper-shots", len(long)).permutation(len(long))[:count]
    return [_make_kept_frames(pairs, long[k]) for k in order.tolist()]


def _make_kept_frames(pairs: Pairs, number: int) -> KeptFrames:
    p, q = pairs.index[number, :2].tolist()
    pre, post, truth = pairs.truth(number)
    words = pairs.head["words"]
    name = f"{words[p]['gloss']} > {words[q]['gloss']}"
    before, after = pairs.word(p)[pre : pre + 1], pairs.word(q)[post : post + 1]
    return KeptFrames(number, name, before, after, truth, figure=_figure(pairs, p))


def _figure(pairs: Pairs, word: int) -> StickFigure:
    """How the numbers of a corpus are drawn."""
    clip, space = pairs.word_clip(word), pairs.space(word)
    return stick_figure(clip, space.indices(clip.skeleton, clip.name), space.parents)


def with_answers(kept: Sequence[KeptFrames], name: str, answer: Answer, pairs: Pairs) -> list[KeptFrames]:
    """The pairs with the frames that ``answer`` makes for them, under ``name``."""
    out = []
    for pair in kept:
        found = answer(pair.number)
        edges = dict(pair.edges)
        if found.pre is not None and found.post is not None:
            p, q = pairs.index[pair.number, :2].tolist()
            edges[name] = np.stack([pairs.word(p)[found.pre], pairs.word(q)[found.post]])
        out.append(replace(pair, made={**pair.made, name: found.frames.astype(np.float32)}, edges=edges))
    return out


def merge(known: Sequence[KeptFrames], chosen: Sequence[KeptFrames]) -> list[KeptFrames]:
    """The chosen pairs, with the frames that ``known`` holds for the same pair and truth."""
    by_number = {pair.number: pair for pair in known}
    out = []
    for pair in chosen:
        old = by_number.get(pair.number)
        same = old is not None and old.name == pair.name and np.array_equal(old.truth, pair.truth)
        if same and old is not None:
            pair = replace(pair, made={**old.made, **pair.made}, edges={**old.edges, **pair.edges})
        out.append(pair)
    return out


def save(kept: Sequence[KeptFrames], path: Path) -> None:
    """Write the pairs and their frames atomically."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for pair in kept:
        parts = {"before": pair.before, "after": pair.after, "truth": pair.truth, "name": np.array(pair.name)}
        arrays |= {f"{pair.number}|{part}": np.asarray(value) for part, value in parts.items()}
        arrays[f"{pair.number}|figure"] = np.array(pair.figure.as_json())
        arrays |= {f"{pair.number}|made|{name}": np.asarray(frames, np.float32) for name, frames in pair.made.items()}
        arrays |= {f"{pair.number}|edges|{name}": np.asarray(ends, np.float32) for name, ends in pair.edges.items()}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def load(path: Path) -> list[KeptFrames]:
    """The pairs and frames in a file, none if there is no file. Raises ``InputError`` for a file of another kind."""
    if not path.exists():
        return []
    try:
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        numbers = list(dict.fromkeys(int(name.split("|")[0]) for name in arrays))
        return [_pair_from_arrays(arrays, number) for number in numbers]
    except (OSError, TypeError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: holds no frames of this project ({error}); remove it and judge again") from error


def _pair_from_arrays(arrays: Mapping[str, NDArray[np.generic]], number: int) -> KeptFrames:
    before, after, truth = (arrays[f"{number}|{part}"].astype(np.float64) for part in ("before", "after", "truth"))
    by_label = {}
    for part in ("made", "edges"):
        start = f"{number}|{part}|"
        by_label[part] = {
            name[len(start) :]: x.astype(np.float64) for name, x in arrays.items() if name.startswith(start)
        }
    stored = arrays.get(f"{number}|figure")
    figure = synthetic() if stored is None else read_stick_figure(str(stored))
    return KeptFrames(number, str(arrays[f"{number}|name"]), before, after, truth, **by_label, figure=figure)
