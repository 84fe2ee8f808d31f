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
        """Returns the hidden states (B, S, D) of inputs (B, S, n_inputs), and the last hidden and cell state, each
        (1, B, D).
        """
        if torch.compiler.is_exporting():
            return self._run_operator(x, state)
        if x.device.type != "cpu":
            states, last = self.cells(x, state)
            return states, last
        with torch.autocast("cpu", enabled=False):  # torch has no bf16 LSTM gradient on CPUs
            states, last = self.cells(x.float(), None if state is None else (state[0].float(), state[1].float()))
        return states, last

    def _run_operator(self, x: Tensor, state: tuple[Tensor, Tensor] | None) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        n_batch, n_frames = x.shape[0], x.shape[1]
        if state is None:
            state = (x.new_zeros(1, n_batch, self.width), x.new_zeros(1, n_batch, self.width))
        # Input weights, hidden weights, and the biases of both.
        onnx_weights = [_to_onnx_order(weights) for weights in self.cells.parameters()]
        weights, bias = [onnx_weights[0][None], onnx_weights[1][None]], torch.cat(onnx_weights[2:])[None]
        state_shape = (1, n_batch, self.width)
        states, hidden, cell = torch.onnx.ops.symbolic_multi_out(
            "LSTM",
            (x.transpose(0, 1), *weights, bias, None, *state),
            {"hidden_size": self.width},
            dtypes=(x.dtype, x.dtype, x.dtype),
            shapes=((n_frames, 1, n_batch, self.width), state_shape, state_shape),
            version=_OPSET,
        )
        return states[:, 0].transpose(0, 1), (hidden, cell)


def _to_onnx_order(weights: Tensor) -> Tensor:
    """Returns weights (4 D, ...) with the gates in ONNX's order (input, output, forget, cell), from torch's (input,
    forget, cell, output).
    """
    input_gate, forget_gate, cell_gate, output_gate = weights.chunk(4)
    return torch.cat([input_gate, output_gate, forget_gate, cell_gate])
