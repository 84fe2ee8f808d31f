"""The naming conventions of humanoid rigs, as tables: which word stands for which part of the body;
and joint names in comparable form: one form for the many spellings of one joint.

Words are in the form that ``simplify`` gives, without the side: ``LeftForeArm``, ``forearm.L`` and
``lForeArm`` are all ``forearm``. A slash separates spellings of one joint, best first. Fingers have no tables, see
``fingers``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from signsplice.rig.fingers import starts_with_finger

HIPS, NECK, HEAD = "hips/hip/pelvis", "neck/neck1/neck01/necklower/lowerneck", "head"
EYE, JAW = "eye/faceeye/eyesmplhf", "jaw/jawroot"
"""Words that most rigs use, tried after a rig's own."""
SIDES = ("left", "right")
"""Left and right, as role names begin; arrays of both hands have them in this order."""


@dataclass(frozen=True)
class NamingConvention:
    """One naming convention; words separated by blanks.

    name: of the convention, as ``inspect`` shows it.
    arm: collar bone, upper arm, lower arm, hand.
    leg: upper leg, lower leg, foot, toes.
    hips, neck, head: the convention's own words, tried before the usual ones.
    spine: spine, chest, upper chest, where the rig names them apart; elsewhere they are counted off between hips and
        neck.
    marks: joints that are typical of the rig, beside those above.
    first_of_thumb: number of the thumb's first joint.
    """

    name: str
    arm: str
    leg: str
    hips: str = ""
    neck: str = ""
    head: str = ""
    spine: str = ""
    marks: str = ""
    first_of_thumb: int = 1


# Name | arm | leg | other words, each after its field's name. A line that goes on is indented; # begins a comment.
_TABLE = """
# MotionBuilder's names: Mixamo, Vicon's and Rokoko's exports for it, Captury, LaFAN1.
mixamo    | shoulder arm forearm hand | upleg leg foot toebase/toe
neuron    | shoulder arm forearm hand | upleg leg foot toebase/toe
    | marks inhandthumb inhandindex inhandmiddle inhandring inhandpinky
cmu       | shoulder arm forearm hand | upleg leg foot toebase/toe | marks hipjoint lowerback fingerbase
# Vicon's short names, as in the Trinity and BEAT corpora.
vicon     | shoulder arm arm1 hand | upleg leg foot toebase/toe
vrm       | shoulder upperarm lowerarm hand | upperleg lowerleg foot toes/toe | spine spine chest upperchest
    | marks thumbmetacarpal
# Unity Humanoid and VRM 0.x: the thumb's joints bear the fingers' names.
unity     | shoulder upperarm lowerarm hand | upperleg lowerleg foot toes/toe | spine spine chest upperchest
    | marks thumbintermediate
vroid     | shoulder upperarm lowerarm hand | upperleg lowerleg foot toebase | spine spine chest upperchest
# Its first version parts a limb's bend from its twist, as upper_arm.L.01 and .02 or upper_arm.01.L.
rigify    | shoulder upperarm/upperarm01 forearm/forearm01 hand | thigh/thigh01 shin/shin01 foot toe | hips spine
    | neck spine004 | head spine006/head/spine005 | marks palm01 palm02 palm03 palm04 heel02
# The classic BVH names (Biovision, Xsens' BVH). They and SMPL-X say shoulder for upper arm, hip for upper leg.
bvh       | collar shoulder/uparm elbow/lowarm/forearm wrist/hand
    | hip/upleg knee/lowleg ankle/foot toe/toes/toebase/foot | marks hand chest chest2 chest3 chest4
smplx     | collar shoulder elbow wrist | hip knee ankle foot | marks spine3 hand
# Poser, DAZ and Second Life; Genesis 3 and 8 part a limb's bend from its twist.
daz       | collar shldr/shldrbend/shoulder forearm/forearmbend hand | thigh/thighbend shin foot toe
    | marks abdomen abdomen2 abdomenlower carpal1 carpal2 carpal3 carpal4 buttock
biped     | clavicle upperarm forearm hand | thigh calf foot toe0
# MakeHuman's game rig too.
unreal    | clavicle upperarm lowerarm hand | thigh calf foot ball
    | marks spine01 indexmetacarpal middlemetacarpal ringmetacarpal pinkymetacarpal
# Rokoko's own "Newton" skeleton.
rokoko    | shoulder arm forearm hand | thigh shin foot toe
# SOMA's skeleton of 77 joints, as GEM-X writes it.
soma      | shoulder arm forearm hand | leg shin foot toebase
xsens     | shoulder upperarm forearm/lowerarm hand | upperleg lowerleg foot toe | marks l5 l3 t12 t8 carpus
characterCreator | clavicle upperarm forearm hand | thigh calf foot toebase | neck necktwist01 | marks waist
optitrack | shoulder uarm farm hand | thigh shin foot toe | marks ab
# ASF/AMC.
acclaim   | clavicle humerus radius wrist/hand | femur tibia foot toes | hips root
    | marks hipjoint lowerback upperback thorax
makehuman | clavicle upperarm01/shoulder02 lowerarm01 wrist | upperleg01 lowerleg01 foot toe11 | hips root
autorig   | shoulder armstretch/arm forearmstretch/forearm hand | thighstretch/thigh legstretch/leg foot toes01
    | hips rootx | neck neckx | head headx
advancedSkeleton | scapula shoulder elbow wrist | hip knee ankle toes | hips rootm | neck neckm | head headm
mmd       | shoulder arm elbow wrist | leg knee ankle toe | hips waist/lowerbody/center | thumb 0
"""


def _conventions() -> Iterator[NamingConvention]:
    for row in re.sub(r"\n +", " ", re.sub(r"#.*\n", "", _TABLE)).strip().splitlines():
        name, arm, leg, *others = (cell.strip() for cell in row.split("|"))
        words = dict(cell.split(" ", 1) for cell in others)
        yield NamingConvention(name, arm, leg, first_of_thumb=int(words.pop("thumb", "1")), **words)


CONVENTIONS = tuple(_conventions())
"""Where two rigs explain a skeleton equally well, the one that stands first here gives its name."""

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
    r"|(?:character\d*|valvebiped|cc[\W_]base|j[\W_](?:bip|adj)(?:[\W_]c(?=[\W_]))?|def|org|skel)[\W_]+"
    r"|c_(?=(?:spine|neck|head|jaw)\d*$))(?=.)",
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
