"""One of several processes that train toys; train/test_processes.py runs it with RANK, WORLD_SIZE and so on set.

Arguments: folder, then what to train: part/call/until each. Every process has a folder of its own in it, as on machines
that share none.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import torch

from signsplice.train import processes
from training_toys import train_example

if __name__ == "__main__":
    torch.set_num_threads(1)
    root = Path(sys.argv[1])
    with processes.joined("cpu") as process:
        for job in sys.argv[2:]:
            part, call, until = job.split("/")
            folder = root / f"process{process.rank}" / part / call
            seen = train_example(part, folder, int(until), process)
            (folder / "seen.json").write_text(json.dumps(seen))
