"""Forms of a sign: a verb that agrees with subject and object, plural and aspect by repetition.

**Agreement** (Padden 1988; Meir 1998): a verb whose notation names its ends ``at=subject`` and ``at=object`` moves from
the subject's locus to the object's, and the hand turns with it. The notation gives the citation form, from the signer
to the addressee: ``1-GIVE-2``; ``2-GIVE-1`` is "you give me". Persons are 1, 2, 3 (strong side) and 3-WEAK.

**Plural and aspect** (Fischer 1973; Klima and Bellugi 1979, chapters 11 and 12): a sign's last movement is repeated.
``HABITUAL``: fast, to and fro. ``CONTINUATIVE``: slow, the way back a wide arch, so that the hand goes round.
``PLURAL``: at three places beside one another (sideward reduplication, Pfau and Steinbach 2006). These are published
descriptions in their roughest form; the user decides which verbs and nouns take which form.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import FloatArray
from signsplice.signer import locations, pose
from signsplice.signer.phonology import IN_SPACE, MIRRORED_HANDS, ON_BASE, ROLES, Posture, Segment, Sign, faults
from signsplice.signer.signer import STANDARD
from signsplice.signer.tables import Vector, to_vector


@dataclass(frozen=True)
class FormSettings:
    """Sizes and tempos of plural and aspect."""

    plural_step_cm: float = 8.0
    """Distance between the places of a plural, cm."""
    continuative_arch_cm: float = 7.0
    """Height of the way back of a continuative form, cm."""
    habitual_tempo: float = 1.4
    """Tempo of a habitual form over the usual one."""
    continuative_tempo: float = 0.55
    """Tempo of a continuative form over the usual one."""


@dataclass(frozen=True)
class HandSearch:
    """Settings of the search for a hand that faces a person and is easy for its arm."""

    n_directions: int = 150
    """Number of finger directions that are tried."""
    n_rolls: int = 24
    """Number of rolls of the hand that are tried about each direction."""
    n_batches: int = 30
    """Number of batches in which the cheaper half of these hands is tried, cheapest first."""
    other_direction_weight: float = 0.6
    """Weight of the turn of the direction, palm or fingers, that does not face the object; the other one counts 1."""


_FORMS = FormSettings()
_SEARCH = HandSearch()

PERSONS = ("1", "2", "3", "3-weak")
"""The signer, the addressee, a third person on the strong side, and one on the weak side."""
_PRONOUNS = {"I": "1", "ME": "1", "YOU": "2", "HE": "3", "HIM": "3", "SHE": "3", "HER": "3", "IT": "3"}
"""Words that name a person in the gloss of a form: I-GIVE-YOU is 1-GIVE-2."""
INFLECTIONS = {
    "plural": "three times, each beside the one before",
    "habitual": "three times, fast",
    "continuative": "three times, slow, the way back a wide arch",
}
_PERSON = "|".join(sorted((*PERSONS, *_PRONOUNS), key=len, reverse=True))
_FORM = re.compile(
    rf"(?:(?P<subject>{_PERSON})-)?(?P<gloss>.+?)(?:-(?P<object>{_PERSON}))?"
    rf"(?:-(?P<kind>{'|'.join(INFLECTIONS)}))?",
    re.IGNORECASE,
)


def form(signs: Mapping[str, Sign], gloss: str) -> Sign:
    """The form of a sign that a gloss names: ``2-GIVE-1`` or ``YOU-GIVE-ME``, ``TELL-3``, ``LOOK-HABITUAL``,
    ``1-GIVE-3-CONTINUATIVE``; the sign itself for its own gloss.

    Raises ``InputError`` if ``signs`` lacks the sign, or the sign has no such form.
    """
    if gloss in signs:
        return signs[gloss]
    match = _FORM.fullmatch(gloss)
    if match is None or match["gloss"] not in signs:
        what = f"form {gloss[:80]!r}: no sign {match['gloss'][:60] if match else ''!r}"
        raise InputError(f"{what}, expected a sign's gloss as in 2-GIVE-1, TELL-3 or LOOK-HABITUAL")
    sign = signs[match["gloss"]]
    if match["subject"] or match["object"]:
        sign = agree(sign, *(match[role] and _PRONOUNS.get(match[role].upper(), match[role].lower()) for role in ROLES))
    return inflect(sign, match["kind"].lower()) if match["kind"] else sign


def agree(sign: Sign, subject: str | None = None, object: str | None = None) -> Sign:
    """A verb's form for two of ``PERSONS``, or for the one that it agrees with; its gloss is ``1-GIVE-2``, ``TELL-2``.

    Postures at a locus turn about the vertical with the line from subject to object, a hand only as far as is easy for
    its arm. Raises ``InputError`` if the sign does not agree in this way, or both persons are the same.
    """
    persons = {"subject": subject, "object": object}
    used = [role for role in ROLES if any(role == p.location for s in sign.segments for p in _hands(s))]
    given_roles = [role for role in ROLES if persons[role] is not None]
    if used != given_roles:
        what = " and ".join(used) if used else "nobody, as it names no place at=subject or at=object"
        raise InputError(f"{sign.gloss} agrees with {what}; {' and '.join(given_roles) or 'nobody'} was given")
    for person in filter(None, persons.values()):
        if person not in PERSONS:
            raise InputError(f"person {person!r}, expected one of {', '.join(PERSONS)}")
    if subject == object:
        raise InputError(f"{sign.gloss} from {subject} to {object}, expected two persons")
    yaw = _yaw(subject, object)
    segments = []
    for s in sign.segments:
        strong, weak = _agreeing(s.strong, persons, yaw), s.weak and _agreeing(s.weak, persons, -yaw, is_weak=True)
        path, weak_path = (
            replace(old_path, direction=_rotate_yaw(old_path.direction, by))
            for old_path, by in ((s.path, yaw), (s.weak_path, -yaw))
        )
        segments.append(replace(s, strong=strong, weak=weak, path=path, weak_path=weak_path))
    gloss = "-".join(filter(None, (subject, sign.gloss, object))).upper()
    return _check_sign(replace(sign, gloss=gloss, segments=tuple(segments), synonyms=()))


def inflect(sign: Sign, kind: str) -> Sign:
    """A sign's form of one of ``INFLECTIONS``; its gloss is ``LOOK-HABITUAL``.

    Raises ``InputError`` if the sign has no movement, or a plural is not made in space or at the base hand.
    """
    if kind not in INFLECTIONS:
        raise InputError(f"form {kind!r}, expected one of {', '.join(INFLECTIONS)}")
    moves = [n for n, segment in enumerate(sign.segments) if segment.kind == "M"]
    if not moves:
        raise InputError(f"{sign.gloss}-{kind.upper()}: {sign.gloss} has no movement to repeat")
    last = moves[-1]
    before, segment = sign.segments[last - 1], sign.segments[last]
    changes_posture = (segment.strong, segment.weak) != (before.strong, before.weak)
    segments = list(sign.segments)
    if kind == "plural" and changes_posture:
        segments[last] = replace(segment, times=3, step=(_FORMS.plural_step_cm, 0.0, 0.0), lift=segment.lift or 3.0)
    elif kind == "plural":
        segments[last:] = [_sidewards(s, sign) for s in segments[last:]]
    elif kind == "habitual":
        repeated = _repeat_movement(segment, changes_posture, 2)
        segments[last] = replace(repeated, tempo=_FORMS.habitual_tempo, seconds=None)
    else:
        repeated = _repeat_movement(segment, changes_posture, 2)
        lift = _FORMS.continuative_arch_cm if changes_posture else 0.0
        segments[last] = replace(repeated, tempo=_FORMS.continuative_tempo, lift=lift, seconds=None)
    gloss = f"{sign.gloss}-{kind.upper()}"
    return _check_sign(replace(sign, gloss=gloss, segments=tuple(segments), synonyms=()))


def _repeat_movement(segment: Segment, changes_posture: bool, n_extra: int) -> Segment:
    """Returns the movement with ``n_extra`` repetitions more, as far as the notation allows; one that does not change
    the posture has cycles or revolutions in proportion instead.
    """
    times = min(segment.times + n_extra, 8)
    if changes_posture:
        return replace(segment, times=times)
    factor = times / segment.times
    local = segment.local and replace(segment.local, cycles=min(segment.local.cycles * factor, 10.0))
    limit = {"circle": 6.0, "zigzag": 8.0}.get(segment.path.kind, 0.0)
    revolutions = float(np.clip(segment.path.revolutions * factor, -limit, limit))
    return replace(segment, local=local, path=replace(segment.path, revolutions=revolutions))


def _sidewards(segment: Segment, sign: Sign) -> Segment:
    """Moves a movement in one place, or a segment that follows it, on to the strong side."""
    strong, weak = segment.strong, segment.weak
    if sign.hands in MIRRORED_HANDS or strong.location not in IN_SPACE | ON_BASE:
        what = f"{sign.gloss}-PLURAL: {sign.gloss} moves in one place"
        raise InputError(f"{what}, and only hands=one or base in space go on from it")
    if strong.location not in ON_BASE:
        strong = replace(strong, shift=_shift_out(strong.shift, 2.0 * _FORMS.plural_step_cm))
    weak = weak and replace(weak, shift=_shift_out(weak.shift, -2.0 * _FORMS.plural_step_cm))
    moved = replace(segment, strong=strong, weak=weak)
    return replace(_repeat_movement(moved, False, 1), seconds=None) if segment.kind == "M" else moved


def _shift_out(shift: Vector, out: float) -> Vector:
    return shift[0] + out, shift[1], shift[2]


def _check_sign(sign: Sign) -> Sign:
    problems = faults(sign)
    if problems:
        raise InputError(f"{sign.gloss} cannot be made: {problems[0]}")
    return sign


def _hands(segment: Segment) -> list[Posture]:
    return [posture for posture in (segment.strong, segment.weak) if posture is not None]


def _yaw(subject: str | None, object: str | None) -> float:
    """The angle about the vertical, radians, positive to the strong side, from straight ahead to the direction from
    subject to object. By default the subject is the signer, the object the addressee; if the signer is the object, the
    hand turns round.
    """
    start, end = (locations.locate(f"locus:{person}", _WEAK_ARM).point for person in (subject or "1", object or "2"))
    outward, forward = -(end - start)[0], (end - start)[2]
    if abs(outward) < 1e-9 and forward <= 0.0:
        return -np.pi  # by the weak side: a hand turns to its own body palm first
    return float(np.arctan2(outward, forward))


def _rotate_yaw(v: Vector, yaw: float) -> Vector:
    """A vector (out, up, forward) turned about the vertical, forward going to out."""
    c, s = float(np.cos(yaw)), float(np.sin(yaw))
    return v[0] * c + v[2] * s, v[1], v[2] * c - v[0] * s


def _agreeing(posture: Posture, persons: dict[str, str | None], yaw: float, is_weak: bool = False) -> Posture:
    """A posture at the locus of a person; unchanged if it is at neither of the verb's ends."""
    person = persons.get(posture.location)
    if person is None:
        return posture
    if is_weak:  # the weak hand is written as if it were the strong one
        person = {"3": "3-weak", "3-weak": "3"}.get(person, person)
    shift, palm, fingers = (_rotate_yaw(v, yaw) for v in (posture.shift, posture.palm, posture.fingers))
    moved = replace(posture, location=f"locus:{person}", shift=shift, palm=palm, fingers=fingers)
    return moved if yaw == 0.0 or are_easy([moved])[0] else _facing(moved, posture.palm[2] > posture.fingers[2])


