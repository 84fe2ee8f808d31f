"""Merges results that were judged separately, on several machines or in several processes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice_paper import kept_frames, results
from signsplice_paper.results import Results


def merge(folders: Sequence[Path], output_folder: Path) -> tuple[int, Results]:
    """Adds the rows, curves and kept frames of ``folders`` to those in ``output_folder``; returns the number of rows in
    the folders, and all results. Of rows of one key the last folder's stays, and a folder's replaces that in
    ``output_folder``.

    Raises ``InputError`` if a folder has no results.json.
    """
    known, n_rows = results.load(output_folder / results.FILE), 0
    figure_pairs = kept_frames.load(output_folder / kept_frames.FILE)
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
        figure_pairs = kept_frames.merge(frames, figure_pairs) if figure_pairs else frames
    results.save(known, output_folder / results.FILE)
    if figure_pairs:
        kept_frames.save(figure_pairs, output_folder / kept_frames.FILE)
    return n_rows, known
