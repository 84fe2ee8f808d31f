"""Sentences: isolated words joined by true transitions, with the changes that running signing makes; and folders of
them as BVH with the ground truth of every seam.

A word's kept frames are its isolated frames, bit for bit, except where one of two rules changes them, which the result
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
"""Pointing signs, which assimilate where they have the pointing hand's own shape."""
TREMOR_S = 0.15
"""Standard deviation of the Gaussian that tells a resting hand's tremor from its slower motion, seconds."""
ASSIMILATION = 0.4
"""How far a pronoun's fingers go towards the next word's handshape, as a fraction."""


@dataclass(frozen=True)
class Stretch:
    """A range of a sentence's frames: part of a word, or a transition.

    start, stop: its frames, half-open
    word: index of the word; None for a transition
    source: the word's frame that ``start`` shows; None for a transition
    changed: "weak" where the weak hand stays up, "fingers" where the handshape assimilates, "pause" for a transition in
        which the signer hesitates; empty for isolated frames and other transitions
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
    stretches: where each frame comes from
    """

    words: tuple[IsolatedWord, ...]
    seams: tuple[truth.Splice, ...]
    clip: Clip
    stretches: tuple[Stretch, ...]


def utter(words: Sequence[IsolatedWord], changes: bool = True, partner: bool = True) -> Utterance:
    """The sentence of words of one signer and rate, from the first word's rest to the last word's.

    changes: let weak hands stay, pronouns assimilate and the signer hesitate; without, every kept frame is an isolated
    one, and every transition that of ``truth.splice``.
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
    at = 0
    for k, word in enumerate(words):
        stop = leaves[k] + 1 if k < len(leaves) else len(word)
        kept = slice(enters[k], stop)
        states, changed = signed[k]
        if changed:
            pieces.append(pose.rotations(states[kept], word.signer))
        else:
            pieces.append((word.clip.local_rotations[kept], word.clip.root_positions[kept]))
        stretches.append(Stretch(at, at + stop - enters[k], k, enters[k], changed))
        at += stop - enters[k]
        if k < len(leaves):
            before = states[leaves[k] - 2 : leaves[k] + 1]
            after = signed[k + 1][0][enters[k + 1] : enters[k + 1] + 3]
            pause_s = transition_pause(word.signer, glosses, k) if changes else 0.0
            transition = truth.transition(before, after, word, pause_s)
            pieces.append(pose.rotations(transition, word.signer))
            seams.append(truth.Splice(leaves[k], enters[k + 1], transition))
            stretches.append(Stretch(at, at + len(transition), None, None, ("pause",) if pause_s else ()))
            at += len(transition)
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
    """The states of word ``k`` as running signing changes them, and the names of the changes."""
    word, states, changed = words[k], words[k].states, []
    following = words[k + 1]
    if k > 0 and not word.sign.two_handed and words[k - 1].sign.two_handed and following.sign.two_handed:
        stays = states.copy()
        tremor = states[:, 27:54] - gaussian_filter1d(states[:, 27:54], TREMOR_S * word.clip.fps, axis=0)
        stays[:, 27:54] = signed[k - 1][0][leaves[k - 1], 27:54] + tremor
        if penetration(stays[enters[k] : leaves[k] + 1], word.signer)[0].max() < truth.TOO_DEEP_CM:
            states, changed = stays, ["weak"]
    points = word.sign.gloss in PRONOUNS and word.sign.segments[0].strong.shape in ("1", "1-bent", "index")
    other = following.states[following.events.start, pose.FINGERS]
    if points and np.abs(other - states[leaves[k], pose.FINGERS]).mean() > 0.1:
        states = states.copy()
        states[:, pose.FINGERS] += ASSIMILATION * (other - states[:, pose.FINGERS])
        changed.append("fingers")
    return states, tuple(changed)


# --- as files

TRUTH = "truth.json"
SHORTEST, LONGEST = 3, 12
"""Number of words of a sentence."""


def write_sentences(
    recipe: Recipe, count: int, folder: Path, changes: bool = True, progress: Progress | None = None
) -> None:
    """Write ``count`` random sentences of 3 to 12 words as BVH, the isolated words, and ``truth.json``.

    changes: let weak hands stay up and pronouns assimilate (``running``). Raises ``InputError`` as ``write_lexicon``.
    """
    check_names(recipe.signs)
    signer = recipe.signers()[0]
    rng = stream("sentences", recipe.seed, count)
    check_folder(folder, TRUTH, _sentence_files)
    with replacing_folder(folder) as made:
        (made / "words").mkdir()
        words: dict[int, IsolatedWord] = {}
        sentences = []
        for n in track_progress(range(count), progress):
            chosen: list[int] = []
            for _ in range(int(rng.integers(SHORTEST, LONGEST + 1))):
                others = [k for k in range(len(recipe.signs)) if not chosen or k != chosen[-1]]
                chosen.append(others[int(rng.integers(len(others)))])
            for k in chosen:
                if k not in words:
                    words[k] = planner.synthesize_word(recipe.signs[k], signer, fps=recipe.fps)
                    save(words[k].clip, made / "words" / f"{file_name(recipe.signs[k].gloss)}.bvh")
            sentence = utter([words[k] for k in chosen], changes)
            save(sentence.clip, made / f"sentence-{n:04d}.bvh")
            sentences.append(describe(sentence, f"sentence-{n:04d}.bvh"))
        head = {
            "version": VERSION,
            "hash": recipe.hash,
            "seed": recipe.seed,
            "fps": recipe.fps,
            "signer": asdict(signer),
        }
        text = json.dumps(head | {"sentences": sentences}, indent=1) + "\n"
        (made / TRUTH).write_text(text, encoding="utf-8")


def describe(sentence: Utterance, file: str) -> dict[str, Any]:
    """The ground truth of a sentence for JSON: glosses, spans (half-open) and seams, with the keys of a report."""
    names = [word.sign.gloss for word in sentence.words]
    spans = []
    for part in sentence.stretches:
        count = part.stop - part.start
        spans.append(
            {
                "kind": "transition" if part.word is None else "sign",
                "name": None if part.word is None else names[part.word],
                "source": None if part.source is None else [part.source, part.source + count],
                "output": [part.start, part.stop],
                "changed": list(part.changed),
            }
        )
    seams = [
        {"before": a, "after": b, "pre_frame": seam.pre, "post_frame": seam.post, "n_transition": len(seam.states)}
        for a, b, seam in zip(names[:-1], names[1:], sentence.seams, strict=True)
    ]
    return {"file": file, "glosses": names, "frames": len(sentence.clip), "spans": spans, "seams": seams}


def _sentence_files(folder: Path) -> list[str]:
    """The files of a folder that ``write_sentences`` has written. Raises ``InputError`` where ``truth.json`` is another
    file of this name.
    """
    truth = parse_json(read_bytes(folder / TRUTH), str(folder / TRUTH), "the truth of sentences")
    try:
        check_type(truth, dict[str, Any], TRUTH)
        check_type(truth["sentences"], list[dict[str, Any]], "sentences")
        files = [sentence["file"] for sentence in truth["sentences"]]
        words = {gloss for sentence in truth["sentences"] for gloss in sentence["glosses"]}
        check_type([*files, *words], list[str], "files and glosses")
    except (KeyError, TypeError) as error:
        raise InputError(f"{folder / TRUTH}: is no truth of `synth sentences`; {NOT_OURS}") from error
    return [TRUTH, *files, *(f"words/{file_name(word)}.bvh" for word in words)]


_TRANSITION_PAUSE_S = (0.12, 0.35)


def transition_pause(signer: Signer, glosses: Sequence[str], number: int) -> float:
    """How much longer (seconds) the transition after word ``number`` of a sentence takes by hesitation, mostly 0."""
    return draw_pause(signer, _TRANSITION_PAUSE_S, *glosses, number)[0]
