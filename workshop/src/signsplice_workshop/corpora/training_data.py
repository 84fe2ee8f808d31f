"""Synthetic signing to train networks on: any number of signers, each with its own words and sentences of them.

Every signer is a part, one .npz file, generated from its seed alone: isolated pseudo-signs with their events, and
sentences of them with the ground truth of every seam. Motion is stored on the canonical humanoid (``rig.canonical``),
as networks see it. The parts contain none of this package's words and neither signer of a corpus of pairs. The pairs of
such a corpus can be written as parts too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.motion import Clip, FloatArray, Skeleton, concatenate, same_fps
from signsplice.motion.cache import CACHE
from signsplice.progress import Progress
from signsplice.rig.info import FEATURE_FPS, canonical_motion, rig_info
from signsplice.signer import planner
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import HANGING, PLAIN, RESTS, TRAITS, Manner, Signer, draw_signer, stream
from signsplice.signer.timing import Events
from signsplice_workshop.corpora import pseudo, truth
from signsplice_workshop.corpora import sentences as running
from signsplice_workshop.corpora.motion_version import MOTION_VERSION
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.corpora.pool import Pool, is_whole
from signsplice_workshop.corpora.touches import with_touches

Array = NDArray[Any]

FIRST_SIGNER = 1000
"""Seed of the first signer; the signers of any corpus of pairs have lower seeds."""
_SHORTEST, _LONGEST = 3, 12
_SIGNS_KEPT = 256
"""Pseudo-signs that are cached for the next part, which may be the same signer's."""
_NO_MOVEMENT = (-1, -1)


@dataclass(frozen=True)
class TrainingDataPlan:
    """How much training data to generate.

    n_signers: number of signers
    n_words: number of words of each signer
    n_seams: smallest number of seams in sentences of each signer
    seed: seeds signers, words and sentences
    fps: frame rate
    traits: traits of manner that signers have, names of ``manner.TRAITS``; None for all. The signers' bodies, words and
        sentences do not depend on them
    """

    n_signers: int = 40
    n_words: int = 100
    n_seams: int = 300
    seed: int = 0
    fps: float = 30.0
    traits: tuple[str, ...] | None = None


def write(plan: TrainingDataPlan, folder: Path, progress: Progress | None = None, processes: int = 2) -> int:
    """Writes the parts that do not exist yet, or are damaged; returns how many exist then.

    Raises ``InputError`` if a number is out of range, a trait is unknown or the folder cannot be written.
    """
    return write_all([(plan, folder)], progress, processes)


def write_all(
    plans: Sequence[tuple[TrainingDataPlan, Path]], progress: Progress | None = None, processes: int = 2
) -> int:
    """Writes the parts of several plans, each with its folder; returns how many exist then. A signer's parts of all
    plans are generated one after another, and plans that differ in their traits alone share its pseudo-signs.
    """
    for plan, folder in plans:
        if plan.n_signers < 1 or plan.n_words < 2 or plan.n_seams < 0:
            raise InputError(f"{plan}: expected at least 1 signer, 2 words and 0 seams")
        keep_traits(PLAIN, plan.traits or ())
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    jobs = [
        (plan, number, locate_part(folder, plan, number))
        for number in range(max(plan.n_signers for plan, _ in plans))
        for plan, folder in plans
        if number < plan.n_signers
    ]
    pending_jobs = [job for job in jobs if not is_whole(job[2])]
    with Pool(processes) as run:
        for n_done, _ in enumerate(run(_write_part, pending_jobs), len(jobs) - len(pending_jobs) + 1):
            if progress is not None:
                progress(n_done, len(jobs))
    return len(jobs)


def locate_part(folder: Path, plan: TrainingDataPlan, number: int) -> Path:
    """Returns the file of a signer's part. Its name states the signer's traits, unless these are all."""
    size = f"{plan.n_words}x{plan.n_seams}-{plan.fps:g}fps"
    return folder / f"signer-{plan.seed}-{number:04d}-{size}{_format_traits(plan.traits)}-{MOTION_VERSION}.npz"


def _format_traits(traits: tuple[str, ...] | None) -> str:
    """Returns the traits for a file name, the same for all orders of the same traits; empty for all of them."""
    if traits is None or set(traits) == set(TRAITS):
        return ""
    return "-" + ("+".join(name for name in TRAITS if name in traits) or "plain")


def _write_part(job: tuple[TrainingDataPlan, int, Path]) -> None:
    plan, number, path = job
    save(path, make_part(plan, number))


