"""Skeletal graph self-attention, SGSA (after Saunders et al. 2021 [12]).

**Published**, as its abstract says: a sequence is a graph, with joints as nodes and with edges in space and in time;
the features of each joint are kept apart throughout, and a layer of self-attention is given the adjacency matrix of
the graph.

**Adapted**: it reads the culled frames X_c instead of a text. They are a graph as well, so that the encoder has the
same layers, with edges to the frames on both sides, and a joint of the decoder attends to the frames of the same joint
in the encoder. Positions come from SPSN.

**Not verified**, because only the abstract could be read, and read so here: the adjacency matrix masks the attention,
so that a joint attends to itself, to its parent and children in the same frame (bones, in both directions) and to
itself in the nearest frames, and the weights of these sum to 1; frames are made one by one, so that edges in time run
from earlier frames only; joints share their weights and are told apart by a learned vector each; the last frame is
told by a token, as in TFGN.

Shapes: J joints, C numbers of a joint's features; B J joints of all pairs of a batch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from signsplice_paper.train.networks.generator import FRAME, Encoded, Generator, State
from signsplice_paper.train.networks.layers import FeedForward, MultiHead, Normaliser, bones, positional_code


@dataclass(frozen=True)
class SkeletalConfig:
    """Sizes.

    - width: numbers of each joint's state
    - n_heads: attention heads
    - n_encoder_layers: number of encoder layers
    - n_decoder_layers: number of decoder layers
    - inner: width of the feed-forward layers
    - reach: frames to either side to which edges in time lead
    - dropout: probability
    """

    width: int = 64
    n_heads: int = 8
    n_encoder_layers: int = 6
    n_decoder_layers: int = 6
    inner: int = 256
    reach: int = 1
    dropout: float = 0.1


def time_edges(n_new: int, n_past: int, reach: int, both_sides: bool, device: torch.device) -> Tensor:
    """The adjacency matrix (T, P + T) of a joint with itself in other frames up to ``reach`` away, of which ``n_past``
    come before the first query; in earlier frames only, unless ``both_sides``.
    """
    queries = torch.arange(n_new, device=device)[:, None] + n_past
    distances = queries - torch.arange(n_past + n_new, device=device)[None]
    near = (distances <= reach) & (distances != 0)
    return near & (distances >= -reach) if both_sides else near & (distances > 0)


class SkeletalAttention(nn.Module):
    """Multi-head attention of every joint of every frame, masked by the graph's adjacency matrix.

    The matrix over all T J nodes is never made: every node has edges within its frame, or to the same joint.
    """

    adjacency: Tensor

    def __init__(self, parents: Sequence[int], features: int, n_heads: int) -> None:
        super().__init__()
        self.n_heads = n_heads
        self.register_buffer("adjacency", bones(parents), persistent=False)
        self.query, self.key = nn.Linear(features, features), nn.Linear(features, features)
        self.value, self.out = nn.Linear(features, features), nn.Linear(features, features)

    def split(self, x: Tensor) -> Tensor:
        """(B, T, J, C) -> (B, H, J, T, C / H)."""
        return x.reshape(*x.shape[:3], self.n_heads, -1).permute(0, 3, 2, 1, 4)

    def forward(self, x: Tensor, cache: tuple[Tensor, Tensor], near: Tensor) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Z (B, T, J, C) of features (B, T, J, C), and the extended cache.

        cache: keys and values (B, H, J, P, C / H) of earlier frames. near: edges in time; broadcasts to
        (B, H, J, T, P + T).
        """
        queries, keys, values = self.split(self.query(x)), self.split(self.key(x)), self.split(self.value(x))
        queries = queries / math.sqrt(queries.shape[-1])
        past = torch.cat([cache[0], keys], dim=3), torch.cat([cache[1], values], dim=3)
        in_frame, of_frame = keys.transpose(2, 3), values.transpose(2, 3)  # (B, H, T, J, C / H)
        space = (queries.transpose(2, 3) @ in_frame.mT).masked_fill(~self.adjacency, -torch.inf)  # (B, H, T, J, J)
        time = (queries @ past[0].mT).masked_fill(~near, -torch.inf)  # (B, H, J, T, P + T)
        weights = torch.cat([space, time.transpose(2, 3)], dim=-1).softmax(-1)
        n_joints = x.shape[2]
        mixed = weights[..., :n_joints] @ of_frame
        mixed = mixed + (weights[..., n_joints:].transpose(2, 3) @ past[1]).transpose(2, 3)
        return self.out(mixed.permute(0, 2, 3, 1, 4).flatten(-2)), past


