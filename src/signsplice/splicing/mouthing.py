"""Mouths of words without a face of their own, guessed from a pronunciation dictionary that the user names.

A file in the format of the CMU Pronouncing Dictionary (https://github.com/cmusphinx/cmudict) gives the words of a gloss
their phonemes, which ``written.nonmanual`` turns into a mouth. Signers of ASL mouth few words whole: this is a guess,
and no signer has judged it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from signsplice.errors import FormatError
from signsplice.formats.reading import read_bytes
from signsplice.lexicon.gloss import fold
from signsplice.motion.face import ARKIT_CHANNELS, VISEMES, Face
from signsplice.rig.info import rig_info
from signsplice.splicing.contracts import Cutter
from signsplice.splicing.tempo import find_sign
from signsplice.splicing.word import AlignedWord
from signsplice.written.nonmanual import mouthing

_SAMPA: Mapping[str, str] = dict(re.findall(r"(\w+)=(\S+)", """
    AA=A AE={ AH=V AH0=@ AO=O: AW=aU AY=aI B=b CH=tS D=d DH=D EH=E ER=3: EY=eI F=f G=g HH=h IH=I IY=i: JH=dZ K=k L=l M=m
    N=n NG=N OW=oU OY=OI P=p R=r S=s SH=S T=t TH=T UH=U UW=u: V=v W=w Y=j Z=z ZH=Z
"""))  # fmt: skip
"""ARPAbet, the 39 phonemes of CMUdict's cmudict.phones -> SAMPA (Wells 1997); AH without stress is a schwa."""
CHANNELS = tuple(name for name in ARKIT_CHANNELS if any(name in shape for shape in VISEMES.values()))
"""The coefficients of every mouth of a ``Pronunciations``."""


@dataclass(frozen=True)
class Pronunciations:
    """A pronunciation dictionary.

    sampa: word, folded (``gloss.fold``) -> its phonemes in SAMPA, separated by blanks.
    """

    sampa: Mapping[str, str]

    def of(self, gloss: str) -> str:
        """Returns the phonemes of the words of a gloss, without its digits and the number of its variant (``BOOK#2``);
        empty if a word is unknown.
        """
        words = re.findall(r"(?:[^\W\d_]|')+", gloss.partition("#")[0])
        phonemes = [self.sampa.get(fold(word), "") for word in words]
        return " ".join(phonemes) if all(phonemes) else ""

    def mouth(self, word: AlignedWord, cutter: Cutter) -> Face:
        """Returns a mouth (T frames of ``word.retimed``) that says a word during its sign, as ``cutter`` cuts it, up to
        its hold: at the usual rate, or faster to be done by then. Elsewhere, and in letters and unknown words, it is
        closed.
        """
        weights, fps, last = np.zeros((len(word.retimed), len(CHANNELS))), word.retimed.fps, len(word.clip) - 1
        if last > 0 and not word.is_letter and (sampa := self.of(word.clip.name)):
            first, last = find_sign(word, cutter) if rig_info(word.clip.skeleton).has_arms else (0, last)
            last = last if word.held is None else min(last, word.held.kept)
            start, stop = word.frames.first(first), word.frames.last(last) + 1
            n_frames = min(len(mouthing(sampa, fps)), stop - start)
            if n_frames > 1:
                weights[start : start + n_frames] = mouthing(sampa, fps, n_frames / fps).of(CHANNELS)
        return Face(CHANNELS, weights)


def read_pronunciations(path: str | Path, most_bytes: float) -> Pronunciations:
    """Reads the first pronunciation of each word of a file of at most ``most_bytes``, in UTF-8 or Latin-1.

    Raises ``InputError`` if it cannot be read, ``LimitError`` if it is larger, ``FormatError`` for a line with an
    unknown phoneme or none, and for a file without any pronunciation.
    """
    known, expected = dict[str, str](), "HELLO  HH AH0 L OW1"
    for number, row in enumerate(BytesIO(read_bytes(path, most_bytes)), 1):
        try:
            line = row.decode("utf-8-sig")
        except UnicodeDecodeError:
            line = row.decode("latin-1")  # as CMUdict 0.7b
        word, *phonemes = line.partition(" #")[0].split() or [";;;"]  # newer files have comments at the ends of lines
        if word.startswith(";;;"):
            continue
        phonemes = phonemes or [""]
        sounds = [_SAMPA.get(phoneme) or _SAMPA.get(phoneme.rstrip("012"), "") for phoneme in phonemes]
        if not all(sounds):
            what = f"{word!r:.40}: {phonemes[sounds.index('')]!r:.20} is no phoneme, expected ARPAbet as in {expected}"
            raise FormatError(what, file=str(path), line=number)
        known.setdefault(fold(re.sub(r"\(\d+\)$", "", word)), " ".join(sounds))
    if not known:
        raise FormatError(f"holds no pronunciation, expected lines as {expected}", file=str(path))
    return Pronunciations(known)
