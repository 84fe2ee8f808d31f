"""Makes sentences from recipes, in one process that reads every word once."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
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
"""Maximum number of words that a process keeps, with their network features; drops the least recently used."""


@dataclass(frozen=True, eq=False)
class MadeSentence:
    """A sentence made from a recipe.

    recipe: its recipe.
    result: the engine's result.
    tokens: how each gloss of the recipe was signed.
    signer: who signs: the recipe's, or the first word's.
    """

    recipe: SentenceRecipe
    result: SpliceResult
    tokens: tuple[SentenceToken, ...]
    signer: str

    @property
    def motion_sha256(self) -> str:
        """Hash of the clip's numbers, bit for bit, independent of the file format."""
        return motion_sha256(self.result.clip)

    def report(self) -> dict[str, Any]:
        """Return the report of the splice with the keys ``units``, as ``sentence`` writes them, and ``recipe``. Omits
        times, which differ each time that the same sentence is made.
        """
        described = reports.describe(self.result) | {"timing_ms": {}}
        units = [reports.plain(asdict(token)) for token in self.tokens]
        return described | {"units": units, "recipe": reports.plain(asdict(self.recipe))}


@dataclass(frozen=True, eq=False)
class FailedSentence:
    """A recipe from which no sentence could be made.

    recipe: the recipe.
    reason: the reason, one line.
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
    """Return the hash of a clip's rate, rotations, root positions, translations and face, bit for bit."""
    digest = hashlib.sha256(f"{clip.fps!r} {clip.local_rotations.shape}".encode())
    for array in (clip.local_rotations, clip.root_positions, clip.translations):
        if array is not None:
            digest.update(array.tobytes())
    if clip.face is not None:
        digest.update(" ".join(clip.face.channels).encode() + clip.face.weights.tobytes())
    return digest.hexdigest()


class SentenceMaker:
    """Makes sentences from recipes with one lexicon and one bundle of networks.

    words: the lexicon.
    bundle: folder of the networks; None for the shipped ones.
    """

    def __init__(self, words: Lexicon, bundle: str | None = None, n_words_kept: int = WORDS_KEPT) -> None:
        self.words, self.bundle, self._n_words_kept = words, bundle, n_words_kept
        self._clips: OrderedDict[tuple[str, str], Clip] = OrderedDict()
        self._owns = lru_cache(n_words_kept)(words.owns)
        self._bodies: dict[str, Clip] = {}

    def make(self, recipes: Sequence[SentenceRecipe]) -> list[MadeSentence | FailedSentence]:
        """Make the sentence of each recipe, in order; a sentence does not depend on the other recipes.

        Raises errors of the machine (no memory, no disk), since they say nothing about a recipe.
        """
        sentences: list[MadeSentence | FailedSentence | None] = [None] * len(recipes)
        calls: dict[int, _SentenceCall] = {}
        for row, recipe in enumerate(recipes):
            try:
                calls[row] = self._call(recipe)
            except (MemoryError, OSError):
                raise
            except Exception as error:
                sentences[row] = FailedSentence(recipe, self._reason(error))
        for row, result in zip(calls, _results(list(calls.values())), strict=True):
            if isinstance(result, Exception):
                sentences[row] = FailedSentence(recipes[row], self._reason(result))
            else:
                recipe, tokens = recipes[row], calls[row].tokens
                first = next(gloss for token in tokens for gloss in token.glosses)  # some tokens are left out
                signer = recipe.signer or self.words.entry(first).signer
                sentences[row] = MadeSentence(recipe, result, tokens, signer)
        return [sentence for sentence in sentences if sentence is not None]

    def _reason(self, error: Exception) -> str:
        """Return the reason of a failure in one line that does not depend on the lexicon's path."""
        text = " ".join(str(error).splitlines())
        for where in (self.words.where, *(source.path for source in self.words.sources)):
            text = text.replace(f"{where}: ", "")
        return text[:500] if isinstance(error, SignspliceError) else f"unexpected {type(error).__name__}: {text[:500]}"

    def _call(self, recipe: SentenceRecipe) -> _SentenceCall:
        tokens = tuple(self._tokens(recipe))
        options = recipe.options(self.bundle)
        options.choose_methods()  # raises for unknown methods
        words = words_of(tokens, lambda gloss: self._clip(gloss, recipe.signer), recipe.pauses, self._owns)
        return _SentenceCall(words, options, tokens)

    def clips(self, recipe: SentenceRecipe) -> list[Clip]:
        """Return the clips of a recipe's words, in order."""
        return [self._clip(gloss, recipe.signer) for token in self._tokens(recipe) for gloss in token.glosses]

    def _tokens(self, recipe: SentenceRecipe) -> list[SentenceToken]:
        """Return how each gloss of a recipe is signed: as a word of the lexicon, or spelled."""
        if not recipe.glosses:
            raise InputError("no glosses, expected at least one")
        tokens: list[SentenceToken] = []
        for gloss in recipe.glosses:
            if gloss in self.words:
                tokens.append(SentenceToken(gloss, (self.words.entry(gloss).gloss,)))
            else:
                tokens += parse(gloss, self.words, spell=recipe.spell, compounds=False, language="")
        return tokens

    def _clip(self, gloss: str, signer: str) -> Clip:
        """Return the clip of a gloss on the body of a signer, the same object as long as it is cached."""
        key = (gloss, signer)
        if key not in self._clips:
            clip = self.words.clip(gloss)
            if signer and self.words.entry(gloss).signer != signer:
                done = retarget(clip, self._body(signer))
                lines = tuple(line.removeprefix(f"{clip.name}: ") for line in done.warnings)
                clip = replace(done.clip, name=clip.name, notes=lines)
            self._clips[key] = clip
            while len(self._clips) > self._n_words_kept:
                self._clips.popitem(last=False)
        self._clips.move_to_end(key)
        return self._clips[key]

    def _body(self, signer: str) -> Clip:
        """Return a clip with the body of a signer: the first of the signer's words."""
        if signer not in self._bodies:
            first: Entry | None = next((entry for entry in self.words.entries() if entry.signer == signer), None)
            if first is None:
                known = sorted({entry.signer for entry in self.words.entries()})
                raise InputError(f"signer {signer[:40]!r}, expected one of the lexicon's: {', '.join(known)[:200]}")
            self._bodies[signer] = self.words.clip(first.gloss)
        return self._bodies[signer]


def _results(calls: Sequence[_SentenceCall]) -> Sequence[SpliceResult | Exception]:
    """Return the engine's result of each call, or its error."""
    try:
        return splice_many([call.words for call in calls], [call.options for call in calls])
    except (MemoryError, OSError):
        raise
    except Exception:  # one sentence triggers a bug; make the others without it
        return [_alone(call) for call in calls]


def _alone(call: _SentenceCall) -> SpliceResult | Exception:
    try:
        return splice(call.words, call.options)
    except (MemoryError, OSError):
        raise
    except Exception as error:
        return error
