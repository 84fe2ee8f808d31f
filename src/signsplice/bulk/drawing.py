"""Makes recipes: drawn from a lexicon by seed, read from lines of glosses, or of all ordered pairs of its signs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from signsplice.bulk.recipes import ROWS, SentenceRecipe, batch_of
from signsplice.errors import InputError, UnknownGlossError
from signsplice.formats.reading import read_bytes
from signsplice.lexicon.gloss import LETTER_MARK
from signsplice.lexicon.lexicon import Lexicon
from signsplice.lexicon.sentence import SentenceToken, line_glosses, line_warnings, parse

_TILE = 100
"""Side of the square tiles of word pairs, words; tiles keep the number of words in successive pairs small."""
_LONGEST = 500
"""Maximum length of a warning, which quotes its line, characters."""
Range = tuple[float, float]


def signs(lexicon: Lexicon) -> list[str]:
    """Return the glosses of a lexicon's signs, without letters. Raises ``InputError`` if there are fewer than two."""
    glosses = [entry.gloss for entry in lexicon.entries() if entry.kind == "sign"]
    if len(glosses) < 2:
        raise InputError(f"{lexicon.where}: {len(glosses)} signs, expected two or more to draw from")
    return glosses


def random_recipes(
    glosses: Sequence[str],
    count: int,
    n_words: tuple[int, int],
    seed: int,
    signers: Sequence[str] = ("",),
    ranges: Mapping[str, Range] | None = None,
    dials: Mapping[str, Any] | None = None,
) -> Iterator[pa.RecordBatch]:
    """Draw ``count`` recipes of ``n_words`` (minimum, maximum) glosses by ``seed``, without immediate word repeats.

    signers: each recipe draws one. ranges: dials drawn uniformly, to three decimals, with minimum and maximum. dials:
    dials that are the same in all recipes. Row k does not depend on ``count``.
    """
    for start in range(0, count, ROWS):
        rng = np.random.default_rng([seed, start])
        lengths = rng.integers(n_words[0], n_words[1] + 1, ROWS)
        words = rng.integers(0, len(glosses), (ROWS, n_words[1]))
        for column in range(1, n_words[1]):  # replace a word that repeats the previous one
            same = words[:, column] == words[:, column - 1]
            words[same, column] = (words[same, column] + rng.integers(1, len(glosses), same.sum())) % len(glosses)
        who = rng.integers(0, len(signers), ROWS)
        chosen = {name: np.round(rng.uniform(*span, ROWS), 3) for name, span in (ranges or {}).items()}
        yield batch_of(
            SentenceRecipe(
                tuple(glosses[word] for word in words[row, : lengths[row]]),
                signer=signers[who[row]],
                seed=seed,
                **dict(dials or {}),
                **{name: dial(name, values[row]) for name, values in chosen.items()},
            )
            for row in range(min(ROWS, count - start))
        )


def dial(name: str, value: float) -> Any:
    """Return a number as a recipe stores it: as text for dials that may also be words."""
    return f"{value:g}" if name in ("transition_time", "tempo") else float(value)


