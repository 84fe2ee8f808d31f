"""A system of this project's own, put together from the parts that the tables show to be best.

- Positions: the frames with the highest mean log-odds of LPT+, Transformer and LSTM, so that both are always found.
- Number of frames: LPT+'s TFGN at that cut.
- Frames: the mean of this project's transition network, of ridge regression and of TFGN, put back onto the skeleton, so
  that no bone changes. A joint that would turn by over ``MOST_DEG`` in a frame keeps the first one's rotations.

Systems, mean and limit were chosen on 300 validation pairs of the random split.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_softmax

from signsplice.motion import Clip, FloatArray, rotation
from signsplice.splicing.contracts import Cut, gap_at
from signsplice_paper import published
from signsplice_paper.baselines import Ridge
from signsplice_paper.clip_methods import TRUE_POSITIONS, ClipMethod, prediction_of
from signsplice_paper.prediction import Prediction
from signsplice_paper.systems import PaperSystem, TwoNetworkSystem
from signsplice_paper.systems.from_positions import rotations_from_positions
from signsplice_paper.systems.splicers import NONE, POST, PRE
from signsplice_workshop.measure.collisions import fill

SYSTEMS = (published.IMPROVED, "transformer", "lstm")
"""Whose tokens are read together; the first one's TFGN gives the number of frames."""
MOST_DEG = 45.0


@dataclass(frozen=True, eq=False)
class AssembledAnswers:
    """A callable from a pair's number to a prediction.

    ridge: the regression, fitted to the training part of the split
    systems: by name, those of ``SYSTEMS``, trained on it
    """

    ridge: Ridge
    systems: Mapping[str, PaperSystem]

    def __call__(self, number: int) -> Prediction:
        """The prediction for a pair."""
        pairs = self.ridge.pairs
        p, q = pairs.index[number, :2].tolist()
        cut = self._cut(pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64))
        made, clip = self._frames(number, cut)
        skeleton = pairs.skeletons[pairs.signer(p)]
        joints = list(pairs.space(p).indices(skeleton, pairs.gloss(p)))
        ends = [pairs.word(word, "rotations")[at].astype(np.float64) for word, at in ((p, cut.pre), (q, cut.post))]
        local = rotations_from_positions(skeleton, pairs.space(p).positions(made), ends[0], ends[1], joints)
        shown = np.concatenate([ends[0][None], local, ends[1][None]])
        jumps = (np.rad2deg(rotation.angle_between(shown[:-1], shown[1:])) > MOST_DEG).any(axis=0)
        local[:, jumps] = clip.local_rotations[:, jumps]
        return prediction_of(pairs, p, cut, replace(clip, local_rotations=local))

    def _cut(self, before: FloatArray, after: FloatArray) -> Cut:
        each = [
            log_softmax(system.tokens(before, after) + np.array([0.0, system.token_bias, system.token_bias]), axis=1)
            for system in self.systems.values()
        ]
        mean, n = np.mean(each, axis=0), len(before)
        pre, post = (mean[:n, PRE] - mean[:n, NONE]).argmax(), (mean[n:, POST] - mean[n:, NONE]).argmax()
        return Cut(int(pre), int(post))

    def _frames(self, number: int, cut: Cut) -> tuple[FloatArray, Clip]:
        """The mean of the three as numbers (n, K), and this project's transition as a clip."""
        pairs = self.ridge.pairs
        p, q = pairs.index[number, :2].tolist()
        generator = self.systems[published.IMPROVED]
        assert isinstance(generator, TwoNetworkSystem)
        words = pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64)
        by_tfgn = generator.fill(*words, cut.pre, cut.post)
        gap = gap_at(pairs.word_clip(p), pairs.word_clip(q), cut, len(by_tfgn))
        clip = fill(_TRANSITION.parts.transition, [gap], None)[0]
        by_ridge = self.ridge.fill(number, cut.pre, cut.post, len(by_tfgn))
        return np.mean([prediction_of(pairs, p, cut, clip).frames, by_ridge, by_tfgn], axis=0), clip


_TRANSITION = ClipMethod(TRUE_POSITIONS, "learned", "positions and length")
