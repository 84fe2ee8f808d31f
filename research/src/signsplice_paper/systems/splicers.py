"""Trained systems that splice two words: positions by one network and frames by another, or both by one.

Positions follow eq. 10: a token is emitted if its class wins at some frame, with a bias that was chosen on validation
pairs; its position is the frame with the highest log-odds against "none". Frames follow eq. 16: from the start token to
the first frame that is classified as the last one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from signsplice.motion import FloatArray
from signsplice.splicing.bundle import Array, Sessions
from signsplice.splicing.lptransformer import START, as_batch_of_one, cull, decode, splice_positions
from signsplice_paper.configs import PaperConfig, RunConfig
from signsplice_paper.prediction import N_NUMBERS, Prediction

DECODINGS = ("one-by-one", "without-cache", "parallel")
"""Every frame is fed back, with a cache of what was read; the same without a cache; all frames are made in one pass."""
FRAME = 1
"""Kind of a decoder input: a frame that the decoder made."""


class PaperSystem(ABC):
    """A trained system.

    - name: the system's name
    - config: its bundle.json
    - graphs: the exported graphs
    - decoding: one of ``DECODINGS``
    - fr: frames that Culling keeps on each side; None without Culling
    - marked: whether the encoder is given the positions as marks on the whole X
    - most_frames: largest number of frames that are made
    - token_bias: added to the logits of both tokens
    - n_numbers: numbers of a frame
    """

    def __init__(self, config: PaperConfig, runs: RunConfig, graphs: Sessions, decoding: str) -> None:
        self.name, self.config, self.graphs, self.decoding = config.system or "", config, graphs, decoding
        self.fr, self.marked = config.fr, runs.marked
        self.most_frames, self.token_bias = runs.most_frames, runs.token_bias
        self.n_numbers = N_NUMBERS if config.space is None else config.space.n_numbers

    @property
    def n_parameters(self) -> int:
        """Number of parameters of all networks."""
        return self.config.n_parameters or 0

    @abstractmethod
    def predict(self, before: FloatArray, after: FloatArray) -> Prediction:
        """Returns the splice of ``before`` (N, 159) and ``after`` (M, 159), both in [-0.5, 0.5]."""

    def positions(self, before: FloatArray, after: FloatArray) -> tuple[int | None, int | None]:
        """Returns the positions pre and post alone, None for a token that is not emitted."""
        return splice_positions(self.tokens(before, after), len(before), self.token_bias)

    @abstractmethod
    def predict_fixed(self, before: FloatArray, after: FloatArray, pre: int, post: int, n_frames: int) -> FloatArray:
        """Returns the frames (n_frames, 159) of a prediction with a fixed outcome, for timing: positions are predicted,
        but ``n_frames`` frames are made at pre and post. The cost does not depend on the networks'
        weights.
        """

    @abstractmethod
    def tokens(self, before: FloatArray, after: FloatArray) -> Array:
        """Returns the logits (N + M, 3) of no token, of pre and of post at each frame."""

    def _decode(self, encoded: Mapping[str, Array], n_frames: int | None = None) -> FloatArray:
        """Returns the transition frames (n, 159) that the decoder makes from the encoder's outputs. With ``n_frames``
        it makes this number and ignores the end token.
        """
        inputs = {name: value for name, value in encoded.items() if name.startswith(("memory", "state"))}
        if self.decoding == "parallel":
            outputs = decode(self.graphs, encoded, self.most_frames, self.n_numbers)
            ends = np.flatnonzero(outputs["last"][0] > 0.0)
            count = (int(ends[0]) + 1 if len(ends) else self.most_frames) if n_frames is None else n_frames
            return outputs["made"][0, :count].astype(np.float64)
        frames: list[Array] = []
        fed, kinds, start = np.zeros((1, 1, self.n_numbers), np.float32), np.full((1, 1), START), 0
        while len(frames) < (self.most_frames if n_frames is None else n_frames):
            outputs = self.graphs.run("decoder", {**inputs, "fed": fed, "kinds": kinds, "start": np.array(start)})
            newest = outputs["made"][:, -1:]
            frames.append(newest[0, 0])
            if n_frames is None and outputs["last"][0, -1] > 0.0:
                break
            if self.decoding == "without-cache":
                fed, kinds = np.concatenate([fed, newest], axis=1), np.append(kinds, [[FRAME]], axis=1)
            else:
                fed, kinds, start = newest, np.full((1, 1), FRAME), len(frames)
                inputs |= {name.removeprefix("next_"): outputs[name] for name in outputs if name.startswith("next_")}
        return np.stack(frames).astype(np.float64)


class TwoNetworkSystem(PaperSystem):
    """SPSN for the positions and TFGN for the frames: LpTransformer, its ablations, and LPT+."""

    def predict(self, before: FloatArray, after: FloatArray) -> Prediction:
        """Returns the splice. Without Culling, frames are made even if a position is missing."""
        pre, post = self.positions(before, after)
        if self.fr is not None and (pre is None or post is None):
            return Prediction(pre, post, np.zeros((0, self.n_numbers)))
        return Prediction(pre, post, self._make_frames(before, after, pre, post))

    def tokens(self, before: FloatArray, after: FloatArray) -> Array:
        """Returns the logits (N + M, 3) of the tokens."""
        inputs = {"x": as_batch_of_one(np.concatenate([before, after])), "n_before": np.array([len(before)])}
        return np.asarray(self.graphs.run("spsn", inputs)["tokens"][0])

    def fill(self, before: FloatArray, after: FloatArray, pre: int, post: int) -> FloatArray:
        """Returns the transition (n, 159) at given positions."""
        return self._make_frames(before, after, pre, post)

    def predict_fixed(self, before: FloatArray, after: FloatArray, pre: int, post: int, n_frames: int) -> FloatArray:
        """Returns the frames of a prediction with a fixed outcome."""
        self.positions(before, after)
        return self._make_frames(before, after, pre, post, n_frames)

    def _make_frames(
        self, before: FloatArray, after: FloatArray, pre: int | None, post: int | None, n_frames: int | None = None
    ) -> FloatArray:
        if self.fr is None or pre is None or post is None:
            x, mask = np.concatenate([before, after]), np.ones(len(before) + len(after), bool)
        else:
            x, mask = cull(before, after, pre, post, self.fr)
        n_before = len(before) if self.fr is None else self.fr
        inputs: dict[str, Array] = {"x": as_batch_of_one(x), "mask": mask[None], "n_before": np.array([n_before])}
        if self.marked:
            marks = np.zeros((1, len(x), 2), np.float32)  # a token that is not emitted has no mark
            if pre is not None:
                marks[0, pre, 0] = 1.0
            if post is not None:
                marks[0, n_before + post, 1] = 1.0
            inputs["marks"] = marks
        return self._decode(self.graphs.run("encoder", inputs), n_frames)


class OneNetworkSystem(PaperSystem):
    """One network for positions and frames, which reads the whole X: the systems that the paper compares with."""

    def predict(self, before: FloatArray, after: FloatArray) -> Prediction:
        """Returns the splice."""
        encoded = self._encode(before, after)
        pre, post = splice_positions(encoded["tokens"][0], len(before), self.token_bias)
        return Prediction(pre, post, self._decode(encoded))

    def predict_fixed(self, before: FloatArray, after: FloatArray, pre: int, post: int, n_frames: int) -> FloatArray:
        """Returns the frames of a prediction with a fixed outcome; the positions do not affect them."""
        return self._decode(self._encode(before, after), n_frames)

    def tokens(self, before: FloatArray, after: FloatArray) -> Array:
        """Returns the logits (N + M, 3) of the tokens."""
        return np.asarray(self._encode(before, after)["tokens"][0])

    def _encode(self, before: FloatArray, after: FloatArray) -> Mapping[str, Array]:
        """Returns the encoder's outputs."""
        x = np.concatenate([before, after])
        inputs = {"x": as_batch_of_one(x), "mask": np.ones((1, len(x)), bool), "n_before": np.array([len(before)])}
        return self.graphs.run("encoder", inputs)