def save(path: Path, arrays: dict[str, Array]) -> None:
    """Writes a part, completely or not at all."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def make_part(plan: TrainingDataPlan, number: int) -> dict[str, Array]:
    """Returns a signer's words and sentences as arrays.

    bones: (43, 3) offset of each canonical role's joint from its parent in the T-pose, arm lengths
    turns: (F, 43, 4) int16, canonical quaternions times 32767 of all frames, words first, then sentences
    places: (F, 12, 3) float32, canonical positions of all frames
    words: (W, 2) first frame and number of frames
    events: (W, 8) up, start, end, down, begin and end of the first movement and of the last one (-1 for none)
    pairs: (W, W, 3) the ground truth of every word after every other: pre, post and the number of transition frames,
        without those added for detours around the body
    sentences: (S, 2) first frame and number of frames
    seams: (N, 3) sentence, first transition frame in it, number of transition frames
    """
    rng = stream("endless", plan.seed, number)
    signer = with_rest(draw_signer(FIRST_SIGNER + 10_000 * plan.seed + number))
    if plan.traits is not None:
        signer = replace(signer, manner=keep_traits(signer.manner, plan.traits))
    seeds = rng.integers(2**40, size=plan.n_words).tolist()
    signs = [CACHE.recent(pseudo.draw_sign, int(k), most=_SIGNS_KEPT) for k in seeds]
    words = [with_touches(planner.synthesize_word(sign, signer, fps=plan.fps)) for sign in signs]
    frames = [pack_motion(word.clip) for word in words]
    lengths = [len(word) for word in words]
    sentences: list[tuple[int, int]] = []
    seams: list[tuple[int, int, int]] = []
    first_frame = sum(lengths)
    while len(seams) < plan.n_seams:
        chosen_words = rng.choice(
            plan.n_words, min(int(rng.integers(_SHORTEST, _LONGEST + 1)), plan.n_words), replace=False
        )
        sentence = running.utter([words[k] for k in chosen_words], changes=bool(rng.random() < 0.5))
        frames.append(pack_motion(sentence.clip))
        seams += [
            (len(sentences), stretch.start, stretch.stop - stretch.start)
            for stretch in sentence.stretches
            if stretch.word is None
        ]
        sentences.append((first_frame, len(sentence.clip)))
        first_frame += len(sentence.clip)
    starts = np.cumsum([0, *lengths[:-1]])
    cuts = np.array([[_find_true_cut(p, q) for q in words] for p in words])
    quats, positions = (np.concatenate([motion[k] for motion in frames]) for k in range(2))
    return {
        "bones": measure_canonical_bones(words[0].clip.skeleton),
        "turns": quats,
        "places": positions,
        "words": np.stack([starts, lengths], axis=1),
        "events": np.array([pack_events(word.events) for word in words]),
        "pairs": cuts,
        "sentences": np.array(sentences).reshape(-1, 2),
        "seams": np.array(seams).reshape(-1, 3),
    }


def _find_true_cut(p: IsolatedWord, q: IsolatedWord) -> tuple[int, int, int]:
    pre, post = truth.find_cut(p, q)
    return pre, post, truth.count_transition_frames(p.states[pre], q.states[post], p)


def with_rest(signer: Signer) -> Signer:
    """Returns a signer with a rest pose drawn from ``RESTS``; half of them do not let their arms hang, as in real
    lexicons.
    """
    rng = stream("rests", signer.name)
    return replace(signer, rest=str(rng.choice(RESTS[1:])) if rng.random() < 0.5 else HANGING)


def pack_motion(clip: Clip) -> tuple[Array, Array]:
    """Returns a clip's canonical quaternions (T, 43, 4) int16 and positions (T, 12, 3) float32, as in a part."""
    motion = canonical_motion(clip)
    quats = np.round(motion.quats * 32767.0).astype(np.int16)
    return quats, motion.positions.astype(np.float32)


def pack_events(events: Events) -> tuple[int, ...]:
    """Returns a word's events (8,) as a part stores them."""
    first = events.first or _NO_MOVEMENT
    last = events.passes[-1] if events.passes else _NO_MOVEMENT
    return (events.up, events.start, events.end, events.down, *first, *last)


# --- from a corpus of pairs

_PARTS = ("train", "valid")
AROUND = 24
"""Frames of either word that a sentence keeps around its seam: three times a network's input."""
_NO_TRUTH = (-1, -1, -1)


