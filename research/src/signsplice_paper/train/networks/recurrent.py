"""An LSTM that is torch's in training and becomes ONNX's LSTM operator, for any length, when exported."""

from __future__ import annotations

import torch
from torch import Tensor, nn

_OPSET = 14
"""The version of ONNX's LSTM operator."""


class Lstm(nn.Module):
    """One LSTM layer (eq. 4, 5) with batches first.

    Eq. 5 prints C_t = F_t * W_xc + I_t * C~_t; the LSTM is C_t = F_t * C_{t-1} + I_t * C~_t.
    """

    def __init__(self, n_inputs: int, width: int) -> None:
        super().__init__()
        self.width = width
        self.cells = nn.LSTM(n_inputs, width, batch_first=True)

    def forward(self, x: Tensor, state: tuple[Tensor, Tensor] | None = None) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Hidden states (B, S, D) of inputs (B, S, n_inputs), and the last hidden and cell state, each (1, B, D)."""
        if torch.compiler.is_exporting():
            return self._symbolic(x, state)
        if x.device.type != "cpu":
            states, last = self.cells(x, state)
            return states, last
        with torch.autocast("cpu", enabled=False):  # torch has no bf16 LSTM gradient on CPUs
            states, last = self.cells(x.float(), None if state is None else (state[0].float(), state[1].float()))
        return states, last

    def _symbolic(self, x: Tensor, state: tuple[Tensor, Tensor] | None) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        n_batch, n_frames = x.shape[0], x.shape[1]
        if state is None:
            state = (x.new_zeros(1, n_batch, self.width), x.new_zeros(1, n_batch, self.width))
        # Input weights, hidden weights, and the biases of both.
        ordered = [_onnx_order(weights) for weights in self.cells.parameters()]
        weights, bias = [ordered[0][None], ordered[1][None]], torch.cat(ordered[2:])[None]
        ends = (1, n_batch, self.width)
        states, hidden, cell = torch.onnx.ops.symbolic_multi_out(
            "LSTM",
            (x.transpose(0, 1), *weights, bias, None, *state),
            {"hidden_size": self.width},
            dtypes=(x.dtype, x.dtype, x.dtype),
            shapes=((n_frames, 1, n_batch, self.width), ends, ends),
            version=_OPSET,
        )
        return states[:, 0].transpose(0, 1), (hidden, cell)


def _onnx_order(weights: Tensor) -> Tensor:
    """Weights (4 D, ...) with the gates in ONNX's order (input, output, forget, cell), from torch's (input, forget,
    cell, output).
    """
    i, f, g, o = weights.chunk(4)
    return torch.cat([i, o, f, g])
