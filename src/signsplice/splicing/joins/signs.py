"""The join of two signs, or of a sign and a letter: at the cutter's choice, for as long as the duration says."""

from __future__ import annotations

from dataclasses import dataclass

from signsplice.errors import FormatError, InputError
from signsplice.motion import Clip
from signsplice.splicing.gap import Cut
from signsplice.splicing.joins.held_letters import held_until
from signsplice.splicing.joins.join import SIGNS, Join, PlannedSeam, planned
from signsplice.splicing.methods.duration import HUMAN_MEDIAN_S, MAX_TRANSITION_S, Duration
from signsplice.splicing.words.word import SentenceWord


@dataclass(frozen=True)
class SignJoin(Join):
    """Plans seams at which a word begins or ends.

    duration: how long the new frames take.
    transition_time: seconds in place of that; None: the duration's.
    sign_speed: how many times as fast signs play.
    """

    duration: Duration
    transition_time: float | None = None
    sign_speed: float = 1.0

    def plan(
        self, before: SentenceWord, after: SentenceWord, chosen: Cut, warnings: tuple[str, ...] = ()
    ) -> PlannedSeam:
        """The seam at the cutter's choice, or at the end of a pause, but never before the frame at which the first word
        was entered, nor before the last letter of a spelled word was held; with further ``warnings``.
        """
        pre = max(chosen.pre if before.held is None else before.held.leave, before.entry)
        if before.arrival_s and before.held is None:
            pre = max(pre, held_until(before.clip, before.entry, self.sign_speed))
        cut = Cut(pre, chosen.post)
        n_frames, lines = self.n_frames(before.clip, after.clip, cut)
        return planned(SIGNS, before, after, cut, n_frames, (*lines, *warnings))

    def n_frames(self, before: Clip, after: Clip, cut: Cut) -> tuple[int, tuple[str, ...]]:
        """Number of new frames, by the user's time or the duration, and warnings; the human median where the rig has no
        known arms.
        """
        if self.transition_time is not None:
            return round(self.transition_time * before.fps), ()
        try:
            seconds = self.duration.seconds(before, after, cut)
        except FormatError:  # of a network that is damaged
            raise
        except InputError:
            line = f"no arms known in {before.name}: the transition takes {HUMAN_MEDIAN_S:g} s, whatever the distance"
            return max(1, round(HUMAN_MEDIAN_S * before.fps)), (line,)
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()
