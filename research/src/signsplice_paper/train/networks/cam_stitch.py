"""LSTM of CAM-STITCH (after Das, Raun and Kjaergaard 2019 [17]).

**Published**, as the paper that cites it says: at known splice positions an LSTM makes the transition frames, which
close the gap. Its title says what it was made for: to stitch cavities in the trajectories that stereo cameras in a
public building record.

**Adapted**: trajectories are those of all joints. Positions come from SPSN.

**Not verified**, because neither its text nor its abstract could be read: sizes, inputs and training. Read so here: a
trajectory network sees the ends of the two trajectories, so one LSTM reads the kept frames of the first word up to the
gap, and one those of the second word backwards to the gap. From both last states a third goes through the gap frame by
frame. Every frame is an offset from the last frame before the gap, as trajectories are commonly predicted relative to
the last point observed; the input is the offset of the frame before, and the offset of the first frame after the gap.
The last frame is told by a token, as in TFGN.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from signsplice_paper.train.networks.generator import FRAME, Encoded, Generator, State
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.recurrent import Lstm


@dataclass(frozen=True)
class CamStitchConfig:
    """Sizes.

    - fr: frames that Culling keeps on each side
    - width: of states and embeddings
    """

    fr: int = 8
    width: int = 512


class CamStitch(Generator):
    """Two LSTM that read up to the gap from both sides, and one that goes through it."""

    concurrent = False

    def __init__(self, config: CamStitchConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, self.n_fed = config.width, normaliser.n_numbers
        self.source, self.embedding = nn.Linear(self.n_fed, width), nn.Linear(2 * self.n_fed, width)
        self.before, self.after, self.gap = Lstm(width, width), Lstm(width, width), Lstm(width, width)
        self.bridge = nn.Linear(2 * width, 2 * width)
        self.kind = nn.Embedding(3, width)
        self.frame, self.last = nn.Linear(width, self.n_fed), nn.Linear(width, 1)

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> Encoded:
        """Memory: the normalised frames (B, 1, K) before and after the gap. State: hidden and cell state (1, B, D).

        Frames repeated at the edges of words are read like others: they are the farthest from the gap.
        """
        fr, x = self.config.fr, self.normaliser(x)
        states = self.source(x)
        before, after = self.before(states[:, :fr])[0][:, -1], self.after(states[:, fr:].flip(1))[0][:, -1]
        hidden, cell = self.bridge(torch.cat([before, after], dim=-1)).chunk(2, dim=-1)
        start = (hidden.tanh()[None].contiguous(), cell[None].contiguous())
        return Encoded(None, (x[:, fr - 1 : fr].contiguous(), x[:, fr : fr + 1].contiguous()), start)

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Frames, logits of the last frame, and the state of the LSTM."""
        origin, end = memory
        shown = (kinds == FRAME)[..., None].to(fed.dtype)
        offsets = shown * (self.normaliser(fed) - origin)
        ends = (end - origin).expand(-1, fed.shape[1], -1)
        inputs = self.kind(kinds) + self.embedding(torch.cat([offsets, ends], dim=-1))
        states, (hidden, cell) = self.gap(inputs, (state[0], state[1]))
        return self.normaliser.inverse(origin + self.frame(states)), self.last(states)[..., 0], (hidden, cell)
