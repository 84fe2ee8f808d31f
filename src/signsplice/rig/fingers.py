"""Finds the fingers below a hand: names identify the finger, the hierarchy identifies the segment.

A finger is a chain of joints below a hand, counted from the palm outwards, without a metacarpal at its beginning and
without end joints. The segment in a name is used only if fewer than three joints remain.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

_WORDS = (("thumb",), ("index", "pointer", "fore"), ("middle", "mid"), ("ring",), ("little", "pinky", "pinkie"))
_FINGER_OF = {word: finger for finger, words in enumerate(_WORDS) for word in words}
_FINGER_OF |= {letter: finger for finger, letter in enumerate("timrp")}  # Vicon: LHandT1
_ORDINALS = ("", "first", "second", "third", "fourth", "fifth")
# The first that is found counts: "middle" and "mid" may also name a segment, as in "index middle".
_FINGER = tuple(
    re.compile(pattern)
    for pattern in (
        r"(?<![a-z])(?:(?:in)?hand|finger)?(thumb|index|pointer|fore(?=finger|[\W\d]|$)|ring|little|pinky|pinkie)",
        r"(?<![a-z])(?:(?:in)?hand|finger)?(middle|mid)",
        r"(?<![a-z])hand ?([timrp])(?=\d)",
    )
)
_NUMBERED = re.compile(r"(?<![a-z])finger ?(\d{1,2})(?!\d)|(?<![a-z])(first|second|third|fourth|fifth)")
_NO_SEGMENT = re.compile(r"toe|(?<![a-z])(?:twist|helper|ik|target|socket)")
_END = re.compile(r"(?<![a-z])(?<!intermediate )(?:end|tip|nub|null|eff|marker|nail|ft\b)")
_METACARPAL = re.compile(r"(?<![a-z])(?:meta|carpal|mc\b|palm|cup|base|start|root)|\bin ?hand")
_SEGMENTS = tuple(
    re.compile(rf"(?<![a-z])(?:{words})")
    for words in (r"meta|mc\b", r"proximal|pp\b", r"intermediate|medial|mp\b|mid", r"distal|dp\b")
)


class _Part(NamedTuple):
    """The parts of a joint's name: the finger, from 0 for the thumb, or the rig's own finger number; the segment's
    number; the remaining words; and whether the rig surely numbers fingers from 0, as Biped does.
    """

    finger: int
    has_number: bool
    segment: int | None
    words: str
    from_zero: bool = False


def _part(words: str) -> _Part | None:
    """Parses a joint's words; None if they name no finger."""
    if _NO_SEGMENT.search(words):
        return None
    match = next((match for pattern in _FINGER if (match := pattern.search(words))), None)
    named = match or _NUMBERED.search(words)
    if named is None:
        return None
    before = words[: named.end()].removesuffix(named[1] or named[2])
    after = words[named.end() :].removeprefix(" ").removeprefix("finger")
    number = re.search(r"\d{1,9}", after)
    segment = int(number[0]) if number else None
    if match:
        return _Part(_FINGER_OF[match[1]], False, segment, f"{before} {after}")
    digits = named[1]
    if digits and (not after or (len(digits) == 2 and digits[0] != "0")):
        # Biped: Finger4, Finger41 and Finger42 are the little finger, Finger0 and Finger01 the thumb.
        return _Part(int(digits[0]), True, int(digits[1:] or 0) + 1, after, len(digits) == 2)
    return _Part(int(digits or _ORDINALS.index(named[2])), True, segment, f"{before} {after}")


def starts_with_finger(word: str) -> bool:
    """Whether a word begins with a finger's name: "thumb1" does, "shldr" does not."""
    return any(pattern.match(word) for pattern in (*_FINGER, _NUMBERED))


