"""Bundles of the paper's systems: reads the bundles of a folder, and takes the facts of result rows and curves from
them.
"""

from __future__ import annotations

import json
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.reading import read_bytes
from signsplice.splicing.bundle import BUNDLE_FILE, bundle_sha256
from signsplice_paper import published
from signsplice_paper.configs import PaperConfig, parse_config
from signsplice_paper.results import ResultRow


def read_all(bundles: Path) -> list[PaperConfig]:
    """Returns the configurations of all bundles in a folder, sorted by name.

    Bundles of other versions are included; opening one raises ``InputError``. So does reading an invalid bundle.json.
    """
    return [_read_bundle_config(path) for path in sorted(bundles.glob(f"*/{BUNDLE_FILE}"))] if bundles.is_dir() else []


def _read_bundle_config(path: Path) -> PaperConfig:
    try:
        return parse_config(json.loads(read_bytes(path)), path)
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error})") from error


def make_result_row(config: PaperConfig) -> ResultRow:
    """Returns a bundle's row without split and scores. Raises ``InputError`` if bundle.json lacks a field."""
    fields = ("system", "scale", "optimiser", "seed", "steps", "corpus")
    config.require(*fields)
    values = {name: getattr(config, name) for name in fields}
    bias = None if config.runs is None else config.runs.token_bias
    stopped = str(config.stored.get("stopped", ""))
    return ResultRow(
        split="",
        **values,
        stopped=stopped,
        fr=config.fr,
        n_parameters=config.n_parameters,
        token_bias=bias,
        condition=_find_condition(config),
        bundle=compute_short_hash(config),
    )


def _find_condition(config: PaperConfig) -> str:
    is_plain = any(part.get("plain_loss") for part in config.stored.get("parts", {}).values())
    return published.AS_PRINTED if is_plain else published.EQUAL


def compute_short_hash(config: PaperConfig) -> str:
    """Returns the first twelve hex digits of a bundle's sha256."""
    return bundle_sha256(config.path.parent)[:12]
