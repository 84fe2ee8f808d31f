"""One of several processes that train toys; train/test_processes.py runs it with RANK, WORLD_SIZE and so on set.

Arguments: folder, module and function that make a toy by name, then what to train: name/call/until each. Every process
has a folder of its own in it, as on machines that share none.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path

import torch

from signsplice_workshop.train import processes
from training_toys import train_example

if __name__ == "__main__":
    torch.set_num_threads(1)
    root, make = Path(sys.argv[1]), getattr(import_module(sys.argv[2]), sys.argv[3])
    with processes.join_process_group("cpu") as process:
        for job in sys.argv[4:]:
            part, call, until = job.split("/")
            folder = root / f"process{process.rank}" / part / call
            seen = train_example(make(part), folder, int(until), process)
            (folder / "seen.json").write_text(json.dumps(seen))