def find_fingers(
    parents: Sequence[int], names: Sequence[tuple[str, str]], side: str, hand: int | None, first_of_thumb: int = 1
) -> dict[tuple[int, int], int]:
    """Returns (finger, segment) -> joint, both counted from 0: from the thumb, and from the palm outwards.

    parents: parent of each joint, which precedes it.
    names: for each joint its side ("" without one) and its words in lower case, separated by blanks.
    hand: joint above the fingers; if unknown, only joints that name their side are used.
    first_of_thumb: number that the rig gives to the first joint of the thumb.
    """
    parts: dict[int, _Part] = {}
    over: dict[int, int] = {}  # finger joint -> the joint before it in its finger
    depths: dict[int, int] = {}
    inside = [False] * len(parents)
    nearest = [-1] * len(parents)  # the joint itself, or the next finger joint above
    for joint, (parent, (own_side, words)) in enumerate(zip(parents, names, strict=True)):
        inside[joint] = hand is None or (parent >= 0 and (parent == hand or inside[parent]))
        above = nearest[joint] = nearest[parent] if parent >= 0 else -1
        part = _part(words) if inside[joint] and own_side in (side, side if hand is None else "") else None
        if part:
            over_it = parts.get(above)
            if over_it and part.has_number and over_it.has_number and part.finger != over_it.finger:
                part = over_it._replace(segment=(over_it.segment or 1) + 1)  # Finger1/Finger2: segments, not fingers
            parts[joint] = part
            if above in parts and parts[above][:2] == part[:2]:
                over[joint] = above
            depths[joint] = depths[over[joint]] + 1 if joint in over else 1
            nearest[joint] = joint
    joint_of: dict[tuple[int, int], int] = {}
    from_zero = any(part.from_zero for part in parts.values())
    for key, finger in _fingers({part[:2] for part in parts.values()}, from_zero).items():
        last = max(
            (joint for joint, part in parts.items() if part[:2] == key),
            key=lambda joint: (depths[joint], -len(parts[joint].words), names[joint]),
        )
        chain = [last]
        while chain[-1] in over:
            chain.append(over[chain[-1]])
        joint_of |= {
            (finger, segment): joint for segment, joint in _segments(finger, chain[::-1], parts, first_of_thumb).items()
        }
    return joint_of


def _fingers(keys: set[tuple[int, bool]], from_zero: bool) -> Mapping[tuple[int, bool], int]:
    """Returns (finger or number, whether it is a number) -> finger, for the fingers of one hand.

    Numbers count the fingers that have no name, from 0 or from 1.
    """
    fingers = {(finger, False): finger for finger, has_number in keys if not has_number}
    free = [finger for finger in range(len(_WORDS)) if (finger, False) not in keys]
    numbers = sorted(number for number, has_number in keys if has_number)
    if len(numbers) == len(free):
        return fingers | {(number, True): finger for number, finger in zip(numbers, free, strict=True)}
    first = 0 if from_zero or 0 in numbers else 1
    return fingers | {(n, True): free[n - first] for n in numbers if 0 <= n - first < len(free)}


def _segments(finger: int, chain: list[int], parts: Mapping[int, _Part], first_of_thumb: int) -> dict[int, int]:
    """Returns segment, from 0, -> joint, for a finger's joints from the palm outwards."""
    first, has_end = first_of_thumb if finger == 0 else 1, False
    while chain and _END.search(parts[chain[-1]].words):
        has_end |= parts[chain.pop()].segment is None  # a fingertip of its own: the last of four joints is none
    while chain and _METACARPAL.search(parts[chain[0]].words) and (finger or len(chain) > 3):
        chain.pop(0)
    if len(chain) > 3:
        # Rigify's index.01.L.01 and index.01.L.02 are halves of one segment.
        starts = [joint for over, joint in pairwise([-1, *chain]) if over < 0 or not _same_segment(parts, over, joint)]
        chain = starts if len(starts) >= 3 else chain
    if len(chain) > 3:
        numbers = [parts[joint].segment for joint in chain]
        if (finger and has_end) or (numbers[1] is not None and (numbers[0] is None or numbers[0] < first)):
            chain.pop(0)
    chain = chain[:3]
    segments = [_segment(finger, parts[joint], first) for joint in chain]
    clear = all(0 <= segment <= 2 for segment in segments) and all(a < b for a, b in pairwise(segments))
    return dict(zip(segments if len(chain) < 3 and clear else range(3), chain, strict=False))


def _same_segment(parts: Mapping[int, _Part], one: int, other: int) -> bool:
    return parts[one].segment is not None and parts[one].segment == parts[other].segment


def _segment(finger: int, part: _Part, first: int) -> int:
    """Returns the segment in a name, from 0; -1 if it has none."""
    ranks = (0, 1, 1, 2) if finger == 0 else (-1, 0, 1, 2)
    words = (rank for pattern, rank in zip(_SEGMENTS, ranks, strict=True) if pattern.search(part.words))
    return next(words, -1 if part.segment is None else part.segment - first)
