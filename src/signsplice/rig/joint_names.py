"""Joint names in comparable form: one form for the many spellings of one joint."""

from __future__ import annotations

import re

from signsplice.rig.fingers import starts_with_finger
from signsplice.rig.naming import CONVENTIONS, EYE, SIDES

# What may follow a side's letter without a gap, as in "lshldr"; fingers may too, as in "rthumb1".
_LIMB_WORDS = frozenset(
    word
    for words in (EYE, *(f"{rig.arm} {rig.leg} {rig.marks}" for rig in CONVENTIONS))
    for word in re.split("[ /]", words)
    if word
)
_SIDE_OF = {"l": "left", "left": "left", "r": "right", "right": "right"}
_GAP = re.compile(r"[\W_]+|(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_PREFIX = re.compile(
    r"(?:(?:mixamorig\d*|bip\d+)(?!\d)[\W_]*"
    r"|(?:character\d*|valvebiped|cc[\W_]base|j[\W_](?:bip|adj)(?:[\W_]c(?=[\W_]))?|def|org|skel)[\W_]+)(?=.)",
    re.IGNORECASE,
)


def side_and_words(name: str) -> tuple[str, str]:
    """A joint's side, "" where its name has none, and the words of the rest in lower case, with blanks between them.

    Both without namespace and rig prefix.
    """
    bare = re.split(r"[:|]", name)[-1] or name
    while match := _PREFIX.match(bare):
        bare = bare[match.end() :]
    tokens = [token.lower() for token in _GAP.split(bare) if token]
    at = next((n for n, token in enumerate(tokens) if token in _SIDE_OF), None)
    if at is not None and len(tokens) > 1:
        return _SIDE_OF[tokens.pop(at)], " ".join(tokens)
    words = " ".join(tokens)
    for side, letter in ((side, side[0]) for side in SIDES):
        if words.startswith(side) and words != side:
            return side, words.removeprefix(side)
        rest = words.removeprefix(letter)
        if rest != words and (rest.replace(" ", "") in _LIMB_WORDS or starts_with_finger(rest)):
            return side, rest
    return "", words


def simplify(name: str) -> str:
    """A joint's name in comparable form: no namespace or rig prefix, no gaps, lower case, the side in full in front.

    "mixamorig:LeftArm", "Character1_LeftArm" and "Arm.L" give "leftarm", "Bip01 L UpperArm" gives "leftupperarm".
    Numbers stay as they are. A name of nothing but prefix or gaps is only put in lower case.
    """
    side, words = side_and_words(name)
    return side + words.replace(" ", "") or name.lower()


def without_shared(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names without what all but the root share: an actor's word in front, a word ("_JNT") or number at the end."""
    patterns = [r"_\d+$"]
    for pattern in (r"^([^\W_]+)[\W_]+", r"[\W_]+([^\W_]+)$"):
        match = re.search(pattern, names[-1])
        if match and match[1].lower() not in _SIDE_OF:
            patterns.append(f"^{re.escape(match[0])}" if pattern[0] == "^" else f"{re.escape(match[0])}$")
    for pattern in patterns:
        if all(re.search(pattern, name) for name in names[1:]):
            names = tuple(re.sub(pattern, "", name) or name for name in names)
    return names
