"""Recipes -> sentences, in one process that reads every word once."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from signsplice.body.retarget import retarget
from signsplice.bulk.recipes import SentenceRecipe
from signsplice.errors import InputError, SignspliceError
from signsplice.lexicon.gloss import Entry
from signsplice.lexicon.lexicon import Lexicon
from signsplice.lexicon.sentence import SentenceToken, parse
from signsplice.motion import Clip
from signsplice.splicing import report as reports
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.engine import splice
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.result import SpliceResult
from signsplice.splicing.word import Word, words_of

WORDS_KEPT = 2048
"""Words that a process keeps, with what the networks read of them; the one used longest ago gives way."""


@dataclass(frozen=True, eq=False)
class MadeSentence:
    """A sentence made from a recipe.

    recipe: what it was made from.
    result: what the engine gives.
    tokens: how each gloss of the recipe was signed.
    signer: who signs: the recipe's, or the first word's.
    """

    recipe: SentenceRecipe
    result: SpliceResult
    tokens: tuple[SentenceToken, ...]
    signer: str

    @property
    def motion_sha256(self) -> str:
        """Hash of the clip's numbers, bit for bit, whatever file they are written to."""
        return motion_sha256(self.result.clip)

    def report(self) -> dict[str, Any]:
        """The report of the splice with keys ``units``, as ``sentence`` writes them, and ``recipe``. Times are left out
        of it: they would differ each time that the same sentence is made.
        """
        described = reports.describe(self.result) | {"timing_ms": {}}
        units = [reports.plain(asdict(token)) for token in self.tokens]
        return described | {"units": units, "recipe": reports.plain(asdict(self.recipe))}


@dataclass(frozen=True, eq=False)
class FailedSentence:
    """A recipe of which no sentence could be made.

    recipe: what it was.
    reason: why not, one line.
    """

    recipe: SentenceRecipe
    reason: str


@dataclass(frozen=True, eq=False)
class _SentenceCall:
    """A call of the engine."""

    words: list[Word]
    options: SpliceOptions
    tokens: tuple[SentenceToken, ...]


def motion_sha256(clip: Clip) -> str:
    """Hash of a clip's rate, rotations, root positions, translations and face, bit for bit."""
    digest = hashlib.sha256(f"{clip.fps!r} {clip.local_rotations.shape}".encode())
    for array in (clip.local_rotations, clip.root_positions, clip.translations):
        if array is not None:
            digest.update(array.tobytes())
    if clip.face is not None:
        digest.update(" ".join(clip.face.channels).encode() + clip.face.weights.tobytes())
    return digest.hexdigest()


class SentenceMaker:
    """Makes sentences of recipes with one lexicon and one bundle of networks.

    words: the lexicon.
    bundle: folder of the networks; None: those that ship.
    """

    def __init__(self, words: Lexicon, bundle: str | None = None, n_kept: int = WORDS_KEPT) -> None:
        self.words, self.bundle, self._n_kept = words, bundle, n_kept
        self._clips: OrderedDict[tuple[str, str], Clip] = OrderedDict()
        self._bodies: dict[str, Clip] = {}

    def make(self, recipes: Sequence[SentenceRecipe]) -> list[MadeSentence | FailedSentence]:
        """What becomes of each recipe, in order; the result does not depend on those beside it.

        Errors of the machine (no memory, no disk) are raised, since they say nothing about a recipe.
        """
        made: list[MadeSentence | FailedSentence | None] = [None] * len(recipes)
        calls: dict[int, _SentenceCall] = {}
        for row, recipe in enumerate(recipes):
            try:
                calls[row] = self._call(recipe)
            except (MemoryError, OSError):
                raise
            except Exception as error:
                made[row] = FailedSentence(recipe, self._reason(error))
        for row, result in zip(calls, _results(list(calls.values())), strict=True):
            if isinstance(result, Exception):
                made[row] = FailedSentence(recipes[row], self._reason(result))
            else:
                recipe, tokens = recipes[row], calls[row].tokens
                signer = recipe.signer or self.words.entry(tokens[0].glosses[0]).signer
                made[row] = MadeSentence(recipe, result, tokens, signer)
        return [one for one in made if one is not None]

    def _reason(self, error: Exception) -> str:
        """Why there is no sentence, in one line that does not hang on where the lexicon lies."""
        text = " ".join(str(error).splitlines())
        for where in (self.words.where, *(source.path for source in self.words.sources)):
            text = text.replace(f"{where}: ", "")
        return text[:500] if isinstance(error, SignspliceError) else f"unexpected {type(error).__name__}: {text[:500]}"

    def _call(self, recipe: SentenceRecipe) -> _SentenceCall:
        tokens = tuple(self._tokens(recipe))
        options = recipe.options(self.bundle)
        options.choose_methods()  # raises for a method that there is not
        words = words_of(tokens, lambda gloss: self._clip(gloss, recipe.signer), recipe.pauses)
        return _SentenceCall(words, options, tokens)

    def clips(self, recipe: SentenceRecipe) -> list[Clip]:
        """The clips of a recipe's words, in order."""
        return [self._clip(gloss, recipe.signer) for token in self._tokens(recipe) for gloss in token.glosses]

    def _tokens(self, recipe: SentenceRecipe) -> list[SentenceToken]:
        """How each gloss of a recipe is signed: as one that the lexicon has, or spelled."""
        if not recipe.glosses:
            raise InputError("no glosses, expected at least one")
        found: list[SentenceToken] = []
        for gloss in recipe.glosses:
            if gloss in self.words:
                found.append(SentenceToken(gloss, (self.words.entry(gloss).gloss,)))
            else:
                found += parse(gloss, self.words, spell=recipe.spell, compounds=False)
        return found

    def _clip(self, gloss: str, signer: str) -> Clip:
        """The clip of a gloss on the body of a signer, the same object as long as it is kept."""
        key = (gloss, signer)
        if key not in self._clips:
            clip = self.words.clip(gloss)
            if signer and self.words.entry(gloss).signer != signer:
                clip = replace(retarget(clip, self._body(signer)).clip, name=clip.name)
            self._clips[key] = clip
            while len(self._clips) > self._n_kept:
                self._clips.popitem(last=False)
        self._clips.move_to_end(key)
        return self._clips[key]

    def _body(self, signer: str) -> Clip:
        """A clip on the body of a signer: that of the first of the signer's glosses."""
        if signer not in self._bodies:
            first: Entry | None = next((entry for entry in self.words.entries() if entry.signer == signer), None)
            if first is None:
                known = sorted({entry.signer for entry in self.words.entries()})
                raise InputError(f"signer {signer[:40]!r}, expected one of the lexicon's: {', '.join(known)[:200]}")
            self._bodies[signer] = self.words.clip(first.gloss)
        return self._bodies[signer]


def _results(calls: Sequence[_SentenceCall]) -> Sequence[SpliceResult | Exception]:
    """What the engine gives of each call, or why it gives nothing."""
    try:
        return splice_many([call.words for call in calls], [call.options for call in calls])
    except (MemoryError, OSError):
        raise
    except Exception:  # a bug that one sentence brings out; the others are made without it
        return [_alone(call) for call in calls]


def _alone(call: _SentenceCall) -> SpliceResult | Exception:
    try:
        return splice(call.words, call.options)
    except (MemoryError, OSError):
        raise
    except Exception as error:
        return error
