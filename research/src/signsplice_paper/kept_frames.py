"""frames.npz: the transition frames of every system for a few pairs, for figures 6 and 7, and how to draw their
numbers.
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
from signsplice_paper.stick_figure import StickFigure, make_stick_figure, make_synthetic_figure, read_stick_figure
from signsplice_workshop.corpora.pairs import Pairs

FILE = "frames.npz"
COUNT = 3
"""Number of pairs."""
SHORTEST = 6
"""Fewest frames of a transition that is shown."""

HERMITE, PRODUCT = ("true-positions+hermite", "positions and length"), ("learned-fluent+learned", "nothing")
SHOWN_METHODS = (HERMITE, PRODUCT)
"""Methods on clips that are shown next to the systems: name, and the truth that they are given."""


@dataclass(frozen=True, eq=False)
class KeptFrames:
    """One pair and the transitions made for it.

    - number: the pair's number in the corpus
    - name: the glosses of both words
    - before: the frame before the transition (1, 159)
    - after: the frame after the transition (1, 159)
    - truth: the true transition (n, 159)
    - made: transitions (m, 159) by the ``make_label`` of the row that made them
    - edges: the frames (2, 159) at both ends of each, at the positions that its system found, by ``make_label``
    - figure: how the numbers are drawn
    """

    number: int
    name: str
    before: FloatArray
    after: FloatArray
    truth: FloatArray
    made: Mapping[str, FloatArray] = field(default_factory=dict)
    edges: Mapping[str, FloatArray] = field(default_factory=dict)
    figure: StickFigure = field(default_factory=make_synthetic_figure)


def make_label(system: str, scale: str, optimiser: str, given: str = "nothing") -> str:
    """Returns the key of a row's frames in ``made`` and ``edges``."""
    return "/".join((scale, optimiser, system, given))


def choose(pairs: Pairs, protocol: Protocol, count: int = COUNT) -> list[KeptFrames]:
    """Returns a fixed choice of judged pairs with transitions long enough to show, without frames made for them."""
    n_transition_frames = pairs.index[:, 5]
    long_enough = [k for k in protocol.pair_numbers if n_transition_frames[k] >= SHORTEST] or list(
        protocol.pair_numbers
    )
    order = stream("paper-shots", len(long_enough)).permutation(len(long_enough))[:count]
    return [_make_kept_frames(pairs, long_enough[k]) for k in order.tolist()]


def _make_kept_frames(pairs: Pairs, number: int) -> KeptFrames:
    p, q = pairs.index[number, :2].tolist()
    pre, post, truth = pairs.truth(number)
    words = pairs.head["words"]
    name = f"{words[p]['gloss']} > {words[q]['gloss']}"
    before, after = pairs.word(p)[pre : pre + 1], pairs.word(q)[post : post + 1]
    return KeptFrames(number, name, before, after, truth, figure=_make_figure(pairs, p))


def _make_figure(pairs: Pairs, word: int) -> StickFigure:
    """Returns how the numbers of a corpus are drawn."""
    clip, space = pairs.word_clip(word), pairs.space(word)
    return make_stick_figure(clip, space.find_joints(clip.skeleton, clip.name), space.parents)


def add_answers(figure_pairs: Sequence[KeptFrames], label: str, answer: Answer, pairs: Pairs) -> list[KeptFrames]:
    """Returns the pairs with the frames that ``answer`` makes for them, under ``label`` (``make_label``)."""
    updated_pairs = []
    for pair in figure_pairs:
        prediction = answer(pair.number)
        edges = dict(pair.edges)
        if prediction.pre is not None and prediction.post is not None:
            p, q = pairs.index[pair.number, :2].tolist()
            edges[label] = np.stack([pairs.word(p)[prediction.pre], pairs.word(q)[prediction.post]])
        updated_pairs.append(
            replace(pair, made={**pair.made, label: prediction.frames.astype(np.float32)}, edges=edges)
        )
    return updated_pairs


def merge(known: Sequence[KeptFrames], chosen: Sequence[KeptFrames]) -> list[KeptFrames]:
    """Returns the chosen pairs, with the frames that ``known`` holds for the same pair and truth."""
    by_number = {pair.number: pair for pair in known}
    merged = []
    for pair in chosen:
        known_pair = by_number.get(pair.number)
        is_same = (
            known_pair is not None and known_pair.name == pair.name and np.array_equal(known_pair.truth, pair.truth)
        )
        if is_same and known_pair is not None:
            pair = replace(pair, made={**known_pair.made, **pair.made}, edges={**known_pair.edges, **pair.edges})
        merged.append(pair)
    return merged


def save(figure_pairs: Sequence[KeptFrames], path: Path) -> None:
    """Writes the pairs and their frames atomically."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for pair in figure_pairs:
        parts = {"before": pair.before, "after": pair.after, "truth": pair.truth, "name": np.array(pair.name)}
        arrays |= {f"{pair.number}|{part}": np.asarray(value) for part, value in parts.items()}
        arrays[f"{pair.number}|figure"] = np.array(pair.figure.as_json())
        arrays |= {f"{pair.number}|made|{name}": np.asarray(frames, np.float32) for name, frames in pair.made.items()}
        arrays |= {f"{pair.number}|edges|{name}": np.asarray(ends, np.float32) for name, ends in pair.edges.items()}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def load(path: Path) -> list[KeptFrames]:
    """Returns the pairs and frames in a file, none without a file. Raises ``InputError`` for a file of another kind."""
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
    figure = make_synthetic_figure() if stored is None else read_stick_figure(str(stored))
    return KeptFrames(number, str(arrays[f"{number}|name"]), before, after, truth, **by_label, figure=figure)
