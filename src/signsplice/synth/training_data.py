"""Signing without end: any number of signers with words of their own and sentences of them, for training.

Every signer is a part, one .npz file, made from its seed alone: isolated pseudo-signs with their events, and sentences
of them with the truth of every seam. All of it is kept as numbers of the canonical humanoid (``motion.canonical``),
which are what networks see; no sign that ships and neither signer of the corpus of pairs is among them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.motion.clip import Clip
from signsplice.rig.canonical import canonical_bones, canonical_motion
from signsplice.synth import planner, pseudo, running, truth
from signsplice.synth.planner import Events, IsolatedWord
from signsplice.synth.pool import Pool
from signsplice.synth.rng import stream
from signsplice.synth.signer import HANGING, RESTS, Signer, signer

Array = NDArray[Any]
Progress = Callable[[int, int], None]

VERSION = 6
FIRST_SIGNER = 1000
"""Seed of the first signer: those of any corpus of pairs lie below."""
_SHORTEST, _LONGEST = 3, 12
_NO_MOVEMENT = (-1, -1)
_NEAR = 3.0
"""Spread, in frames, of the frames near a true cut for which a time is told too."""


@dataclass(frozen=True)
class TrainingDataPlan:
    """How much: signers, words each, seams each, and from which seed on."""

    n_signers: int = 40
    n_words: int = 100
    n_seams: int = 300
    seed: int = 0
    fps: float = 30.0


def write(plan: TrainingDataPlan, folder: Path, progress: Progress | None = None, processes: int = 2) -> int:
    """Make the parts that are not there yet; how many there are then.

    Raises ``InputError`` where a number is out of range or the folder cannot be written.
    """
    if plan.n_signers < 1 or plan.n_words < 2 or plan.n_seams < 0:
        raise InputError(f"{plan}: expected at least 1 signer, 2 words and 0 seams")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    jobs = [(plan, number, path_of(folder, plan, number)) for number in range(plan.n_signers)]
    todo = [job for job in jobs if not job[2].exists()]
    with Pool(processes) as run:
        for done, _ in enumerate(run(_write_part, todo), len(jobs) - len(todo) + 1):
            if progress is not None:
                progress(done, len(jobs))
    return len(jobs)


def path_of(folder: Path, plan: TrainingDataPlan, number: int) -> Path:
    """Where a signer's part lies."""
    return folder / f"signer-{plan.seed}-{number:04d}-{plan.n_words}x{plan.n_seams}-{plan.fps:g}fps-v{VERSION}.npz"


def _write_part(job: tuple[TrainingDataPlan, int, Path]) -> None:
    plan, number, path = job
    save(path, part(plan, number))


def save(path: Path, arrays: dict[str, Array]) -> None:
    """Write a part, whole or not at all."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def part(plan: TrainingDataPlan, number: int) -> dict[str, Array]:
    """A signer's words and sentences.

    ``canonical_bones`` (43, 3): each role's joint from the one above it, arm lengths, common pose. ``turns`` (F, 43, 4) int16
    quaternions times 32767 and ``places`` (F, 12, 3) float32 of all frames, words first, then sentences. ``words`` (W,
    2): first frame, frames. ``events`` (W, 8): up, start, end, down, begin and end of the first movement and of the
    last (-1 where there is none). ``pairs`` (W, W, 3): the truth, pre, post and the transition's
    frames (but for detours around the body), of every word after every other; ``asides`` (W, W, 3) two frames near
    those, and how many it would be between them. ``sentences`` (S, 2): first frame, frames. ``seams`` (N, 3): sentence,
    first transition frame in it, their number.
    """
    rng = stream("endless", plan.seed, number)
    who = rested(signer(FIRST_SIGNER + 10_000 * plan.seed + number))
    seeds = rng.integers(2**40, size=plan.n_words).tolist()
    words = [planner.isolated(pseudo.sign(int(k)), who, fps=plan.fps) for k in seeds]
    frames = [packed(word.clip) for word in words]
    lengths = [len(word) for word in words]
    sentences: list[tuple[int, int]] = []
    seams: list[tuple[int, int, int]] = []
    at = sum(lengths)
    while len(seams) < plan.n_seams:
        chosen = rng.choice(plan.n_words, min(int(rng.integers(_SHORTEST, _LONGEST + 1)), plan.n_words), replace=False)
        said = running.utter([words[k] for k in chosen], changes=bool(rng.random() < 0.5))
        frames.append(packed(said.clip))
        seams += [(len(sentences), s.start, s.stop - s.start) for s in said.stretches if s.word is None]
        sentences.append((at, len(said.clip)))
        at += len(said.clip)
    starts = np.cumsum([0, *lengths[:-1]])
    cuts = np.array([[_cut(p, q) for q in words] for p in words])
    turns, places = (np.concatenate([f[k] for f in frames]) for k in range(2))
    return {
        "bones": canonical_bones(words[0].clip.skeleton),
        "turns": turns,
        "places": places,
        "words": np.stack([starts, lengths], axis=1),
        "events": np.array([event_frames(word.events) for word in words]),
        "pairs": cuts,
        "asides": _asides(words, cuts, rng),
        "sentences": np.array(sentences).reshape(-1, 2),
        "seams": np.array(seams).reshape(-1, 3),
    }


def _asides(words: list[IsolatedWord], cuts: Array, rng: np.random.Generator) -> Array:
    """Other frames (W, W, 3) to leave and enter every pair of words at, and how many frames the truth has between."""
    out = cuts.copy()
    out[..., :2] += np.round(rng.normal(0.0, _NEAR, out[..., :2].shape)).astype(int)
    for i, p in enumerate(words):
        for j, q in enumerate(words):
            pre, post = min(max(out[i, j, 0], 0), len(p) - 1), min(max(out[i, j, 1], 0), len(q) - 1)
            out[i, j] = pre, post, truth.transition_frames(p.states[pre], q.states[post], p)
    return out


def rested(who: Signer) -> Signer:
    """A signer who rests in one of ``RESTS``, half of them with arms that do not hang: lexicons show both."""
    rng = stream("rests", who.name)
    return replace(who, rest=str(rng.choice(RESTS[1:])) if rng.random() < 0.5 else HANGING)


def packed(clip: Clip) -> tuple[Array, Array]:
    """A clip's ``turns`` and ``places`` as a part keeps them."""
    seen = canonical_motion(clip)
    turns = np.round(seen.quats * 32767.0).astype(np.int16)
    return turns, seen.positions.astype(np.float32)


def event_frames(e: Events) -> tuple[int, ...]:
    """A word's events as a part keeps them (8,)."""
    first = e.first or _NO_MOVEMENT
    last = e.passes[-1] if e.passes else _NO_MOVEMENT
    return (e.up, e.start, e.end, e.down, *first, *last)


def _cut(p: IsolatedWord, q: IsolatedWord) -> tuple[int, int, int]:
    seen = truth.relation(p, q)
    pre, post = truth.leave(p, seen), truth.enter(q, seen)
    return pre, post, truth.transition_frames(p.states[pre], q.states[post], p)
