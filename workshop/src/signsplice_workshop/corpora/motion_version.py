"""The version of the synthetic signer: a hash of what it makes of fixed signs by fixed signers.

Signing to train on, corpora of pairs and bundles name it. A test compares it with the signer of the day: who changes
the signer's motion runs `make weights`, `make corpus` and `make words` again, and then sets it anew.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import pairwise

import numpy as np

from signsplice.rig.info import canonical_motion
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD, draw_signer
from signsplice_workshop.corpora import pseudo, truth

MOTION_VERSION = "d5aef5f22e74"
_N_SIGNS, _FIRST_SIGN = 3, 7_000
_STEP = 1e-3
"""Positions are hashed in thousandths of an arm, half a millimetre: processors differ by far less."""


def hash_motion() -> str:
    """Twelve hex digits of what a signer of each rest pose makes of ``_N_SIGNS`` pseudo-signs: their lengths, the mean
    canonical positions of wrists and fingers, and the true splices of each sign with the next.
    """
    digest = hashlib.sha256()
    for number, rest in enumerate(RESTS):
        signer = replace(STANDARD if number == 0 else draw_signer(number), rest=rest)
        signs = [pseudo.sign(_FIRST_SIGN + _N_SIGNS * number + k) for k in range(_N_SIGNS)]
        words = [planner.synthesize_word(sign, signer) for sign in signs]
        for word in words:
            positions = canonical_motion(word.clip).positions
            digest.update(np.round(positions.mean(axis=0) / _STEP).astype(np.int64).tobytes() + bytes([len(word)]))
        for p, q in pairwise(words):
            splice = truth.splice(p, q)
            digest.update(bytes([splice.pre, splice.post, len(splice.states)]))
    return digest.hexdigest()[:12]
