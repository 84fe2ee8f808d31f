"""What becomes of clips on their way to a sentence, in one place: words -> plan -> passes -> pieces.

    words    every clip becomes a word: aligned to the first one, brought to the tempo asked for   (``words``)
    plan     every two neighbours get a seam: a cut, and a gap of so many frames                    (``joins``)
    passes   the gaps are filled, and the seams changed, by the passes below, in this order         (``passes``)
    pieces   words and new frames are put out in order, edits applied, seams scored                 (``pieces``)

Every value in between is frozen: a stage takes one and gives another. A new behaviour is a new pass: one file in
``passes``, one line here.
"""

from __future__ import annotations

from signsplice.splicing.joins.letters import LetterJoin
from signsplice.splicing.joins.signs import SignJoin
from signsplice.splicing.joins.systems import SystemJoin
from signsplice.splicing.methods.choice import ChosenMethods
from signsplice.splicing.methods.duration import Duration, RunningDuration
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.passes.collision_avoidance import AvoidCollisions
from signsplice.splicing.passes.doubled_letters import ReformLetters, SlideLetters
from signsplice.splicing.passes.filling import FillGaps, Refill
from signsplice.splicing.passes.free_hand import NATURAL, FreeHands, WristSpeeds
from signsplice.splicing.passes.letter_blending import MoveFingers
from signsplice.splicing.passes.seam_pass import GapPass, GapPasses, SeamPass
from signsplice.splicing.passes.unhurried import LengthenGaps
from signsplice.splicing.planning import Planner
from signsplice.splicing.tempo import seconds_a_sign
from signsplice.splicing.words.alignment import WordAligner


def word_aligner(options: SpliceOptions) -> WordAligner:
    """What makes words of clips."""
    return WordAligner(options.fps, options.sign_speed, options.limits, options.system)


def planner(options: SpliceOptions, methods: ChosenMethods) -> Planner:
    """What plans the seams of words: one of three joins for every two neighbours."""
    signs = SignJoin(_duration(options, methods), options.transition_time, options.sign_speed)
    fallback = f"cutter {methods.cutter.name}, transition {methods.transition.name}"
    return Planner(
        cutter=methods.cutter,
        signs=signs,
        letters=LetterJoin(signs, options.has_own_duration),
        spells=not options.has_own_cutter,
        system=None if options.system is None else SystemJoin(options.system),
        fallback=fallback if options.fill_misses else None,
    )


def gap_passes(options: SpliceOptions, methods: ChosenMethods) -> GapPasses:
    """The first passes, which see gaps alone: those of many sentences at once."""
    transition, avoids = methods.transition, _avoids_collisions(options, methods)
    passes: list[GapPass] = [FillGaps(transition)]
    if avoids:
        passes.append(AvoidCollisions())
    if isinstance(_duration(options, methods), RunningDuration) and options.transition_time is None:
        passes.append(LengthenGaps(transition, avoids))
    if _frees_hands(options):
        passes.append(WristSpeeds())
    return GapPasses(tuple(passes))


def seam_passes(options: SpliceOptions, methods: ChosenMethods) -> tuple[SeamPass, ...]:
    """The passes after them, which see seams one after another, and may edit words."""
    refill = Refill(methods.transition, _avoids_collisions(options, methods))
    passes: list[SeamPass] = [SlideLetters(refill)]
    if _frees_hands(options):
        takes_frames, avoids = options.free_hand == NATURAL, options.avoid_collisions is not False
        passes.append(FreeHands(refill, takes_frames, options.lengthens, avoids))
    passes += [ReformLetters(), MoveFingers(options.sign_speed)]
    return tuple(passes)


def _duration(options: SpliceOptions, methods: ChosenMethods) -> Duration:
    """How long transitions between signs take: as at the tempo asked for, unless the call names a duration."""
    seconds = seconds_a_sign(options.tempo)
    return methods.duration if seconds is None or options.has_own_duration else RunningDuration(seconds)


def _avoids_collisions(options: SpliceOptions, methods: ChosenMethods) -> bool:
    """Whether hands are led around the body in transitions."""
    return methods.transition.learned if options.avoid_collisions is None else options.avoid_collisions


def _frees_hands(options: SpliceOptions) -> bool:
    """Whether idle hands may get more time."""
    return options.lengthens or options.free_hand == NATURAL
