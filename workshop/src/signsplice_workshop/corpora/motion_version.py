"""The version of the synthetic signer: a hash of the motion that it generates for fixed signs by fixed signers.

Training data, corpora of pairs and bundles name it. A test compares it with the current signer: after a change of the
signer's motion, update it first, since networks and corpora store it; then run `make weights`, `make corpus` and
`make words`.
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
"""Positions are hashed in thousandths of an arm length (half a millimetre); processors differ by far less."""


def hash_motion() -> str:
    """Returns twelve hex digits, the hash of ``_N_SIGNS`` pseudo-signs by a signer of each rest pose: their lengths,
    the mean canonical positions of wrists and fingers, and the true splices of each sign with the next.
    """
    digest = hashlib.sha256()
    for number, rest in enumerate(RESTS):
        signer = replace(STANDARD if number == 0 else draw_signer(number), rest=rest)
        signs = [pseudo.draw_sign(_FIRST_SIGN + _N_SIGNS * number + k) for k in range(_N_SIGNS)]
        words = [planner.synthesize_word(sign, signer) for sign in signs]
        for word in words:
            positions = canonical_motion(word.clip).positions
            digest.update(np.round(positions.mean(axis=0) / _STEP).astype(np.int64).tobytes() + bytes([len(word)]))
        for p, q in pairwise(words):
            splice = truth.splice(p, q)
            digest.update(bytes([splice.pre, splice.post, len(splice.states)]))
    return digest.hexdigest()[:12]
