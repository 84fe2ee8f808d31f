"""One of several processes that train a toy together; train/test_loop.py runs it with RANK, WORLD_SIZE and so on set.

Arguments: part, steps, folder for checkpoint and log.
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch

from signsplice.train import processes
from signsplice.train.loop import LoopConfig, train
from training_toys import CONFIGS, data, toy

if __name__ == "__main__":
    torch.set_num_threads(1)
    part, steps, folder = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    fr = CONFIGS[part][1]
    with processes.joined("cpu") as process:
        loop = LoopConfig(steps, 8, "adamw", 1e-2, seed=4, every=steps)
        train(toy(part), loop, data("train", fr), data("valid", fr), folder, "toy", process)
