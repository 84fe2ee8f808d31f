"""A sentence that grows: words are aligned, seams planned, transitions made and finished, pieces put out.

For every two neighbours: where to leave the one and enter the other (the cutter, or ``fingerspelling``), how long the
new frames take (the duration), the frames (the transition, led around the body), and what an idle hand needs more
(``free_hand``). Cuts are chosen on clips as they were recorded, frames made on clips as they are played (``tempo``).
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

from signsplice.body.contacts import Contact
from signsplice.body.retarget import align
from signsplice.errors import FormatError, InputError, SignspliceError
from signsplice.lexicon.entry import is_letter
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip, left_out_warnings
from signsplice.rig.align import Reference, reference
from signsplice.rig.stray_frames import stray_frames, with_ends_held
from signsplice.splicing.arguments import check_clip, check_clips, check_options
from signsplice.splicing.gap import Gap, gap_at
from signsplice.splicing.methods.cut import Cut, cut_clips
from signsplice.splicing.methods.duration import HUMAN_MEDIAN_S, MAX_TRANSITION_S, Duration, most_frames
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.passes import fingerspelling, free_hand
from signsplice.splicing.passes.filling import FilledGap, fill, led_around
from signsplice.splicing.passes.fingerspelling import LetterSeam
from signsplice.splicing.passes.letter_blending import blend, with_fingers
from signsplice.splicing.passes.tempo import GapFiller, Played, RunningDuration, play, seconds_a_sign
from signsplice.splicing.planned import FinishedWords, PlannedSeam, PlannedWords, SentenceWord
from signsplice.splicing.result import Piece, Span
from signsplice.splicing.seam import Seam, score, seam_positions
from signsplice.splicing.whole_system import (
    WholeSystem,
    found_seam,
    miss,
    missing,
    output_fps,
    rate_warnings,
    standing,
)


@dataclass
class SentenceBuilder:
    """A sentence while words are added to it.

    seconds: time spent so far by part.
    contacts: of each word that was brought to another body, by its index.
    """

    options: SpliceOptions
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    contacts: dict[int, tuple[Contact, ...]] = field(default_factory=dict)
    _n_out: int = 0
    _n_words: int = 0
    _reference: Reference | None = None
    _last: SentenceWord | None = None

    def __post_init__(self) -> None:
        options = self.options
        check_options(options, SpliceOptions)
        self.system = options.system
        self.methods = options.chosen_methods()
        self.cutter, self.transition = self.methods.cutter, self.methods.transition
        self.seconds_a_sign = seconds_a_sign(options.tempo)
        self.duration: Duration = self.methods.duration
        if self.seconds_a_sign is not None and not options.has_own_duration:
            self.duration = RunningDuration(self.seconds_a_sign)
        self.filler = GapFiller(
            self.transition,
            options.avoid_collisions,
            is_running=isinstance(self.duration, RunningDuration) and options.transition_time is None,
            measures=options.lengthens or options.free_hand == free_hand.NATURAL,
        )

    @property
    def names(self) -> tuple[str, str, str | None]:
        """Names of what cuts and of what makes the frames, and the sha256 of the bundle that they come from."""
        if self.system is not None:
            return self.system.name, self.system.name, self.system.sha256
        return self.cutter.name, self.transition.name, self.methods.bundle

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Count the time of the block to a part of the work."""
        start = time.perf_counter()
        yield
        self.seconds[part] += time.perf_counter() - start

    def add(self, clips: Iterable[Clip], starts: Collection[int] = ()) -> Iterator[Piece]:
        """The pieces that are final once these words are known too; their seams are chosen together."""
        planned = self.plan(clips, starts)
        with self.timed("transition"):
            filled = self.filler.fill(planned.gaps)
        finished = self.finish(planned, filled)
        with self.timed("join"):
            positions = seam_positions(*finished.windows)
        yield from self.pieces(finished, positions)

    def plan(self, clips: Iterable[Clip], starts: Collection[int] = ()) -> PlannedWords:
        """Further words with their seams, before any frame is made. They are no part of the sentence yet."""
        check_clips(clips)
        new = [replace(self._word(clip, self._n_words + k), starts=k in starts) for k, clip in enumerate(clips)]
        words = new if self._last is None else [self._last, *new]
        return PlannedWords(new, words[-1] if words else None, self._plan(words))

    def finish(self, planned: PlannedWords, filled: Sequence[FilledGap]) -> FinishedWords:
        """Planned words with the frames that ``filler`` made for their gaps; from here on they are part of the
        sentence.
        """
        with self.timed("transition"):
            made = iter(filled)
            finished = [self._filled(one, made) for one in planned.seams]
        self._n_words += len(planned.new)
        self._last = planned.last
        return FinishedWords(finished)

    def pieces(self, finished: FinishedWords, positions: Sequence[FloatArray]) -> Iterator[Piece]:
        """The pieces of finished words but the last; ``positions`` are ``seam_positions`` of their windows."""
        for (planned, transition), seen in zip(finished.seams, positions, strict=True):
            yield self._sign(planned.before, planned.before.played.last(planned.cut.pre) + 1)
            planned.after.seam = self._score(planned, transition, seen)
            if transition is not None:
                span = self._span("transition", None, None, None, len(transition.clip))
                yield Piece(transition.clip, span)

    def end(self) -> Iterator[Piece]:
        """The rest of the last word."""
        last, self._last = self._last, None
        if last is not None:
            yield self._sign(last, len(last.played.clip))

    def _word(self, clip: Clip, index: int) -> SentenceWord:
        """A clip aligned to the first one."""
        check_clip(clip, index)
        with self.timed("harmonize"):
            fps = self._reference.fps if self._reference else self._fps(clip)
            self.options.limits.check_resampling(clip, fps, self.options.sign_speed)
            stray, held = stray_frames(clip), with_ends_held(clip)
            to = self._reference or reference(held, fps)
            if self.system is not None:
                to = standing(self.system, held, to, is_first=self._reference is None)
            aligned = align(held, to, self.options.sign_speed)
            kept = stray.resampled(clip.fps * self.options.sign_speed / fps, len(aligned.clip))
        own = aligned.clip if held is clip else aligned.clip[kept]
        played = self._played(own, kept.start)
        warnings = (*left_out_warnings(clip), *aligned.warnings, *(f"{clip.name}: {line}" for line in stray.warnings))
        warnings = (*(() if index else self.methods.warnings), *warnings, *played.warnings)
        if self.system is not None:
            warnings = (*warnings, *rate_warnings(self.system, clip))
        self._reference = self._reference or to  # only now: a word that was refused sets nothing
        if aligned.contacts:
            self.contacts[index] = aligned.contacts
        return SentenceWord(index, own, played, played.clip, warnings, n_left_out=kept.start)

    def _fps(self, first: Clip) -> float:
        """The output rate of a sentence that begins with this clip."""
        return self.options.fps or (first.fps if self.system is None else output_fps(self.system, first))

    def _played(self, clip: Clip, n_left_out: int) -> Played:
        """A word at the tempo asked for; letters have a tempo of their own."""
        if self.seconds_a_sign is None or is_letter(clip.name):
            return Played(clip)
        with self.timed("cut"):
            return play(clip, self.cutter, self.seconds_a_sign, n_left_out)

    def _plan(self, words: Sequence[SentenceWord]) -> list[PlannedSeam]:
        """The seams of words in order; sets the frame at which each word is entered."""
        if self.system is not None:
            return self._plan_by_system(self.system, words)
        cuts = self._cuts([word.clip for word in words])
        return [self._planned(*pair, chosen) for pair, chosen in zip(pairwise(words), cuts, strict=True)]

    def _plan_by_system(self, system: WholeSystem, words: Sequence[SentenceWord]) -> list[PlannedSeam]:
        """The seams as the system makes them. Raises ``SignspliceError`` that names all pairs for which it has none,
        unless the defaults are to join those.
        """
        seams, misses = [], []
        for before, after in pairwise(words):
            with self.timed("transition"):
                found = system.splice_words(before.clip, after.clip)
            missed = miss(system, found, before)
            if not missed:
                seams.append(found_seam(found, before, after))
            elif self.options.fill_misses:
                (chosen,) = self._cuts([before.clip, after.clip])
                planned = self._planned(before, after, chosen)
                line = f"{missed}: joined by cutter {self.cutter.name}, transition {self.transition.name}"
                seams.append(replace(planned, warnings=(line, *planned.warnings)))
            else:
                misses.append(f"{before.clip.name} -> {after.clip.name}: {missed}")
                after.entry = 0
        if misses:
            raise SignspliceError(missing(misses, len(words) - 1))
        return seams

    def _planned(self, before: SentenceWord, after: SentenceWord, chosen: Cut) -> PlannedSeam:
        """The seam of two words at the cutter's choice; sets the frame at which the second is entered."""
        n_before, n_after = len(before.clip), len(after.clip)
        if not (0 <= chosen.pre < n_before and 0 <= chosen.post < n_after):
            raise InputError(f"cutter {self.cutter.name} chose {chosen} for clips of {n_before} and {n_after} frames")
        is_spelled = self._is_spelled(before, after)
        letters = self._letters(before, after) if is_spelled else None
        if letters is not None:
            chosen = letters.cut
        elif before.transition_s:
            chosen = Cut(
                max(chosen.pre, fingerspelling.held_until(before.clip, before.entry, self.options.sign_speed)),
                chosen.post,
            )
        # Never before the frame at which the word itself was entered.
        cut = Cut(max(chosen.pre, before.entry), chosen.post)
        after.entry = cut.post
        with self.timed("transition"):
            n_frames, warnings = self._n_frames(before.clip, after.clip, cut, letters)
        if is_spelled and letters is None:
            line = f"no still hand is found in {before.clip.name} and {after.clip.name}: they are cut as signs are"
            warnings = (*warnings, line)
        after.transition_s = (n_frames + 1) / after.clip.fps if letters is not None else 0.0
        if cut.pre <= before.entry and before.entry > 0:
            frame = before.n_left_out + before.entry
            line = f"{before.clip.name} is left at frame {frame}, where it was entered: only that frame is kept"
            warnings = (*warnings, line)
        p, q = before.played, after.played
        gap = gap_at(p.clip, q.clip, p.cut(cut, q), n_frames, p.first(before.entry))
        return PlannedSeam(before, after, cut, gap, warnings, letters)

    def _is_spelled(self, before: SentenceWord, after: SentenceWord) -> bool:
        """Whether two words are letters of one spelled word, and the user chose no cutter."""
        is_free = not (self.options.has_own_cutter or after.starts)
        return is_free and fingerspelling.are_letters(before.clip, after.clip)

    def _letters(self, before: SentenceWord, after: SentenceWord) -> LetterSeam | None:
        """The seam of two letters of one spelled word, None where a hand is never seen still."""
        with self.timed("cut"):
            return fingerspelling.letter_seam(
                before.clip, after.clip, before.entry, before.transition_s, self.options.sign_speed
            )

    def _cuts(self, clips: Sequence[Clip]) -> list[Cut]:
        """The cutter's choice for every two neighbours."""
        if len(clips) < 2:
            return []
        with self.timed("cut"):
            return cut_clips(self.cutter, clips)

    def _filled(self, planned: PlannedSeam, filled: Iterator[FilledGap]) -> tuple[PlannedSeam, FilledGap | None]:
        """A seam with its transition, None where it has no frames."""
        if planned.made is not None:
            return planned, FilledGap(planned.made)
        return self._finished(planned, next(filled)) if planned.gap.n_frames else (planned, None)

    def _finished(self, planned: PlannedSeam, filled: FilledGap) -> tuple[PlannedSeam, FilledGap]:
        """A seam whose idle hands have the time that they need, and whose doubled letters can be told apart."""
        before, after, options = planned.before, planned.after, self.options
        gap = replace(planned.gap, n_frames=len(filled.clip))

        def refill(gap: Gap) -> FilledGap:
            return fill(self.transition, [gap], options.avoid_collisions)[0]

        avoids, longest = options.avoid_collisions is not False, most_frames(before.clip.fps)
        rules = free_hand.Rules(options.free_hand == free_hand.NATURAL, options.lengthens, avoids, longest)
        p, q = before.played, after.played
        cut, entry = p.cut(planned.cut, q), p.first(before.entry)
        letters = planned.letters
        if letters is not None and letters.slides:
            after.slid_m = before.slid_m + fingerspelling.SLIDE_M
            after.shown, stretch = fingerspelling.slid(after.shown, cut.post, after.slid_m)
            after.remade.append(stretch)
        seam = free_hand.SeamFrames(before.shown, after.shown, cut, entry, gap, filled)
        if before.shown is not p.clip or after.shown is not q.clip:
            seam = seam.refilled(gap.n_frames, refill)
        done = free_hand.finish(seam, rules, refill)
        before.shown, after.shown = done.before, done.after
        before.remade += done.remade[0]
        after.remade += done.remade[1]
        made = done.filled
        if letters is not None and letters.is_doubled and not letters.slides:
            made = replace(made, clip=fingerspelling.formed_anew(made.clip, before.clip), peak_m_s=None)
            made = made if made.depth is None else led_around(made, done.gap)
        elif letters is not None and not letters.is_doubled:
            held = with_fingers(before.shown, before.fingers)
            blended = blend(replace(done, before=held, filled=made), options.sign_speed)
            before.fingers += blended.before
            after.fingers += blended.after
            return replace(planned, gap=blended.seam.gap), blended.seam.filled
        return replace(planned, gap=done.gap), made

    def _score(self, planned: PlannedSeam, filled: FilledGap | None, positions: FloatArray) -> Seam:
        with self.timed("join"):
            before, after, cut = planned.before, planned.after, planned.cut
            own = Cut(cut.pre + before.n_left_out, cut.post + after.n_left_out)
            by_system = planned.made is not None or (self.system is not None and filled is None)
            names = before.clip.name, after.clip.name
            return score(planned.gap, filled, *names, own, planned.warnings, by_system=by_system, positions=positions)

    def _n_frames(self, before: Clip, after: Clip, cut: Cut, letters: LetterSeam | None) -> tuple[int, tuple[str, ...]]:
        """Number of transition frames: by the user's time, by the way between letters, or by the duration; the human
        median where the rig has no known arms.
        """
        if self.options.transition_time is not None:
            return round(self.options.transition_time * before.fps), ()
        if letters is not None and not self.options.has_own_duration:
            return max(1, round(letters.seconds * before.fps) - 1), letters.warnings
        try:
            seconds = self.duration.seconds(before, after, cut)
        except FormatError:  # of a network that is damaged
            raise
        except InputError:
            return max(1, round(HUMAN_MEDIAN_S * before.fps)), (
                f"no arms known in {before.name}: the transition takes {HUMAN_MEDIAN_S:g} s, whatever the distance",
            )
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()

    def _sign(self, word: SentenceWord, stop: int) -> Piece:
        """A word from where it is entered to frame ``stop`` as it is played."""
        with self.timed("join"):
            played, first = word.played, word.n_left_out
            start = played.first(word.entry)
            source = played.source(start, stop)
            span = self._span("sign", word.index, word.clip.name, (first + source[0], first + source[1]), stop - start)
            span = replace(span, warp=played.warp(start, stop, span.output[0]))
            moved = [*word.remade, *(finger.stretch for finger in word.fingers)]
            if moved:
                span = replace(span, remade=free_hand.remade(moved, word.shown, (start, stop), span.output[0]))
            return Piece(with_fingers(word.shown, word.fingers)[start:stop], span, word.seam, word.warnings)

    def _span(
        self,
        kind: Literal["sign", "transition"],
        clip: int | None,
        name: str | None,
        source: tuple[int, int] | None,
        n_frames: int,
    ) -> Span:
        start, self._n_out = self._n_out, self._n_out + n_frames
        return Span(kind, clip, name, source, (start, self._n_out))
