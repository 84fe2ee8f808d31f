"""How near the true cuts of a corpus are to another frame: the rules of ``truth`` give times between frames, which are
then rounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from signsplice.synth import planner, truth
from signsplice.synth.corpus import VERSION, Pairs
from signsplice.synth.phonology import Sign


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
                out[number] = min(leave.margin, enter.margin)
    return out
