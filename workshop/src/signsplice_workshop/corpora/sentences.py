"""Sentences: isolated words joined by true transitions, with the changes that running signing makes; and folders of
them as BVH with the ground truth of every seam.

A word's kept frames are its isolated frames, bit for bit, unless one of two rules changes them, which the result
records: a weak hand that the words on both sides need stays up during a one-handed word between them, and a pointing
pronoun takes on part of the next word's handshape (Bayley, Lucas and Rose 2002 found it to vary more than any other
sign).
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.formats.atomic import check_folder, replacing_folder
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.reading import read_bytes
from signsplice.motion import Clip, FloatArray
from signsplice.progress import Progress, track_progress
from signsplice.signer import planner, pose
from signsplice.signer.collisions import penetration
from signsplice.signer.folders import NOT_OURS, check_names, file_name
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import Signer, skeleton, stream
from signsplice.signer.timing import draw_pause
from signsplice_workshop.corpora import truth
from signsplice_workshop.corpora.pairs import VERSION, Recipe

PRONOUNS = frozenset({"I", "YOU", "HE-SHE", "THEY", "THIS", "THAT", "THERE"})
"""Pointing signs, which assimilate if they have the handshape of the pointing hand."""
TREMOR_S = 0.15
"""Standard deviation of the Gaussian that separates a resting hand's tremor from its slower motion, seconds."""
ASSIMILATION = 0.4
"""Fraction of the way that a pronoun's fingers go towards the next word's handshape."""


@dataclass(frozen=True)
class Stretch:
    """A range of a sentence's frames: part of a word, or a transition.

    start, stop: its frames, half-open
    word: index of the word; None for a transition
    source: the word's frame at ``start``; None for a transition
    changed: "weak" if the weak hand stays up, "fingers" if the handshape assimilates, "pause" for a transition in which
        the signer hesitates; empty for isolated frames and other transitions
    """

    start: int
    stop: int
    word: int | None
    source: int | None
    changed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Utterance:
    """A signed sentence.

    words: its isolated words
    seams: the ground truth of every seam
    clip: its motion
    stretches: the origin of each frame
    """

    words: tuple[IsolatedWord, ...]
    seams: tuple[truth.Splice, ...]
    clip: Clip
    stretches: tuple[Stretch, ...]


def utter(words: Sequence[IsolatedWord], changes: bool = True, partner: bool = True) -> Utterance:
    """Returns the sentence of words of one signer and rate, from the first word's rest to the last word's.

    changes: let weak hands stay up, pronouns assimilate and the signer hesitate; without, every kept frame is an
        isolated one, and every transition that of ``truth.splice``.
    partner: as for ``truth.splice``.

    Raises ``InputError`` for no words, or words of two signers.
    """
    if not words:
        raise InputError("no words, expected at least one")
    cuts = [truth.find_cut(p, q, partner=partner) for p, q in itertools.pairwise(words)]
    leaves, enters = [pre for pre, _ in cuts], [0, *(post for _, post in cuts)]
    signed: list[tuple[FloatArray, tuple[str, ...]]] = [(word.states, ()) for word in words]
    if changes:
        for k in range(len(words) - 1):
            signed[k] = _apply_coarticulation(words, signed, k, leaves, enters)
    glosses = [word.sign.gloss for word in words]
    pieces: list[tuple[FloatArray, FloatArray]] = []  # local rotations and root positions
    stretches: list[Stretch] = []
    seams = []
    start = 0
    for k, word in enumerate(words):
        stop = leaves[k] + 1 if k < len(leaves) else len(word)
        kept_frames = slice(enters[k], stop)
        states, changed = signed[k]
        if changed:
            pieces.append(pose.rotations(states[kept_frames], word.signer))
        else:
            pieces.append((word.clip.local_rotations[kept_frames], word.clip.root_positions[kept_frames]))
        stretches.append(Stretch(start, start + stop - enters[k], k, enters[k], changed))
        start += stop - enters[k]
        if k < len(leaves):
            before = states[leaves[k] - 2 : leaves[k] + 1]
            after = signed[k + 1][0][enters[k + 1] : enters[k + 1] + 3]
            pause_s = draw_transition_pause(word.signer, glosses, k) if changes else 0.0
            transition = truth.make_transition(before, after, word, pause_s)
            pieces.append(pose.rotations(transition, word.signer))
            seams.append(truth.Splice(leaves[k], enters[k + 1], transition))
            stretches.append(Stretch(start, start + len(transition), None, None, ("pause",) if pause_s else ()))
            start += len(transition)
    clip = Clip(
        skeleton(words[0].signer),
        np.concatenate([rotations for rotations, _ in pieces]),
        np.concatenate([roots for _, roots in pieces]),
        words[0].clip.fps,
        " ".join(glosses),
    )
    return Utterance(tuple(words), tuple(seams), clip, tuple(stretches))


