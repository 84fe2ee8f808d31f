"""The stages from words to a sentence: words -> plan -> passes -> pieces.

    words    every clip becomes a word: aligned to the first one, at the chosen speed              (``Planner.align``),
             brought to the chosen tempo, and held at the end of a phrase                          (``Planner.time``)
    plan     every two neighbours get a seam: a cut, and a gap with a number of frames             (``Planner.seams``);
             arms and heads that one of them does not own are planned                              (``person``)
    passes   the passes below fill the gaps and change the seams, in this order                    (``passes``)
    pieces   words and new frames are emitted in order, edits applied, seams scored, and head and
             trunk turned where no word owns them                                                  (``sentence``)

All intermediate values are frozen: a stage takes one and returns another. To add a behaviour, write a pass and list it
here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from signsplice.body.landmark_fit import DEPTH_NOTE
from signsplice.body.retarget import align, reference_onto
from signsplice.errors import InputError, SignspliceError
from signsplice.lexicon.gloss import is_letter
from signsplice.motion import Clip, resample
from signsplice.rig.align import Reference, choose_skeleton, reference
from signsplice.rig.info import FEATURE_FPS, rig_info
from signsplice.rig.inspection import clip_warnings, motion_span, with_ends_held
from signsplice.rig.keyedness import judge_keyedness
from signsplice.rig.rest_pose import with_rest_pose
from signsplice.rig.roles import CHANNELS
from signsplice.splicing.cards import recall
from signsplice.splicing.contracts import Cut
from signsplice.splicing.durations import HUMAN, MAX_TRANSITION_S
from signsplice.splicing.faces import BROWS, EaseFaces
from signsplice.splicing.landmarks import CarryLandmarks
from signsplice.splicing.letters import (
    MOVEMENTS,
    MoveFingers,
    ReformLetters,
    SlideLetters,
    cut_letters,
    last_letter_hold_end,
)
from signsplice.splicing.options import Methods, SpliceOptions
from signsplice.splicing.passes import AvoidCollisions, FillGaps, Pass, Refill
from signsplice.splicing.pauses import HoldPauses, with_pause
from signsplice.splicing.person import NATURAL, carry_channels, channel_joints, hold_idle_arms, owned_channels
from signsplice.splicing.seam import LETTERS, REFORMED, SIGNS, SLID, Seam, plan_seam
from signsplice.splicing.systems import NoSpliceError, WholeSystem, misses_message
from signsplice.splicing.tempo import retime_word
from signsplice.splicing.word import AlignedWord, FrameMap, Word, cut_words


def passes(options: SpliceOptions, methods: Methods) -> tuple[Pass, ...]:
    """Returns the passes that change planned seams, in order. Those that batch come first: they only see gaps."""
    transition = methods.transition
    avoids = transition.learned if options.avoid_collisions is None else options.avoid_collisions
    refill = Refill(transition, avoids)
    listed: tuple[tuple[Pass, bool], ...] = (
        # gaps, of many sentences at once
        (FillGaps(transition), True),
        (AvoidCollisions(), avoids),
        # seams, one after another
        (SlideLetters(refill), True),
        (ReformLetters(), True),
        (MoveFingers(options.sign_speed), True),
        (HoldPauses(), True),
        (EaseFaces(), True),
        (CarryLandmarks(), True),
    )
    return tuple(step for step, is_wanted in listed if is_wanted)


LOW_FPS = 20.0
"""Rate under which a first clip does not set that of its sentence, frames/s: EN 301 549, 6.5.1, calls signing well
usable from there on.
"""
STREAM_FPS = FEATURE_FPS
"""Rate of a stream whose first clip is under ``LOW_FPS``, frames/s: that of the networks, since others are unknown."""


class Planner:
    """Turns clips into words and plans their seams according to a call's options.

    options: options of the call.
    methods: its cutter, transition and duration.
    """

    def __init__(self, options: SpliceOptions) -> None:
        self.options, self.methods, self._seconds = options, options.choose_methods(), options.seconds_a_sign
        self._planned: tuple[str, ...] = ()
        if options.free_hand == NATURAL and options.whole_system is None:
            self._planned += CHANNELS[:2]
        if options.moves_person:
            self._planned += CHANNELS[3:]

    def reference(self, clips: Sequence[Clip], grows: bool) -> tuple[Reference, dict[str, Any] | None, tuple[str, ...]]:
        """Returns what the words of a sentence are aligned to, which begins with these clips and has no others unless
        it ``grows``; its ``SpliceResult.skeleton``; and lines about skeleton or rate if they are not the first clip's.
        Raises ``RigMismatchError`` if the user's body has nothing in common with the first clip.
        """
        onto, (fps, warnings) = self.options.onto, self._output_fps(clips, grows)
        best, why = choose_skeleton(clips) if onto is None and not grows else (0, "")
        first, chosen = (with_ends_held(self._with_card(clip)) for clip in (clips[0], clips[best]))
        if best:
            onto, warnings = chosen, (*warnings, f"the sentence is on the skeleton of {chosen.name}: {why}")
        to = reference(first, fps) if onto is None else reference_onto(first, onto, fps)
        skeleton = None if onto is None else {"clip": best or None, "name": to.name, "why": why or "given by the user"}
        if self.options.whole_system is not None:
            to = self.options.whole_system.place_reference(first, to, is_first=True)
        return to, skeleton, warnings

    def align(self, clip: Clip, index: int, to: Reference) -> AlignedWord:
        """Returns the word of a clip, aligned to the reference of its sentence. ``index``: its number in the sentence.

        Raises ``LimitError`` for too many frames, ``RigMismatchError`` if rigs have nothing in common.
        """
        clip, fps, speed = self._with_card(clip), to.fps, self.options.sign_speed
        system = self.options.whole_system
        self.options.limits.check_resampling(clip, fps, speed)
        motion, held_clip = motion_span(clip), with_ends_held(clip)
        if system is not None and index:
            to = system.place_reference(held_clip, to, is_first=False)
        aligned = align(held_clip, replace(to, fps=clip.fps))
        resampled = resample(aligned.clip, fps, speed)
        step = clip.fps * speed / fps
        resampled_span = motion.resample_span(step, len(resampled))
        shown, recorded = resampled, aligned.clip
        if held_clip is not clip:
            shown, recorded = resampled[resampled_span], aligned.clip[motion.start : motion.stop]
        warnings = (*(f"{clip.name}: {line}" for line in clip_warnings(clip)), *aligned.warnings)
        if clip.points is not None and not index:
            warnings = (*warnings, DEPTH_NOTE)
        if (clip.points is None) != (to.landmarks is None) and index:
            which = "has no landmarks" if clip.points is None else f"has landmarks, {to.name} has none"
            warnings = (*warnings, f"{clip.name}: {which}: the sentence is made without any")
        elif clip.points is not None and to.landmarks is not None and not clip.points.framing.is_like(to.landmarks[1]):
            scale = to.landmarks[1].scale / clip.points.framing.scale
            warnings = (
                *warnings,
                f"{clip.name}: landmarks scaled by {scale:.2f} and moved to those of {to.name}",
            )
        if system is not None:
            warnings = (*warnings, *system.rate_warnings(clip))
        frames = FrameMap(n_left_out=resampled_span.start)
        keyed = judge_keyedness(held_clip).is_keyed
        word = AlignedWord(index, shown, shown, frames, warnings, aligned.contacts, is_letter(shown.name), keyed=keyed)
        if resampled is not aligned.clip:
            word = replace(word, own=recorded, own_step=step, own_first=step * resampled_span.start - motion.start)
        return word

    def _with_card(self, clip: Clip) -> Clip:
        """Returns the clip with a rest pose, and what is known of it (``cards``)."""
        clip = with_rest_pose(clip)
        recall(clip, self.methods.cutter)
        return clip

    def _output_fps(self, clips: Sequence[Clip], grows: bool) -> tuple[float, tuple[str, ...]]:
        """Returns the output rate of a sentence that begins with these clips, and a line if it is not the first's."""
        system, first = self.options.whole_system, clips[0]
        if self.options.fps is not None or first.fps >= LOW_FPS or (system is not None and system.fps is not None):
            return self.options.fps or (first.fps if system is None else system.output_fps(first)), ()
        fps = max(STREAM_FPS if grows else 0.0, *(clip.fps for clip in clips))
        whose = "a stream's" if grows else "the highest of its clips"
        line = f"{first.name}: {first.fps:g} fps are too few for signing; the sentence has {fps:g}, {whose}"
        return fps, (line,) if fps > first.fps else ()

    def time(self, word: AlignedWord, given: Word) -> AlignedWord:
        """Returns the word at the chosen tempo, held at the mark after it if the ``given`` word has one."""
        word = self._give_channels(word, given)
        if self._seconds is not None:
            word = retime_word(word, self.methods.cutter, self._seconds)
        if given.pause is not None and self.options.whole_system is None:
            word = with_pause(word, given.pause, self.methods.cutter, self.options.sign_speed)
        return replace(word, starts=given.starts)

    def _give_channels(self, word: AlignedWord, given: Word) -> AlignedWord:
        """Returns the word with the channels that it owns, and head and trunk among the planned ones if they move."""
        if not (self._planned and rig_info(word.clip.skeleton).has_arms):
            return word
        clip = with_rest_pose(given.clip)
        if with_ends_held(clip) is not clip:  # it has stray frames
            clip = word.clip
        owns = owned_channels(clip) if given.owns is None else given.owns
        if word.clip.points is not None:
            owns = frozenset(CHANNELS)  # what was seen is not planned
        moved = CHANNELS[2:] if self.options.moves_person else ()
        planned = tuple(part for part in moved if part not in owns and channel_joints(word.clip, part))
        brow = given.brow if BROWS in self.options.face_rules else None
        return replace(word, measured=clip, owns=owns, planned=planned, brow=brow)

    def cuts(self, words: Sequence[AlignedWord]) -> list[Cut]:
        """Returns the cutter's choice for every two neighbours; none if a system joins them."""
        return cut_words(self.methods.cutter, words) if self.options.whole_system is None and len(words) > 1 else []

    def seams(self, words: Sequence[AlignedWord], cuts: Sequence[Cut]) -> list[Seam]:
        """Returns the seams of words in order, one fewer than words; each starts from the word as entered by the seam
        before. ``cuts``: from ``self.cuts``.
        """
        if self.options.whole_system is not None:
            return self._seams_by_system(self.options.whole_system, words)
        seams: list[Seam] = []
        for after, chosen in zip(words[1:], cuts, strict=True):
            seams.append(self._seam(seams[-1].after if seams else words[0], after, chosen))
        return seams

    def _seams_by_system(self, system: WholeSystem, words: Sequence[AlignedWord]) -> list[Seam]:
        """Returns the system's seams; letters of one spelled word are joined as letters. Raises a ``SignspliceError``
        that names all pairs without a splice, unless the call's methods join those.
        """
        seams: list[Seam] = []
        misses: list[str] = []
        for k, word in enumerate(words[1:]):
            before = seams[-1].after if seams and seams[-1].after.index == words[k].index else words[k]
            if before.is_letter and word.is_letter and not word.starts:
                seams.append(self._seam(before, word, self._cut(before, word)))
                continue
            try:
                seams.append(system.splice_words(before, word))
            except NoSpliceError as error:
                if not self.options.fill_misses:
                    misses.append(f"{before.clip.name} -> {word.clip.name}: {error}")
                    continue
                seam = self._seam(before, word, self._cut(before, word))
                line = (
                    f"{error}: joined by cutter {self.methods.cutter.name}, transition {self.methods.transition.name}"
                )
                seams.append(replace(seam, warnings=(line, *seam.warnings)))
        if misses:
            raise SignspliceError(misses_message(misses, len(words) - 1))
        return seams

    def _cut(self, before: AlignedWord, after: AlignedWord) -> Cut:
        """Returns the cutter's choice for two words."""
        return cut_words(self.methods.cutter, [before, after])[0]

    def _seam(self, before: AlignedWord, after: AlignedWord, chosen: Cut) -> Seam:
        """Returns the seam of two words. Letters of one spelled word are joined as letters, unless the user chose a
        cutter or the first is held at a mark.
        """
        spells = not self.options.has_own("cutter")
        if spells and not after.starts and before.is_letter and after.is_letter and before.held is None:
            return self._seam_of_letters(before, after, chosen)
        return self._seam_of_signs(before, after, chosen)

    def _seam_of_signs(
        self, before: AlignedWord, after: AlignedWord, chosen: Cut, warnings: tuple[str, ...] = ()
    ) -> Seam:
        """Returns the seam at the cutter's choice, or at the end of a pause, but not before the entry of the first word
        or the end of the hold of a spelled word's last letter; adds ``warnings``.
        """
        pre = max(chosen.pre if before.held is None else before.held.leave, before.entry)
        if before.arrival_s and before.held is None:
            pre = max(pre, last_letter_hold_end(before.clip, before.entry, self.options.sign_speed))
        cut = Cut(pre, chosen.post)
        n_frames, lines = self._n_frames(before, after, cut)
        words = self._carry(before, after, cut, n_frames)
        return plan_seam(SIGNS, *words, cut, n_frames, (*lines, *warnings))

    def _seam_of_letters(self, before: AlignedWord, after: AlignedWord, chosen: Cut) -> Seam:
        """Returns the seam of two letters; if no hand is still, joins them as signs, with a warning."""
        letters = cut_letters(before.clip, after.clip, before.entry, before.arrival_s, self.options.sign_speed)
        if letters is None:
            line = f"no still hand is found in {before.clip.name} and {after.clip.name}: they are cut as signs are"
            return self._seam_of_signs(before, after, chosen, (line,))
        cut = Cut(max(letters.cut.pre, before.entry), letters.cut.post)
        if self.options.transition_time is not None or self.options.has_own("duration"):
            n_frames, warnings = self._n_frames(before, after, cut)
        else:
            n_frames, warnings = max(1, round(letters.seconds * before.clip.fps) - 1), letters.warnings
        slides = letters.slides and before.clip.points is None  # what was seen is not moved
        kind = SLID if slides else REFORMED if letters.is_doubled or letters.slides else LETTERS
        slide_m = before.slide_m + MOVEMENTS.slide_m if slides and n_frames else 0.0
        arrival_s = (n_frames + 1) / after.clip.fps
        words = self._carry(before, after, cut, n_frames)
        return plan_seam(kind, *words, cut, n_frames, warnings, arrival_s, slide_m)

    def _carry(
        self, before: AlignedWord, after: AlignedWord, cut: Cut, n_frames: int
    ) -> tuple[AlignedWord, AlignedWord]:
        """Returns two words with the arms and heads planned that one of them does not own."""
        if not self._planned:
            return before, after
        retimed = Cut(before.frames.last(cut.pre), after.frames.first(cut.post))
        return carry_channels(before, after, retimed, n_frames, self._planned, self.options.leads_arms)

    def _n_frames(self, word: AlignedWord, next_word: AlignedWord, cut: Cut) -> tuple[int, tuple[str, ...]]:
        """Returns the number of new frames, from the user's time or the duration, and warnings; the human median if the
        rig's arms are unknown. Idle arms take no time.
        """
        before, after = word.clip, next_word.clip
        if self.options.transition_time is not None:
            return round(self.options.transition_time * before.fps), ()
        try:
            after = hold_idle_arms(word, next_word, cut) if CHANNELS[0] in self._planned else after
            seconds = self.methods.duration.seconds(before, after, cut)
        except InputError:
            median_s = HUMAN.median_transition_s
            line = f"no arms known in {before.name}: the transition takes {median_s:g} s, whatever the distance"
            return max(1, round(median_s * before.fps)), (line,)
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()
