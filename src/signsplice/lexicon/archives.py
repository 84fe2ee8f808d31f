"""Recipes for archives: which file of a folder is which word, and which of several recordings of a word is taken.

A recipe is a pattern of paths. Its group ``gloss`` is needed; ``variant``, ``alt`` and ``spelled`` tell recordings of
one gloss apart; of those that are left, the newest ``date`` wins, then the highest ``take``, then the first ``kind``.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signsplice.errors import FormatError, InputError
from signsplice.formats.json_files import read_json
from signsplice.lexicon.entry import gloss_of
from signsplice.lexicon.glosses import GlossRow

_GROUPS = ("gloss", "variant", "alt", "spelled", "date", "take", "kind")
_SHAPE = 'an object such as {"pattern": "(?P<gloss>[^/]+)_v(?P<variant>[0-9]+)", "kinds": ["Full", "Mini"]}'


@dataclass(frozen=True)
class ArchiveRecipe:
    """How an archive names its files.

    pattern: matches the end of a file's path in the archive, without its suffix, by some of ``_GROUPS``.
    kinds: what the group ``kind`` may be, best first: other forms of one recording.
    unread: how the names of files end that hold more of a word and are not read, and why not.
    """

    pattern: re.Pattern[str]
    kinds: tuple[str, ...] = ()
    unread: tuple[str, str] = ("", "")


def _recipe(pattern: str, *kinds: str, unread: tuple[str, str] = ("", "")) -> ArchiveRecipe:
    return ArchiveRecipe(re.compile(f"(?:^|.*/){pattern}$", re.DOTALL), kinds, unread)


RECIPES = {
    "flat": _recipe(r"(?P<gloss>[^/]+)"),
    "dated": _recipe(r"(?P<gloss>[^/]+?)(?:-(?P<variant>[A-Z]))?_(?P<date>\d{6})_(?P<take>\d+)"),
    "studiogalt": _recipe(
        r"SG \w+ (?P<gloss>[^/]+?)(?: (?:(?P<variant>\d+)|(?P<alt>\(Alt\))|(?P<spelled>Fingerspelling)))*"
        r" (?P<date>\d{4}-\d{1,2}-\d{1,2})(?: Upload)?/[^/]* No Mesh (?P<kind>[^/ ]+)",
        "Full", "Mini", "Mixamo",
        unread=("ShapeKeys.txt", "no source names their numbers; they stay beside the recordings"),
    ),
}  # fmt: skip
"""The recipes that ship: NAME; NAME-A_241127_1; and folders such as ``SG ASL Abhor 2 2023-2-4 Upload``."""


@dataclass(frozen=True)
class Recording:
    """A word of an archive.

    row: gloss, synonyms and the rest.
    paths: its file, and others of the same word that are read where it is broken, best first.
    """

    row: GlossRow
    paths: tuple[Path, ...]


def find_recipe(name: str) -> ArchiveRecipe:
    """The recipe of a name in ``RECIPES``, or in a file. Raises ``InputError`` where there is none."""
    if name in RECIPES:
        return RECIPES[name]
    if Path(name).suffix.lower() != ".json":
        expected = f"expected {', '.join(RECIPES)}, a .csv table or a .json file"
        raise InputError(f"recipe {name!r:.80}, {expected}")
    loaded = read_json(name, _SHAPE)
    kinds = loaded.get("kinds", []) if isinstance(loaded, dict) else None
    pattern = loaded.get("pattern") if isinstance(loaded, dict) else None
    if not isinstance(pattern, str) or not isinstance(kinds, list) or not all(isinstance(kind, str) for kind in kinds):
        raise FormatError(f"is no recipe, expected {_SHAPE}", file=name)
    try:
        recipe = _recipe(pattern, *kinds)
    except re.error as error:
        raise FormatError(f"pattern: {error}", file=name) from error
    groups = recipe.pattern.groupindex
    if "gloss" not in groups or not {*groups} <= {*_GROUPS}:
        raise FormatError(
            f"pattern names {', '.join(groups) or 'no groups'}, expected gloss and {', '.join(_GROUPS[1:])}", file=name
        )
    return recipe


def recordings(folder: Path, files: Iterable[Path], recipe: ArchiveRecipe) -> tuple[list[Recording], list[str]]:
    """The words of an archive by gloss, and a line for each file and folder that gives none."""
    found: defaultdict[tuple[str, str], list[tuple[Any, Path]]] = defaultdict(list)
    used, left_out = set(), []
    for path in files:
        used.add(path.parent)
        name = path.relative_to(folder).as_posix()
        match = recipe.pattern.match(name.removesuffix(path.suffix))
        if match is None:
            left_out.append(f"{path}: its path does not fit the recipe")
            continue
        groups = match.groupdict()
        try:
            gloss = gloss_of(groups["gloss"].replace("_", " "))
        except InputError as error:
            left_out.append(f"{path}: {error}")
            continue
        parts = [groups.get("variant"), groups.get("alt") and "ALT", groups.get("spelled") and "SPELLED"]
        found[gloss, "-".join(filter(None, parts))].append((_preference(groups, recipe.kinds), path))
    left_out += [f"{empty}: holds no clip" for empty in sorted(_leaves(folder) - used)]
    glosses = {gloss for gloss, variant in found if not variant}
    words = []
    for gloss, variant in sorted(found, key=lambda key: (key[0], len(key[1]), key[1])):
        paths = [path for _, path in sorted(found[gloss, variant], key=lambda ranked: ranked[0], reverse=True)]
        name = f"{gloss}-{variant}" if variant else gloss
        synonyms = (gloss,) if gloss not in glosses else ()
        glosses.add(gloss)  # the first variant of a gloss is found by the gloss alone
        source = paths[0].relative_to(folder).as_posix()
        words.append(Recording(GlossRow(source, name, synonyms, source=source), tuple(paths)))
    return words, left_out


def unread(folder: Path, recipe: ArchiveRecipe) -> tuple[str, ...]:
    """A line about the files of an archive that hold more of its words and are not read; none where there are none."""
    end, reason = recipe.unread
    count = sum(name.endswith(end) for _, _, names in os.walk(folder) for name in names) if end else 0
    return (f"{count} files ...{end} not read: {reason}",) if count else ()


def _preference(groups: dict[str, str | None], kinds: Sequence[str]) -> tuple[list[int], int, int]:
    """What a better recording of a word has more of: a later date, a higher take, an earlier kind."""
    date = [int(number) for number in re.findall(r"\d+", groups.get("date") or "")]
    kind = groups.get("kind")
    return date, int(groups.get("take") or 0), -kinds.index(kind) if kind in kinds else -len(kinds)


def _leaves(folder: Path) -> set[Path]:
    """The folders below one that hold files; without hidden ones."""
    found = set()
    for parent, subfolders, names in os.walk(folder):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        if names and Path(parent) != folder:
            found.add(Path(parent))
    return found
