"""Writes the training and validation parts of a split of a corpus of pairs as ``training_data``.

The product's networks can then learn from exactly what the paper's systems learn from: the words, true cut frames and
transitions of the training part, with the validation part to evaluate on. Words that are in neither are left out.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion.clip import concatenate, same_fps
from signsplice.rig.canonical import FEATURE_FPS, canonical_bones
from signsplice.synth.corpus import Pairs
from signsplice.synth.training_data import event_frames, packed, save

Array = NDArray[Any]

PARTS = ("train", "valid")
AROUND = 24
"""Frames of either word that a sentence keeps around its seam: three times a network's input."""
_NO_TRUTH = (-1, -1, -1)


def write(pairs: Pairs, split: str, folder: Path) -> list[Path]:
    """Write the training and the validation part of a split, each with ``corpus`` (hash) and ``split``; return both
    paths.

    Raises ``InputError`` for a corpus of clips whose events are not known, an unknown split, a part of fewer than two
    words, a corpus at another frame rate than the networks', or a folder that cannot be written.
    """
    pairs.check_synthetic()
    if not same_fps(pairs.head["fps"], FEATURE_FPS):
        raise InputError(
            f"{pairs.folder}: {pairs.head['fps']:g} frames a second, expected {FEATURE_FPS:g}, the networks' rate"
        )
    chosen = [pairs.split(split, name) for name in PARTS]
    for name, numbers in zip(PARTS, chosen, strict=True):
        if len(set(pairs.index[numbers, :2].ravel().tolist())) < 2:
            raise InputError(
                f"{pairs.folder}: the {name} part of split {split} has fewer than two words; make a larger corpus"
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    paths = [folder / f"signer-corpus-{pairs.head['hash']}-{split}-{name}.npz" for name in PARTS]
    for path, numbers in zip(paths, chosen, strict=True):
        save(path, {**part(pairs, numbers), "corpus": np.array(pairs.head["hash"]), "split": np.array(split)})
    return paths


def part(pairs: Pairs, numbers: list[int]) -> dict[str, Array]:
    """Pairs of one signer as arrays like those of ``training_data.part``: their words, and for each pair a sentence,
    cut ``AROUND`` frames around its seam. Other pairs of these words have no ground truth (-1).
    """
    index = pairs.index[numbers]
    words = sorted(set(index[:, :2].ravel().tolist()))
    order = {word: k for k, word in enumerate(words)}
    truth = np.tile(_NO_TRUTH, (len(words), len(words), 1))
    clips = {word: pairs.word_clip(word) for word in words}
    frames = [packed(clips[word]) for word in words]
    lengths = [len(clips[word]) for word in words]
    at = sum(lengths)
    sentences: list[tuple[int, int]] = []
    seams: list[tuple[int, int, int]] = []
    for number, (p, q, pre, post, _, count) in zip(numbers, index.tolist(), strict=True):
        truth[order[p], order[q]] = pre, post, count
        before, after = clips[p][max(0, pre + 1 - AROUND) : pre + 1], clips[q][post : post + AROUND]
        sentence = concatenate([before, pairs.transition_clip(number), after])
        frames.append(packed(sentence))
        seams.append((len(sentences), len(before), count))
        sentences.append((at, len(sentence)))
        at += len(sentence)
    quats, positions = (np.concatenate([f[k] for f in frames]) for k in range(2))
    return {
        "bones": canonical_bones(pairs.skeletons[pairs.signer(words[0])]),
        "turns": quats,
        "places": positions,
        "words": np.stack([np.cumsum([0, *lengths[:-1]]), lengths], axis=1),
        "events": np.array([event_frames(pairs.events(word)) for word in words]),
        "pairs": truth,
        "sentences": np.array(sentences),
        "seams": np.array(seams),
    }