class SkeletalLayer(nn.Module):
    """Skeletal attention, attention to the same joint of the encoder in a decoder, and feed-forward; norms come first,
    as in the other Transformers here.
    """

    def __init__(self, config: SkeletalConfig, parents: Sequence[int], reads: bool) -> None:
        super().__init__()
        features = config.width
        self.own = SkeletalAttention(parents, features, config.n_heads)
        self.cross = MultiHead(features, config.n_heads) if reads else None
        self.feed = FeedForward(features, config.inner)
        self.norms = nn.ModuleList(nn.LayerNorm(features) for _ in range(2 + reads))
        self.dropout = nn.Dropout(config.dropout)

    def forward(
        self, x: Tensor, cache: tuple[Tensor, Tensor], near: Tensor, read: tuple[Tensor, Tensor, Tensor] | None = None
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Features (B, T, J, C) for the next layer, and the extended cache.

        read: keys and values (B J, H, S, C / H) of the encoder's frames, and which may be read (B J, 1, 1, S).
        """
        mixed, cache = self.own(self.norms[0](x), cache, near)
        x = x + self.dropout(mixed)
        if self.cross is not None:
            assert read is not None
            by_joint = self.norms[2](x).transpose(1, 2)  # (B, J, T, C)
            found = self.cross(by_joint.flatten(0, 1), *read).reshape(by_joint.shape)
            x = x + self.dropout(found.transpose(1, 2))
        return x + self.dropout(self.feed(self.norms[1](x))), cache


class SkeletalTransformer(Generator):
    """Encoder and decoder of skeletal attention."""

    concurrent = False

    def __init__(self, config: SkeletalConfig, normaliser: Normaliser, parents: Sequence[int]) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        self.n_fed, features = normaliser.n_numbers, config.width
        self.source, self.embedding = nn.Linear(3, features), nn.Linear(3, features)
        self.joints = nn.Parameter(torch.randn(2, len(parents), features) * 0.1)
        self.kind = nn.Embedding(3, features)
        self.encoder = nn.ModuleList(SkeletalLayer(config, parents, False) for _ in range(config.n_encoder_layers))
        self.layers = nn.ModuleList(SkeletalLayer(config, parents, True) for _ in range(config.n_decoder_layers))
        self.read_norm, self.norm = nn.LayerNorm(features), nn.LayerNorm(features)
        self.frame, self.last = nn.Linear(features, 3), nn.Linear(features, 1)

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> Encoded:
        """Memory: frames that may be read (B J, 1, 1, S), then keys and values (B J, H, S, C / H) of each decoder
        layer. State: empty caches (B, H, J, 0, C / H).
        """
        config, n_joints, n_frames = self.config, self.n_fed // 3, x.shape[1]
        states = self.source(self.normaliser(x).unflatten(-1, (n_joints, 3))) + self.joints[0]
        states = states + self._code(torch.arange(n_frames, device=x.device))
        near = time_edges(n_frames, 0, config.reach, True, x.device) & mask[:, None, None, None, :]
        empty = states.new_zeros(len(x), config.n_heads, n_joints, 0, config.width // config.n_heads)
        for layer in self.encoder:
            states, _ = layer(states, (empty, empty), near)
        by_joint = self.read_norm(states).transpose(1, 2).flatten(0, 1)  # (B J, S, C)
        memory = [mask[:, None].expand(-1, n_joints, -1).reshape(-1, 1, 1, n_frames)]
        for layer in self.layers:
            assert isinstance(layer, SkeletalLayer)
            assert layer.cross is not None
            memory += layer.cross.keys_values(by_joint)
        return Encoded(None, tuple(memory), (empty,) * (2 * len(self.layers)))

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Frames, logits of the last frame from the mean over joints, and extended caches."""
        n_joints, n_new, n_past = self.n_fed // 3, fed.shape[1], state[0].shape[3]
        shown = (kinds == FRAME)[..., None, None].to(fed.dtype)
        x = shown * self.embedding(self.normaliser(fed).unflatten(-1, (n_joints, 3))) + self.joints[1]
        x = x + self.kind(kinds)[:, :, None] + self._code(start + torch.arange(n_new, device=fed.device))
        near = time_edges(n_new, n_past, self.config.reach, False, fed.device)
        caches: list[Tensor] = []
        for k, layer in enumerate(self.layers):
            read = (memory[2 * k + 1], memory[2 * k + 2], memory[0])
            x, cache = layer(x, (state[2 * k], state[2 * k + 1]), near, read)
            caches += cache
        x = self.norm(x)
        return self.normaliser.inverse(self.frame(x).flatten(-2)), self.last(x.mean(2))[..., 0], tuple(caches)

    def _code(self, positions: Tensor) -> Tensor:
        """The positional code (T, 1, C) of frames, the same for all joints."""
        return positional_code(positions, self.config.width)[:, None]