def _apply_coarticulation(
    words: Sequence[IsolatedWord],
    signed: Sequence[tuple[FloatArray, tuple[str, ...]]],
    k: int,
    leaves: Sequence[int],
    enters: Sequence[int],
) -> tuple[FloatArray, tuple[str, ...]]:
    """Returns the states of word ``k`` as running signing changes them, and the names of the changes."""
    word, states, changed = words[k], words[k].states, []
    following = words[k + 1]
    if k > 0 and not word.sign.two_handed and words[k - 1].sign.two_handed and following.sign.two_handed:
        raised_states = states.copy()
        tremor = states[:, 27:54] - gaussian_filter1d(states[:, 27:54], TREMOR_S * word.clip.fps, axis=0)
        raised_states[:, 27:54] = signed[k - 1][0][leaves[k - 1], 27:54] + tremor
        if penetration(raised_states[enters[k] : leaves[k] + 1], word.signer)[0].max() < truth.TOO_DEEP_CM:
            states, changed = raised_states, ["weak"]
    is_pointing = word.sign.gloss in PRONOUNS and word.sign.segments[0].strong.shape in ("1", "1-bent", "index")
    next_fingers = following.states[following.events.start, pose.FINGERS]
    if is_pointing and np.abs(next_fingers - states[leaves[k], pose.FINGERS]).mean() > 0.1:
        states = states.copy()
        states[:, pose.FINGERS] += ASSIMILATION * (next_fingers - states[:, pose.FINGERS])
        changed.append("fingers")
    return states, tuple(changed)


# --- files

TRUTH = "truth.json"
SHORTEST, LONGEST = 3, 12
"""Smallest and largest number of words of a sentence."""


def write_sentences(
    recipe: Recipe, count: int, folder: Path, changes: bool = True, progress: Progress | None = None
) -> None:
    """Writes ``count`` random sentences of 3 to 12 words as BVH, the isolated words, and ``truth.json``.

    changes: let weak hands stay up and pronouns assimilate (``utter``). Raises ``InputError`` as ``write_lexicon``.
    """
    check_names(recipe.signs)
    signer = recipe.signers()[0]
    rng = stream("sentences", recipe.seed, count)
    check_folder(folder, TRUTH, _list_sentence_files)
    with replacing_folder(folder) as new_folder:
        (new_folder / "words").mkdir()
        words: dict[int, IsolatedWord] = {}
        sentences = []
        for n in track_progress(range(count), progress):
            chosen: list[int] = []
            for _ in range(int(rng.integers(SHORTEST, LONGEST + 1))):
                candidates = [k for k in range(len(recipe.signs)) if not chosen or k != chosen[-1]]
                chosen.append(candidates[int(rng.integers(len(candidates)))])
            for k in chosen:
                if k not in words:
                    words[k] = planner.synthesize_word(recipe.signs[k], signer, fps=recipe.fps)
                    save(words[k].clip, new_folder / "words" / f"{file_name(recipe.signs[k].gloss)}.bvh")
            sentence = utter([words[k] for k in chosen], changes)
            save(sentence.clip, new_folder / f"sentence-{n:04d}.bvh")
            sentences.append(describe(sentence, f"sentence-{n:04d}.bvh"))
        head = {
            "version": VERSION,
            "hash": recipe.hash,
            "seed": recipe.seed,
            "fps": recipe.fps,
            "signer": asdict(signer),
        }
        text = json.dumps(head | {"sentences": sentences}, indent=1) + "\n"
        (new_folder / TRUTH).write_text(text, encoding="utf-8")


def describe(sentence: Utterance, file: str) -> dict[str, Any]:
    """Returns the ground truth of a sentence for JSON: glosses, spans (half-open) and seams, keys as in a report."""
    names = [word.sign.gloss for word in sentence.words]
    spans = []
    for stretch in sentence.stretches:
        count = stretch.stop - stretch.start
        spans.append(
            {
                "kind": "transition" if stretch.word is None else "sign",
                "name": None if stretch.word is None else names[stretch.word],
                "source": None if stretch.source is None else [stretch.source, stretch.source + count],
                "output": [stretch.start, stretch.stop],
                "changed": list(stretch.changed),
            }
        )
    seams = [
        {"before": a, "after": b, "pre_frame": seam.pre, "post_frame": seam.post, "n_transition": len(seam.states)}
        for a, b, seam in zip(names[:-1], names[1:], sentence.seams, strict=True)
    ]
    return {"file": file, "glosses": names, "frames": len(sentence.clip), "spans": spans, "seams": seams}


def _list_sentence_files(folder: Path) -> list[str]:
    """Returns the files of a folder that ``write_sentences`` has written. Raises ``InputError`` if ``truth.json`` is
    another file of this name.
    """
    stored_truth = parse_json(read_bytes(folder / TRUTH), str(folder / TRUTH), "the truth of sentences")
    try:
        check_type(stored_truth, dict[str, Any], TRUTH)
        check_type(stored_truth["sentences"], list[dict[str, Any]], "sentences")
        files = [sentence["file"] for sentence in stored_truth["sentences"]]
        words = {gloss for sentence in stored_truth["sentences"] for gloss in sentence["glosses"]}
        check_type([*files, *words], list[str], "files and glosses")
    except (KeyError, TypeError) as error:
        raise InputError(f"{folder / TRUTH}: is no truth of `synth sentences`; {NOT_OURS}") from error
    return [TRUTH, *files, *(f"words/{file_name(word)}.bvh" for word in words)]


_TRANSITION_PAUSE_S = (0.12, 0.35)


def draw_transition_pause(signer: Signer, glosses: Sequence[str], number: int) -> float:
    """Returns the seconds by which hesitation lengthens the transition after word ``number``, mostly 0."""
    return draw_pause(signer, _TRANSITION_PAUSE_S, *glosses, number)[0]