def _facing(posture: Posture, by_palm: bool) -> Posture:
    """Returns the posture with the directions of palm and fingers nearest to its own that are easy for its arm,
    unchanged if none is found. ``by_palm``: whether the palm faces the object, and so counts more, else the fingers.
    """
    targets = np.array([posture.palm, posture.fingers])
    directions = _directions(_SEARCH.n_directions)
    rolls = 2.0 * np.pi * np.arange(_SEARCH.n_rolls) / _SEARCH.n_rolls
    fingers = np.repeat(directions, _SEARCH.n_rolls, axis=0)  # (N, 3)
    side = np.cross(fingers, np.array([0.3, 0.8, 0.5]))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    angle = np.tile(rolls, _SEARCH.n_directions)[:, None]
    palms = np.cos(angle) * side + np.sin(angle) * np.cross(fingers, side)
    off = [np.arccos(np.clip(v @ w, -1.0, 1.0)) for v, w in zip((palms, fingers), targets, strict=True)]
    weight = _SEARCH.other_direction_weight
    cost = off[0] + weight * off[1] if by_palm else weight * off[0] + off[1]
    for batch in np.array_split(np.argsort(cost)[: len(cost) // 2], _SEARCH.n_batches):
        tried = [replace(posture, palm=to_vector(palms[k]), fingers=to_vector(fingers[k])) for k in batch]
        taken = np.flatnonzero(are_easy(tried))
        if len(taken):
            return tried[int(taken[0])]
    return posture


def _directions(n: int) -> FloatArray:
    """Unit vectors (n, 3) spread evenly (Fibonacci's lattice on the sphere)."""
    k = np.arange(n) + 0.5
    up, turn = 1.0 - 2.0 * k / n, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - up * up)
    return np.stack([flat * np.cos(turn), up, flat * np.sin(turn)], axis=-1)


_WEAK_ARM = locations.WeakArm(STANDARD, np.zeros(27))
"""A weak arm for ``locations``, which ask for one; strong hands in space do not touch it."""


def are_easy(postures: Sequence[Posture]) -> NDArray[np.bool_]:
    """Whether the standard signer's strong arm takes postures in space without strain
    (``pose.is_well_within_limits``).
    """
    solved = [locations.strong_wrist(posture, _WEAK_ARM) for posture in postures]
    wrists, quats, angles = (np.stack(parts) for parts in zip(*solved, strict=True))
    hand_states = np.concatenate([wrists, pose.hand_rotvecs(wrists, quats, STANDARD), angles], axis=-1)
    return pose.is_well_within_limits(hand_states)
