"""What becomes of clips on their way to a sentence, in one place: words -> plan -> passes -> pieces.

    words    every clip becomes a word: aligned to the first one, brought to the tempo asked for   (``words``),
             and held where a phrase ends                                                          (``passes.pauses``)
    plan     every two neighbours get a seam: a cut, and a gap of so many frames                    (``joins``)
    passes   the gaps are filled, and the seams changed, by the passes below, in this order         (``passes``)
    pieces   words and new frames are put out in order, edits applied, seams scored                 (``pieces``)

Every value in between is frozen: a stage takes one and gives another. A new behaviour is a new pass: one file in
``passes``, one line here.
"""

from __future__ import annotations

from dataclasses import replace

from signsplice.splicing.joins.letters import LetterJoin
from signsplice.splicing.joins.signs import SignJoin
from signsplice.splicing.joins.systems import SystemJoin
from signsplice.splicing.methods.choice import ChosenMethods
from signsplice.splicing.methods.duration import RunningDuration
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.passes.collision_avoidance import AvoidCollisions
from signsplice.splicing.passes.doubled_letters import ReformLetters, SlideLetters
from signsplice.splicing.passes.face_seams import EaseFaces
from signsplice.splicing.passes.filling import FillGaps, Refill
from signsplice.splicing.passes.free_hand import NATURAL, FreeHands, WristSpeeds
from signsplice.splicing.passes.letter_blending import MoveFingers
from signsplice.splicing.passes.pauses import HoldPauses
from signsplice.splicing.passes.seam_pass import Pass
from signsplice.splicing.passes.unhurried import LengthenGaps
from signsplice.splicing.planning import Planner
from signsplice.splicing.tempo import seconds_a_sign
from signsplice.splicing.words.word import WordAligner


def chosen_methods(options: SpliceOptions) -> ChosenMethods:
    """The cutter, transition and duration of a call; under a tempo transitions take as long as it says, unless the call
    names a duration.
    """
    methods, seconds = options.chosen_methods(), seconds_a_sign(options.tempo)
    if seconds is None or options.has_own("duration"):
        return methods
    return replace(methods, duration=RunningDuration(seconds))


def word_aligner(options: SpliceOptions) -> WordAligner:
    """What makes words of clips."""
    return WordAligner(options.fps, options.sign_speed, options.limits, options.system)


def planner(options: SpliceOptions, methods: ChosenMethods) -> Planner:
    """What plans the seams of words: one of three joins for every two neighbours."""
    signs = SignJoin(methods.duration, options.transition_time, options.sign_speed)
    fallback = f"cutter {methods.cutter.name}, transition {methods.transition.name}"
    return Planner(
        cutter=methods.cutter,
        signs=signs,
        letters=LetterJoin(signs, options.has_own("duration")),
        spells=not options.has_own("cutter"),
        system=None if options.system is None else SystemJoin(options.system),
        fallback=fallback if options.fill_misses else None,
    )


def passes(options: SpliceOptions, methods: ChosenMethods) -> tuple[Pass, ...]:
    """What happens to planned seams, in order. Gap passes come first: they see gaps alone."""
    transition, is_running = methods.transition, isinstance(methods.duration, RunningDuration)
    avoids = transition.learned if options.avoid_collisions is None else options.avoid_collisions
    natural, refill = options.free_hand == NATURAL, Refill(transition, avoids)
    frees_hands = natural or options.lengthens
    listed: tuple[tuple[Pass, bool], ...] = (
        # gaps, of many sentences at once
        (FillGaps(transition), True),
        (AvoidCollisions(), avoids),
        (LengthenGaps(transition, avoids), is_running and options.transition_time is None),
        (WristSpeeds(), frees_hands),
        # seams, one after another
        (SlideLetters(refill), True),
        (FreeHands(refill, natural, options.lengthens, options.avoid_collisions is not False), frees_hands),
        (ReformLetters(), True),
        (MoveFingers(options.sign_speed), True),
        (HoldPauses(), True),
        (EaseFaces(), True),
    )
    return tuple(one for one, is_wanted in listed if is_wanted)
