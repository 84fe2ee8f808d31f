"""margins.json: how near every judged true cut is to another frame: the rules of ``synth.truth`` give times between
frames, which are then rounded. Its words are planned anew once, in minutes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.reading import read_bytes
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice_workshop.corpora import truth
from signsplice_workshop.corpora.pairs import VERSION, Pairs

FILE = "margins.json"
DIGITS = 4


def known(path: Path, pairs: Pairs) -> dict[int, float | None]:
    """The margins in a file by pair, None for those that cannot be known; empty if there is none or it is of another
    corpus.
    """
    if not path.exists():
        return {}
    try:
        stored = json.loads(read_bytes(path))
        if stored["corpus"] != pairs.head["hash"]:
            return {}
        return {int(number): None if margin is None else float(margin) for number, margin in stored["margins"].items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: holds no margins ({error}); remove it") from error


def of_pairs(
    path: Path, pairs: Pairs, numbers: Sequence[int], report: Callable[[str], object] = lambda _: None
) -> dict[int, float]:
    """The margins of these pairs, from a file, or made and stored there.

    Pairs whose words cannot be planned anew have none, such as those of a user's own words; nor have those of a truth
    that rounds nothing.
    """
    if pairs.truth_kind == "events":
        return {}
    found = known(path, pairs)
    signs = {**notation.everyday(), **notation.alphabet()}
    glosses = [word["gloss"] for word in pairs.head["words"]]
    todo = [
        k
        for k in sorted(set(numbers) - found.keys())
        if {glosses[p] for p in pairs.index[k, :2].tolist()} <= signs.keys()
    ]
    if todo:
        report(f"planning the words of {len(todo)} pairs anew")
        made = cut_margins(pairs, todo, signs)
        found |= {k: round(made[k], DIGITS) if k in made else None for k in todo}
        stored = {"corpus": pairs.head["hash"], "margins": {str(k): found[k] for k in sorted(found)}}
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(stored) + "\n", encoding="utf-8")
    return {k: margin for k in numbers if (margin := found.get(k)) is not None}


def margin(cut: truth.CutTime) -> float:
    """By how many frames a cut would have to move to be rounded to another frame, at most 0.5."""
    past, part = divmod(abs(cut.frames), 1.0)
    if not cut.towards_posture:
        return abs(0.5 - part)
    return min(1.0 - part, part if past else 0.5, 0.5)


def cut_margins(pairs: Pairs, numbers: Sequence[int], signs: Mapping[str, Sign]) -> dict[int, float]:
    """By how many frames (at most 0.5) the nearer of both cuts of a pair would have to move to become another frame.

    The words are planned anew from their signs. Pairs with a word that ``signs`` lacks, or that is planned otherwise
    today, are left out; so are all pairs of a corpus that this code does not make.
    """
    if pairs.version != VERSION or not pairs.signers:
        return {}
    used = sorted(set(pairs.index[list(numbers), :2].ravel().tolist()))
    n_per_signer = len(pairs.head["words"]) // 2
    words = {
        k: planner.isolated(signs[gloss], pairs.signers[k // n_per_signer], fps=pairs.head["fps"])
        for k, gloss in ((k, pairs.head["words"][k]["gloss"]) for k in used)
        if gloss in signs
    }
    out = {}
    for number in numbers:
        p, q, pre, post = pairs.index[number, :4].tolist()
        if p in words and q in words:
            relation = truth.relate(words[p], words[q]) if pairs.by_partner else truth.ANY_PARTNER
            leave, enter = truth.leaving(words[p], relation), truth.entering(words[q], relation)
            if (leave.frame, enter.frame) == (pre, post):
                out[number] = min(margin(leave), margin(enter))
    return out