def write_split(pairs: Pairs, split: str, folder: Path) -> list[Path]:
    """Writes the training and the validation part of a split of a corpus, each with ``corpus`` (hash) and ``split``;
    returns both paths. Networks can then learn from exactly what the paper's systems learn from. Words that are in
    neither part are left out.

    Raises ``InputError`` for a corpus of clips whose events are not known, an unknown split, a part of fewer than two
    words, a corpus at another frame rate than the networks', or a folder that cannot be written.
    """
    pairs.check_synthetic()
    if not same_fps(pairs.head["fps"], FEATURE_FPS):
        raise InputError(
            f"{pairs.folder}: {pairs.head['fps']:g} frames a second, expected {FEATURE_FPS:g}, the networks' rate"
        )
    chosen = [pairs.split(split, name) for name in _PARTS]
    for name, numbers in zip(_PARTS, chosen, strict=True):
        if len(set(pairs.index[numbers, :2].ravel().tolist())) < 2:
            raise InputError(
                f"{pairs.folder}: the {name} part of split {split} has fewer than two words; make a larger corpus"
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    paths = [folder / f"signer-corpus-{pairs.head['hash']}-{split}-{name}.npz" for name in _PARTS]
    for path, numbers in zip(paths, chosen, strict=True):
        save(
            path, {**make_corpus_part(pairs, numbers), "corpus": np.array(pairs.head["hash"]), "split": np.array(split)}
        )
    return paths


def make_corpus_part(pairs: Pairs, numbers: list[int]) -> dict[str, Array]:
    """Returns pairs of one signer as arrays like those of ``make_part``: their words, and for each pair a sentence, cut
    ``AROUND`` frames around its seam. Other pairs of these words have no ground truth (-1).
    """
    index = pairs.index[numbers]
    words = sorted(set(index[:, :2].ravel().tolist()))
    order = {word: k for k, word in enumerate(words)}
    true_cuts = np.tile(_NO_TRUTH, (len(words), len(words), 1))
    clips = {word: pairs.word_clip(word) for word in words}
    frames = [pack_motion(clips[word]) for word in words]
    lengths = [len(clips[word]) for word in words]
    first_frame = sum(lengths)
    sentences: list[tuple[int, int]] = []
    seams: list[tuple[int, int, int]] = []
    for number, (p, q, pre, post, _, count) in zip(numbers, index.tolist(), strict=True):
        true_cuts[order[p], order[q]] = pre, post, count
        before, after = clips[p][max(0, pre + 1 - AROUND) : pre + 1], clips[q][post : post + AROUND]
        sentence = concatenate([before, pairs.transition_clip(number), after])
        frames.append(pack_motion(sentence))
        seams.append((len(sentences), len(before), count))
        sentences.append((first_frame, len(sentence)))
        first_frame += len(sentence)
    quats, positions = (np.concatenate([motion[k] for motion in frames]) for k in range(2))
    return {
        "bones": measure_canonical_bones(pairs.skeletons[pairs.signer(words[0])]),
        "turns": quats,
        "places": positions,
        "words": np.stack([np.cumsum([0, *lengths[:-1]]), lengths], axis=1),
        "events": np.array([pack_events(pairs.events(word)) for word in words]),
        "pairs": true_cuts,
        "sentences": np.array(sentences),
        "seams": np.array(seams),
    }


def keep_traits(manner: Manner, traits: tuple[str, ...]) -> Manner:
    """Returns a manner with some of its traits, the others 0. Raises ``InputError`` for an unknown name."""
    for name in traits:
        if name not in TRAITS:
            raise InputError(f"no trait {name!r}, expected some of {', '.join(TRAITS)}")
    return Manner(**{name: getattr(manner, name) for name in traits})


def measure_canonical_bones(skeleton: Skeleton) -> FloatArray:
    """Returns the vector from the joint of the role above to each role's joint in the T-pose (R, 3), arm lengths; 0 if
    a role is missing.

    With canonical rotations A, joints lie at p_j = p_parent + K_parent bone_j, as near as joints without a role keep
    their pose.
    """
    info = rig_info(skeleton)
    canonical, positions = info.canonical, info.t_pose.positions
    hips = info.roles.joints.get("hips", 0)
    parents = np.where(canonical.parent_rows >= 0, canonical.joints[canonical.parent_rows], hips)
    bones = (positions[canonical.joints] - positions[parents]) / canonical.arm_length
    return np.asarray(np.where(canonical.has_role[:, None], bones, 0.0))
