"""A few pairs' transition frames as every system made them, kept beside results.json for figures 6 and 7."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.paper.protocol import Answer, Protocol
from signsplice.synth.corpus import Pairs
from signsplice.synth.rng import stream

Float = NDArray[np.float64]

COUNT = 3
SHORTEST = 6
"""Frames that a transition shown has at least."""

HERMITE, SIGNSPLICE = ("true-positions+hermite", "positions and length"), ("learned-fluent+learned", "nothing")
SHOWN_METHODS = (HERMITE, SIGNSPLICE)
"""Methods on clips that are shown beside the systems, and what they are told."""


@dataclass(frozen=True, eq=False)
class KeptFrames:
    """A pair: its words' names, the frame before the transition and the one after (1, 159), the true frames between,
    and the frames that each system made, by a name that tells scale and optimiser too.
    """

    number: int
    name: str
    before: Float
    after: Float
    truth: Float
    made: Mapping[str, Float] = field(default_factory=dict)


def label(system: str, scale: str, optimiser: str, told: str = "nothing") -> str:
    """The name of a row's frames in a shot."""
    return "/".join((scale, optimiser, system, told))


def choose(pairs: Pairs, protocol: Protocol, count: int = COUNT) -> list[KeptFrames]:
    """Pairs for the pictures, drawn once and for all from those judged whose transition is long enough to be seen."""
    long = [k for k in protocol.numbers if pairs.index[k, 5] >= SHORTEST] or list(protocol.numbers)
    drawn = stream("paper-shots", len(long)).permutation(len(long))[:count]
    return [_shot(pairs, long[k]) for k in drawn.tolist()]


def _shot(pairs: Pairs, number: int) -> KeptFrames:
    p, q = pairs.index[number, :2].tolist()
    pre, post, truth = pairs.truth(number)
    words = pairs.head["words"]
    name = f"{words[p]['gloss']} > {words[q]['gloss']}"
    return KeptFrames(number, name, pairs.word(p)[pre : pre + 1], pairs.word(q)[post : post + 1], truth)


def shown(shots: Sequence[KeptFrames], name: str, answer: Answer) -> list[KeptFrames]:
    """The shots with what a row answers for them."""
    return [replace(shot, made={**shot.made, name: answer(shot.number).frames.astype(np.float32)}) for shot in shots]


def merge(known: Sequence[KeptFrames], chosen: Sequence[KeptFrames]) -> list[KeptFrames]:
    """The chosen shots, with what earlier ones of the same truth have."""
    before = {shot.number: shot for shot in known}
    out = []
    for shot in chosen:
        old = before.get(shot.number)
        same = old is not None and old.name == shot.name and np.array_equal(old.truth, shot.truth)
        out.append(replace(shot, made={**old.made, **shot.made}) if same and old is not None else shot)
    return out


def save(shots: Sequence[KeptFrames], path: Path) -> None:
    """Write shots whole or not at all."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for shot in shots:
        parts = {"before": shot.before, "after": shot.after, "truth": shot.truth, "name": np.array(shot.name)}
        arrays |= {f"{shot.number}|{part}": np.asarray(value) for part, value in parts.items()}
        arrays |= {f"{shot.number}|made|{name}": np.asarray(frames, np.float32) for name, frames in shot.made.items()}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def load(path: Path) -> list[KeptFrames]:
    """Shots from a file; none where there is no file. Raises ``InputError`` for a file that is something else."""
    if not path.exists():
        return []
    try:
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        numbers = list(dict.fromkeys(int(name.split("|")[0]) for name in arrays))
        return [_read(arrays, number) for number in numbers]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: holds no frames of this project ({error}); remove it and judge anew") from error


def _read(arrays: Mapping[str, NDArray[np.generic]], number: int) -> KeptFrames:
    before, after, truth = (arrays[f"{number}|{part}"].astype(np.float64) for part in ("before", "after", "truth"))
    start = f"{number}|made|"
    made = {name[len(start) :]: x.astype(np.float64) for name, x in arrays.items() if name.startswith(start)}
    return KeptFrames(number, str(arrays[f"{number}|name"]), before, after, truth, made)
