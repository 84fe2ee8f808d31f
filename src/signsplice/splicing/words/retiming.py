"""Words brought to the tempo of running signing: each is shown through a monotone warp of its own time.

Dictionary forms are signed slowly, with holds. The warp changes when each posture comes and no posture itself: paths,
repetitions and contacts stay. It depends on the sign alone, so that a stream can send a sign's frames before it knows
where the sign will be left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, sampled
from signsplice.rig.arms import active_span, arms
from signsplice.rig.info import rig_info
from signsplice.splicing.methods.cut import Cutter, cut_clips
from signsplice.splicing.words.pace import pace
from signsplice.splicing.words.word import SentenceWord

SIGN_FRACTION = 0.4
"""How much of that time a sign aims at between the frames that two neighbours like itself would leave of it. The rest
goes to transitions, to what other neighbours leave beyond that, and to signs that people cannot sign so fast: chosen on
words kept apart, so that all together take the time that was asked for.
"""
_DECIMALS = 4


def retimed(word: SentenceWord, cutter: Cutter, seconds: float) -> SentenceWord:
    """A word brought to a tempo of ``seconds`` a sign, as far as human peaks allow; the word itself where the sign is
    no longer than that, where it is a letter, whose tempo the seams between letters decide, or, with a warning, where
    the rig's arms are not known by name.

    What counts as the sign is what the cutter keeps of it between two signs like itself.
    """
    if word.is_letter:
        return word
    clip, n_left_out = word.clip, word.frames.n_left_out
    if not rig_info(clip.skeleton).has_arms:
        line = f"no arms known in {clip.name}: it is played as recorded, whatever the tempo"
        return replace(word, warnings=(*word.warnings, line))
    if len(clip) < 2:
        return word
    first, last = _sign(clip, cutter)
    rates = pace(clip).rates(first, last, SIGN_FRACTION * seconds - 1.0 / clip.fps)
    if np.all(rates == 1.0):
        return word
    # Rounded as they count in the whole clip: sampling that at a warp's frames gives the same fractions, bit for bit.
    sources = np.round(_source_frames(rates) + n_left_out, _DECIMALS) - n_left_out
    return replace(word, retimed=sampled(clip, sources), frames=replace(word.frames, sources=sources))


def _sign(clip: Clip, cutter: Cutter) -> tuple[int, int]:
    """First and last frame of the sign in a clip: as the cutter cuts it, at most while the arms are away from rest."""
    (cut,) = cut_clips(cutter, [clip, clip])
    start, stop = active_span(arms(clip))
    first, last = max(cut.post, start), min(cut.pre, stop - 1)
    return (first, last) if first < last else (start, stop - 1)


def _source_frames(rates: FloatArray) -> FloatArray:
    """The recorded frame that each played one shows, from the rate at each recorded frame (T,). The first and the last
    frame are played as they are: the whole is slower by less than a frame for that.
    """
    slowness = 1.0 / rates
    times = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))]  # played frames
    n_frames = int(np.ceil(times[-1] - 1e-9))
    times *= n_frames / times[-1]
    sources = PchipInterpolator(times, np.arange(len(rates), dtype=np.float64))(np.arange(n_frames + 1))
    sources = np.round(sources, _DECIMALS)
    sources[0], sources[-1] = 0.0, len(rates) - 1.0
    return np.asarray(sources)
