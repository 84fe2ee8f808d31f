"""What the training loop trains: a network together with its loss and its scores."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from torch import Tensor, nn


class Task(nn.Module, ABC):
    """A network with its loss; ``forward`` returns the loss, so that ``DistributedDataParallel`` can wrap a task.

    - network: the module that is trained and exported
    """

    network: nn.Module

    @abstractmethod
    def forward(self, batch: Any) -> Tensor:
        """The loss () of a batch."""

    @abstractmethod
    def judge(self, batch: Any) -> dict[str, float]:
        """Scores of a batch by name, means over its pairs."""