def lines(
    path: str | Path,
    lexicon: Lexicon,
    dials: Mapping[str, Any] | None = None,
    drop_function_words: bool = False,
    language: str = "en",
    one_language: bool = False,
) -> tuple[list[pa.RecordBatch], list[str]]:
    """Read a recipe from each line of glosses of a text file that is not blank, as ``sentence`` does. Returns warnings
    for lines of which nothing can be signed, or unknown words are not to be spelled, which become failing rows, and for
    words that are spelled or left out.

    Raises ``InputError`` for a line without glosses, and for a file that is not UTF-8 or has no line.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8, expected lines of glosses in UTF-8") from error
    recipes, warnings = [], []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            spell = bool((dials or {}).get("spell", True))
            units = parse(line, lexicon, spell, True, drop_function_words, language, one_language)
            tokens = tuple(_tokens(units))
            said = [*(unit.warning for unit in units if unit.warning), *line_warnings(units, language)]
            warnings += [f"{path}:{number}: {warning[:_LONGEST]}" for warning in said]
        except UnknownGlossError as error:
            tokens = tuple(line.split())
            warnings.append(f"{path}:{number}: {str(error)[:_LONGEST]}")
        except InputError as error:
            raise InputError(f"{path}:{number}: {str(error)[:_LONGEST]}") from error
        recipes.append(SentenceRecipe(tokens, **dict(dials or {})))
    if not recipes:
        raise InputError(f"{path}: no line of glosses, expected one sentence a line")
    return [batch_of(recipes[start : start + ROWS]) for start in range(0, len(recipes), ROWS)], warnings


def _tokens(units: Sequence[SentenceToken]) -> Iterator[str]:
    """Yield the tokens of a line as in ``SentenceRecipe.glosses``, each with its pause mark."""
    glosses = iter(line_glosses(units))
    for unit in filter(lambda unit: unit.glosses, units):
        *_, last = islice(glosses, len(unit.glosses))
        letters = [gloss[len(LETTER_MARK) :].partition("@") for gloss in unit.glosses if gloss.startswith(LETTER_MARK)]
        spelled = [LETTER_MARK + "".join(letter for letter, *_ in letters) + "".join(letters[0][1:])] if letters else []
        *before, final = spelled if unit.spelled and letters else unit.glosses
        yield from (*before, final + (last.pause or ""))


def pairs(
    glosses: Sequence[str], count: int | None = None, seed: int = 0, dials: Mapping[str, Any] | None = None
) -> Iterator[pa.RecordBatch]:
    """Yield all ordered pairs of different glosses, or ``count`` of them drawn by ``seed``, without repeats. Each has
    that seed.

    All pairs come tile by tile, so that any thousand successive pairs have few words. Raises ``InputError`` if there
    are fewer than ``count``.
    """
    n, n_pairs = len(glosses), len(glosses) * (len(glosses) - 1)
    if count is None or count == n_pairs:
        ranks: Iterator[np.ndarray[Any, Any]] = _tiles(n)
    elif 1 <= count <= n_pairs:
        draw = np.random.default_rng(seed).choice(n_pairs, count, replace=False, shuffle=False)
        ranks = iter([np.sort(draw)])
    else:
        raise InputError(f"count {count}, expected 1 to {n_pairs:,}, the ordered pairs of {n:,} signs")
    waiting = np.zeros(0, np.int64)
    for new_ranks in ranks:
        waiting = np.concatenate([waiting, new_ranks])
        while len(waiting) >= ROWS:
            yield _pair_batch(glosses, waiting[:ROWS], seed, dials)
            waiting = waiting[ROWS:]
    if len(waiting):
        yield _pair_batch(glosses, waiting, seed, dials)


def _tiles(n: int) -> Iterator[np.ndarray[Any, Any]]:
    """Yield the ranks of all pairs by bands of tiles. Rank r: word r // (n-1), then the (r % (n-1))-th other word."""
    for top in range(0, n, _TILE):
        before = np.arange(top, min(top + _TILE, n))
        yield np.concatenate(
            [
                (before[:, None] * (n - 1) + np.arange(column, min(column + _TILE, n - 1))).ravel()
                for column in range(0, n - 1, _TILE)
            ]
        )


def _pair_batch(
    glosses: Sequence[str], ranks: np.ndarray[Any, Any], seed: int, dials: Mapping[str, Any] | None
) -> pa.RecordBatch:
    before, rest = np.divmod(ranks, len(glosses) - 1)
    after = rest + (rest >= before)
    same = batch_of([SentenceRecipe(("",), seed=seed, **dict(dials or {}))])
    names = pa.array(glosses, pa.string()).take(pa.array(np.stack([before, after], 1).ravel()))
    offsets = pa.array(np.arange(0, 2 * len(ranks) + 1, 2), pa.int32())
    columns = [pa.ListArray.from_arrays(offsets, names)]
    columns += [pa.repeat(column[0], len(ranks)) for column in same.columns[1:]]
    return pa.RecordBatch.from_arrays(columns, schema=same.schema)
