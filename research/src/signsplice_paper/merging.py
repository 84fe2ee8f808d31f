"""Results that were judged apart, on several machines or in several processes, as one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice_paper import kept_frames, results
from signsplice_paper.results import Results


def merge(folders: Sequence[Path], out: Path) -> tuple[int, Results]:
    """Add the rows, curves and kept frames of ``folders`` to those in ``out``: how many rows the folders hold, and all
    results. Of rows of one key the last folder's stays, and a folder's replaces that in ``out``.

    Raises ``InputError`` where a folder has no results.json.
    """
    known, n_rows = results.load(out / results.FILE), 0
    kept = kept_frames.load(out / kept_frames.FILE)
    for folder in folders:
        if not (folder / results.FILE).is_file():
            raise InputError(
                f"{folder / results.FILE}: not there; expected a folder that `signsplice-paper judge` wrote into"
            )
        added = results.load(folder / results.FILE)
        signatures = {**known.signatures, **added.signatures}
        known = Results(known.rows, known.curves, signatures).merge(added.rows, added.curves)
        n_rows += len(added.rows)
        frames = kept_frames.load(folder / kept_frames.FILE)
        kept = kept_frames.merge(frames, kept) if kept else frames
    results.save(known, out / results.FILE)
    if kept:
        kept_frames.save(kept, out / kept_frames.FILE)
    return n_rows, known
