"""Segments of a compiled sign with repetitions of one movement written as such."""

from __future__ import annotations

from dataclasses import dataclass, replace

from signsplice.signer.phonology import Segment


@dataclass(frozen=True)
class Tracked:
    """A segment, and whether it is an unmarked way back."""

    segment: Segment
    back: bool = False


def collapsed(track: list[Tracked]) -> list[Segment]:
    """Segments with repetitions of one movement as ``times=``, of circles and local movements as more of them."""
    out: list[Segment] = []
    k = 0
    while k < len(track):
        segment = track[k].segment
        again = 1
        while (
            segment.kind == "M" and out and k + 2 < len(track) and track[k + 1].back
            and not track[k + 1].segment.circles
            and track[k + 2].segment == segment
            and (track[k + 1].segment.strong, track[k + 1].segment.weak) == (out[-1].strong, out[-1].weak)
        ):  # fmt: skip
            again, k = again + 1, k + 2
        before = out[-1] if out else None
        k += 1
        if again == 1 and before is not None and _continues(before, segment):
            out[-1] = _longer(before, segment)
            continue
        out.append(replace(segment, times=again) if again > 1 else segment)
    return out


def _continues(before: Segment, segment: Segment) -> bool:
    """Whether a segment is another turn, or more of the same local movement, in one place."""
    same = before.kind == segment.kind == "M" and before.strong == segment.strong and before.weak == segment.weak
    shape = replace(before.path, revolutions=0.0) == replace(segment.path, revolutions=0.0)
    own = replace(before.weak_path, revolutions=0.0) == replace(segment.weak_path, revolutions=0.0)
    kinds = before.local == segment.local or (
        before.local and segment.local and before.local.kind == segment.local.kind
    )
    return bool(same and shape and own and kinds and before.tempo == segment.tempo and before.times == 1)


def _longer(before: Segment, segment: Segment) -> Segment:
    """Two segments in one place as one."""
    local, own = before.local, before.weak_local
    if not segment.circles:
        local = local and replace(local, cycles=min(local.cycles + 2.0, 10.0))
        own = own and replace(own, cycles=min(own.cycles + 2.0, 10.0))
    turns = [min(a.revolutions + b.revolutions, 6.0) for a, b in
             ((before.path, segment.path), (before.weak_path, segment.weak_path))]  # fmt: skip
    return replace(
        before,
        local=local,
        weak_local=own,
        path=replace(before.path, revolutions=turns[0]),
        weak_path=replace(before.weak_path, revolutions=turns[1]),
    )
