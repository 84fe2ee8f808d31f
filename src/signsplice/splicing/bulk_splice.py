"""Many sentences spliced in one process."""

from __future__ import annotations

from collections.abc import Sequence

from signsplice.errors import SignspliceError
from signsplice.motion.clip import Clip
from signsplice.splicing.engine import splice
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.result import SpliceResult


def splice_many(
    sentences: Sequence[Sequence[Clip]], options: Sequence[SpliceOptions] | SpliceOptions | None = None
) -> list[SpliceResult | SignspliceError]:
    """What ``splice`` gives of each sentence alone, in order; where it raises a ``SignspliceError``, that error.

    options: of all sentences, or of each. Clips that are one word should be one object in all sentences: what is
    computed of a word is kept as long as that object lives. Raises ``ValueError`` where there are not as many options
    as sentences.
    """
    each = [options] * len(sentences) if options is None or isinstance(options, SpliceOptions) else list(options)
    out: list[SpliceResult | SignspliceError] = []
    for clips, chosen in zip(sentences, each, strict=True):
        try:
            out.append(splice(clips, chosen))
        except SignspliceError as error:
            out.append(error)
    return out
