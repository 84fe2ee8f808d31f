"""Mixture density network on a Progressive Transformer (after Saunders et al. 2021 [9]).

**Published**, as its abstract says: a Progressive Transformer, whose counter tracks the progress and predicts the end
of the sequence, with augmentations against drift, an adversarial training, and a mixture density network at its output
for realistic and expressive sequences. A mixture density network (Bishop 2006, equations 5.148 to 5.153) maps the last
states to mixing coefficients by a softmax, to centres linearly, and to the widths of isotropic Gaussians by an
exponential, and is trained by the negative logarithm of the likelihood.

**Adapted**: it reads the culled frames X_c instead of a text, positions come from SPSN, and its augmentations are
those of the Progressive Transformer here. The adversarial training is left out.

**Not verified**, because the equations of the article could not be read and its public code has the Progressive
Transformer alone: the number of components (here 4), whether all numbers of a frame share a width (here they do, as in
Bishop), whether the counter is part of the mixture (here it is not), and what is fed back and returned at run time.
Here it is the centre of the component with the largest coefficient, not a sample: the same pair always has the same
frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from signsplice_paper.train.networks.generator import Encoded
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.tfgn import Transformer, TransformerConfig

WIDTH_FLOOR = 0.1
"""Added to every width, in deviations of the training pairs: a width of 0 has an infinite likelihood. As large as the
noise on the frames that are fed.
"""


@dataclass(frozen=True)
class MixtureConfig(TransformerConfig):
    """Sizes and design.

    - counter: decoding is progressive
    - n_components: Gaussians of the mixture of a frame
    """

    counter: bool = True
    n_components: int = 4


class Mixture(NamedTuple):
    """M isotropic Gaussians for each normalised frame of K numbers.

    - logits: of the mixing coefficients (..., M)
    - centres: (..., M, K)
    - widths: (..., M)
    """

    logits: Tensor
    centres: Tensor
    widths: Tensor

    def log_likelihood(self, frames: Tensor) -> Tensor:
        """The logarithms of the densities (...) at normalised frames (..., K)."""
        n_numbers = frames.shape[-1]
        distances = ((frames[..., None, :] - self.centres) / self.widths[..., None]).square().sum(-1)  # (..., M)
        norms = n_numbers * (self.widths.log() + 0.5 * math.log(2.0 * math.pi))
        return torch.logsumexp(self.logits.log_softmax(-1) - norms - 0.5 * distances, dim=-1)

    def likeliest(self) -> Tensor:
        """The centres (..., K) of the components with the largest coefficient."""
        best = self.logits.argmax(-1)[..., None, None].expand(*self.centres.shape[:-2], 1, self.centres.shape[-1])
        return self.centres.gather(-2, best)[..., 0, :]


class MixtureHead(nn.Module):
    """Maps states (..., D) to a mixture for each frame of K numbers."""

    def __init__(self, width: int, n_numbers: int, n_components: int) -> None:
        super().__init__()
        self.n_components = n_components
        self.coefficient, self.width = nn.Linear(width, n_components), nn.Linear(width, n_components)
        self.centre = nn.Linear(width, n_components * n_numbers)

    def mixture(self, states: Tensor) -> Mixture:
        """The mixtures of states (..., D)."""
        logits, widths, centres = self.coefficient(states), self.width(states), self.centre(states)
        centres = centres.unflatten(-1, (self.n_components, -1))
        return Mixture(logits.float(), centres.float(), widths.float().exp() + WIDTH_FLOOR)  # likelihoods need float32

    def forward(self, states: Tensor) -> Tensor:
        """Normalised frames (..., K): the centres of the likeliest components."""
        return self.mixture(states).likeliest()


class MixtureTransformer(Transformer):
    """A Progressive Transformer whose frames are the likeliest centres of mixtures."""

    def __init__(self, config: MixtureConfig, normaliser: Normaliser) -> None:
        super().__init__(config, normaliser)
        self.frame: MixtureHead = MixtureHead(config.width, normaliser.n_numbers, config.n_components)

    def mixtures(self, encoded: Encoded, fed: Tensor, kinds: Tensor) -> tuple[Mixture, Tensor]:
        """The mixtures of all frames (B, T), normalised, and their counters (B, T), given the true frames."""
        start = torch.zeros((), dtype=torch.long, device=fed.device)
        states, _ = self.decoder_states(fed, kinds, start, encoded.memory, encoded.state)
        return self.frame.mixture(states), torch.sigmoid(self.last(states))[..., 0]
