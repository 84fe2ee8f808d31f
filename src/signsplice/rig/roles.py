"""Finds the joints of a skeleton that play the roles of one canonical humanoid, by their names.

The roles are VRM 1.0's humanoid bones. The naming conventions of humanoid rigs are one table, in the form that
``simplify`` gives to the many spellings of one joint, without the side: ``LeftForeArm``, ``forearm.L`` and ``lForeArm``
are all ``forearm``; a slash separates spellings of one joint, best first. The convention that explains most joints of a
skeleton is chosen, since a name may mean two things: "LeftShoulder" is the collar bone of one rig, the upper arm of
another. No assignment may break the order of the body: a hand hangs below its arm, an arm below the hips. Fingers have
one rule for all rigs, in ``fingers``.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Skeleton
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.fingers import find_fingers, starts_with_finger

HIPS = "hips/hip/pelvis"
"""Words of most rigs for the hips, tried after a rig's own."""
NECK = "neck/neck1/neck01/necklower/lowerneck"
"""The same for the neck."""
HEAD = "head"
"""The same for the head."""
EYE = "eye/faceeye/eyesmplhf"
"""The same for the eyes."""
JAW = "jaw/jawroot/facejaw"
"""The same for the jaw."""
SIDES = ("left", "right")
"""Left and right, as role names begin; arrays of both hands have them in this order."""
CHANNELS = ("left arm", "right arm", "trunk", "head")
"""Parts of a person that a word may move; an arm is all joints from the collar bone to the fingertips."""


@dataclass(frozen=True)
class NamingConvention:
    """One naming convention; words separated by blanks.

    name: of the convention, as ``inspect`` shows it.
    arm: collar bone, upper arm, lower arm, hand.
    leg: upper leg, lower leg, foot, toes.
    hips, neck, head: the convention's own words, tried before the usual ones.
    spine: spine, chest, upper chest, if the rig has different names for them; else they are counted off between hips
        and neck.
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
# Rigify's first version splits a limb into two bones, as upper_arm.L.01 and .02 or upper_arm.01.L.
rigify    | shoulder upperarm/upperarm01 forearm/forearm01 hand | thigh/thigh01 shin/shin01 foot toe | hips spine
    | neck spine004 | head spine006/head/spine005 | marks palm01 palm02 palm03 palm04 heel02
# The classic BVH names (Biovision, Xsens' BVH). They and SMPL-X say shoulder for upper arm, hip for upper leg.
bvh       | collar shoulder/uparm elbow/lowarm/forearm wrist/hand
    | hip/upleg knee/lowleg ankle/foot toe/toes/toebase/foot | marks hand chest chest2 chest3 chest4
smplx     | collar shoulder elbow wrist | hip knee ankle foot | marks spine3 hand
# Poser, DAZ and Second Life; Genesis 3 and 8 split a limb into bones for bend and twist.
daz       | collar shldr/shldrbend/shoulder forearm/forearmbend hand | thigh/thighbend shin foot toe
    | marks abdomen abdomen2 abdomenlower carpal1 carpal2 carpal3 carpal4 buttock
biped     | clavicle upperarm forearm hand | thigh calf foot toe0
# MakeHuman's game rig uses these names too.
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
# MikuMikuDance, in Japanese (``_JAPANESE``) or English, also as mmd_tools translates it.
mmd       | shoulder arm elbow wrist | leg knee ankle toe/toetip | hips waist/lowerbody/center | thumb 0
    | spine upperbody upperbody2 | marks upperbody3 lowerbody groove
# Meta Quest's OVRSkeleton; its hands alone are called b_l_wrist, Hand_WristRoot or XRHand_Wrist.
quest     | shoulder armupper armlower handwrist/wrist/handwristroot/xrhandwrist/hand
    | upperleg lowerleg footankle football
    | marks scapula handpalm handwristtwist forearmstub footankletwist footsubtalar foottransverse
# Second Life's avatar, whose names begin with m; its ankle is the foot, its foot the ball.
secondLife | collar shoulder elbow wrist | hip knee ankle foot | spine torso chest | marks skull toe groin
"""
_JAPANESE = """
左 left 右 right センター center グルーブ groove 腰 waist 下半身 lowerbody 上半身 upperbody 首 neck 頭 head 両目 eyes
目 eye 下あご jaw あご jaw 顎 jaw 肩 shoulder 腕 arm ひじ elbow 肘 elbow 手首 wrist 親指 thumb 人指 index 人差指 index
人差し指 index 中指 middle 薬指 ring 小指 little 足 leg ひざ knee 膝 knee 足首 ankle つま先 toe 捩 twist 先 tip
"""
"""MikuMikuDance's words for parts of the body, each before its English one."""


def _conventions() -> Iterator[NamingConvention]:
    for row in re.sub(r"\n +", " ", re.sub(r"#.*\n", "", _TABLE)).strip().splitlines():
        name, arm, leg, *fields = (cell.strip() for cell in row.split("|"))
        words = dict(cell.split(" ", 1) for cell in fields)
        yield NamingConvention(name, arm, leg, first_of_thumb=int(words.pop("thumb", "1")), **words)


CONVENTIONS = tuple(_conventions())
"""If two rigs explain a skeleton equally well, the first one here gives its name."""

# Words that may follow a side's letter without a gap, as in "lshldr"; so may fingers, as in "rthumb1".
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
    r"|(?:character\d*|valvebiped|cc[\W_]base|j[\W_](?:bip|adj)(?:[\W_]c(?=[\W_]))?|def|org|skel|(?:full)?body)[\W_]+"
    r"|c_(?=(?:spine|neck|head|jaw)\d*$)|b_(?=[lr]_)|(?-i:m(?=[A-Z][a-z])))(?=.)",
    re.IGNORECASE,
)
_ENGLISH = dict(zip(_JAPANESE.split()[::2], _JAPANESE.split()[1::2], strict=True))
_JAPANESE_WORD = re.compile("|".join(sorted(_ENGLISH, key=len, reverse=True)))


def side_and_words(name: str) -> tuple[str, str]:
    """Returns a joint's side ("" without one) and the other words of its name in lower case, separated by blanks.

    Namespace and rig prefix are removed, Japanese words translated, their full-width digits and half-width letters too.
    """
    bare = re.split(r"[:|]", name)[-1] or name
    if not bare.isascii():
        bare = _JAPANESE_WORD.sub(lambda word: f" {_ENGLISH[word[0]]} ", unicodedata.normalize("NFKC", bare)).strip()
    while match := _PREFIX.match(bare):
        bare = bare[match.end() :]
    tokens = [token.lower() for token in _GAP.split(bare) if token]
    index = next((n for n, token in enumerate(tokens) if token in _SIDE_OF), None)
    if index is not None and len(tokens) > 1:
        return _SIDE_OF[tokens.pop(index)], " ".join(tokens)
    words = " ".join(tokens)
    for side, letter in ((side, side[0]) for side in SIDES):
        if words.startswith(side) and words != side:
            return side, words.removeprefix(side)
        rest = words.removeprefix(letter)
        if rest != words and (rest.replace(" ", "") in _LIMB_WORDS or starts_with_finger(rest)):
            return side, rest
    return "", words


def simplify(name: str) -> str:
    """Returns a joint's name without namespace, rig prefix and gaps, in lower case, with the full side in front.

    "mixamorig:LeftArm", "Character1_LeftArm" and "Arm.L" give "leftarm", "Bip01 L UpperArm" gives "leftupperarm".
    Numbers do not change. A name of only prefix or gaps is converted to lower case.
    """
    side, words = side_and_words(name)
    return side + words.replace(" ", "") or name.lower()


def without_shared(names: tuple[str, ...]) -> tuple[str, ...]:
    """Removes what all names but the root's share: an actor's name in front, a word ("_JNT") or number at the end."""
    patterns = [r"_\d+$"]
    for pattern in (r"^([^\W_]+)[\W_]+", r"[\W_]+([^\W_]+)$"):
        match = re.search(pattern, names[-1])
        if match and match[1].lower() not in _SIDE_OF:
            patterns.append(f"^{re.escape(match[0])}" if pattern[0] == "^" else f"{re.escape(match[0])}$")
    for pattern in patterns:
        if all(re.search(pattern, name) for name in names[1:]):
            names = tuple(re.sub(pattern, "", name) or name for name in names)
    return names


_SPINE = ("spine", "chest", "upperChest")
ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")
FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
"""The fingers, as role names have them."""


def finger_roles(finger: str) -> tuple[str, str, str]:
    """Returns a finger's roles from the palm outwards, without the side: ThumbMetacarpal, ThumbProximal, ThumbDistal
    for the thumb, proximal, intermediate and distal for the others.
    """
    segments = ("Metacarpal", "Proximal", "Distal") if finger == "Thumb" else ("Proximal", "Intermediate", "Distal")
    first, middle, last = (finger + segment for segment in segments)
    return first, middle, last


# The body as chains of roles from the trunk out, limbs without their side. Shoulders and neck hang from the hips here,
# not from the chest: which joint of the spine carries them differs from rig to rig.
_TRUNK: tuple[tuple[str, ...], ...] = (("hips", *_SPINE), ("hips", "neck", "head", "jaw"))
_LIMBS = (("head", "Eye"), ("hips", *ARM), *(("Hand", *finger_roles(finger)) for finger in FINGERS), ("hips", *_LEG))


def _roles_above() -> dict[str, tuple[str, ...]]:
    """Returns role -> all roles above it, the nearest first; roles come after those above them."""
    above: dict[str, tuple[str, ...]] = {"hips": ()}
    for chain in _TRUNK:
        for over, role in pairwise(chain):
            above[role] = (over, *above[over])
    for side in SIDES:
        for chain in _LIMBS:
            for over, role in pairwise(part if part in above else side + part for part in chain):
                above[role] = (over, *above[over])
    return above


_ROLES_ABOVE = _roles_above()
ROLES: tuple[str, ...] = tuple(_ROLES_ABOVE)
"""Every role: the names of VRM 1.0's humanoid bones, each after those that it hangs from."""
_LEAST_BONE = 1e-6
"""Arm bones shorter than this fraction of the longest count as having no length."""
_MIN_ROLES = 3
"""Least number of joints that must fit a convention: fewer may fit by chance."""


@dataclass(frozen=True)
class Humanoid:
    """The body found in a skeleton.

    rig: the naming convention, a name in ``CONVENTIONS``; "custom" if a user named roles, "unknown" if no convention
        fits.
    joints: role -> joint index, immutable, in the order of ``ROLES``.

    Raises ``InputError`` for an unknown role, or one joint in two roles.
    """

    rig: str
    joints: Mapping[str, int]

    def __post_init__(self) -> None:
        unknown = next((role for role in self.joints if role not in _ROLES_ABOVE), None)
        if unknown is not None:
            raise InputError(f"humanoid: {unknown_role(unknown)}")
        if len(set(self.joints.values())) < len(self.joints):
            raise InputError(f"humanoid: one joint has two roles in {dict(self.joints)}, expected one at most")
        ordered = {role: int(self.joints[role]) for role in ROLES if role in self.joints}
        object.__setattr__(self, "joints", MappingProxyType(ordered))

    def joint(self, role: str) -> int | None:
        """Returns the joint that plays ``role``, None if none does."""
        return self.joints.get(role)

    @cached_property
    def role_of(self) -> Mapping[int, str]:
        """Joint index -> its role, for the joints that have one."""
        return MappingProxyType({joint: role for role, joint in self.joints.items()})


FACE_BONES = ("leftEye", "rightEye", "jaw")
"""Roles that a face moves too."""
OFTEN_STILL = ("Eye", "jaw", "Toes")
"""Ends of roles whose joints most recordings leave at rest: they are lost only where they move."""


def body_parts(roles: Iterable[str]) -> list[str]:
    """Returns the parts of the body that roles belong to, for a message: "head", "fingers of the left hand"."""
    sides_of: dict[str, list[str]] = {}
    for role in roles:
        side = next((side for side in SIDES if role.startswith(side)), "")
        name = role.removeprefix(side)
        part = f"{{}} {name.lower().removesuffix('s')}" if side else "trunk" if name in ("hips", *_SPINE) else name
        part = "{} arm" if name in ARM[1:] else "{} leg" if name in _LEG[:-1] else part
        part = "fingers of {} hand" if name.startswith(FINGERS) else part
        sides_of.setdefault(part, []).append(side)
    return [
        f"{part.format('both')}s" if len({*sides}) > 1 else part.format(f"the {sides[0]}")
        for part, sides in sides_of.items()
    ]


def find_lost_roles(joints: Mapping[str, int], kept: Collection[str], moving: Collection[int]) -> list[str]:
    """Returns the roles of a rig (role -> joint) whose motion is lost where only ``kept`` ones have a joint; those of
    ``OFTEN_STILL`` only if the joint is ``moving``. Rigs divide the spine differently, and some have no neck: another
    joint of the spine, or the head, carries on the direction of such a joint.
    """
    carried = {*kept, *(_SPINE if any(role in kept for role in _SPINE) else ()), *(["neck"] * ("head" in kept))}
    lost = [role for role in joints if role not in carried]
    return [role for role in lost if joints[role] in moving or not role.endswith(OFTEN_STILL)]


# --- names ----------------------------------------------------------------------------------------------------------


def _names(convention: NamingConvention) -> dict[str, tuple[str, ...]]:
    """Returns role -> its simplified names in a convention and in common usage, best first."""
    words = {
        "hips": f"{convention.hips}/{HIPS}",
        "neck": f"{convention.neck}/{NECK}",
        "head": f"{convention.head}/{HEAD}",
    }
    words |= {"jaw": JAW, "Eye": EYE}
    words |= zip(_SPINE, convention.spine.split(), strict=False)
    words |= zip(ARM, convention.arm.split(), strict=True)
    words |= zip(_LEG, convention.leg.split(), strict=True)
    names = {}
    for role in ROLES:
        side = next((side for side in SIDES if role.startswith(side)), "")
        spellings = words.get(role.removeprefix(side), "").split("/")
        names[role] = tuple(side + word for word in spellings if word)
    return names


_NAMES = {convention.name: _names(convention) for convention in CONVENTIONS}
_MARKS = {
    convention.name: [side + mark for mark in convention.marks.split() for side in ("", *SIDES)]
    for convention in CONVENTIONS
}


# --- bodies ---------------------------------------------------------------------------------------------------------

_Joints = dict[str, int]


class _Ancestors(dict[int, frozenset[int]]):
    """Joint -> all joints above it, computed on demand: kept for every joint, they would take memory that grows with
    the square of a chain's length.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        self._parents: list[int] = skeleton.parents.tolist()

    def __missing__(self, joint: int) -> frozenset[int]:
        above, over = set(), self._parents[joint]
        while over >= 0:
            above.add(over)
            over = self._parents[over]
        self[joint] = frozenset(above)
        return self[joint]


def find_roles(skeleton: Skeleton, override: Mapping[str, str] | None = None) -> Humanoid:
    """Finds the humanoid in a skeleton: the joint of each role.

    override: role -> joint name, which overrides the conventions; ``skeleton.roles`` by default. ``info.rig_info``
    keeps the answer for a skeleton. Raises ``InputError`` if the override names a role or a joint that does not
    exist, or gives one joint two roles.
    """
    return _find(skeleton, skeleton.roles or {} if override is None else override)


def arm_joints(skeleton: Skeleton, humanoid: Humanoid) -> list[int]:
    """Returns the joints of left then right upper arm, lower arm and hand, then the hips, or the root without hips.
    Raises ``InputError`` if one of an arm's joints is missing or lies at the same place as the one before it.
    """
    names = [side + part for side in SIDES for part in ARM[1:]]
    missing = [name for name in names if name not in humanoid.joints]
    if missing:
        raise InputError(
            f"no {' or '.join(missing[:2])} found among joints {', '.join(skeleton.names[:4])}, ...; "
            "expected both arms by name; name them with a roles file, or use a cutter that needs no arms (ends)"
        )
    arms = [humanoid.joints[name] for name in names]
    chain = rest_positions(skeleton)[[*reversed(arms[:3]), *arms[3:]]]  # from hand to hand
    bones = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    if not bones.min() > _LEAST_BONE * bones.max():
        raise InputError("the arms have a bone without length, or one shoulder lies on the other; expected two arms")
    return [*arms, humanoid.joints.get("hips", 0)]


def _find(skeleton: Skeleton, override: Mapping[str, str]) -> Humanoid:
    named = _resolve_override(skeleton, override)
    ancestors = _Ancestors(skeleton)
    for names in (skeleton.names, without_shared(skeleton.names)):
        index = _index(names)
        by_rig = {rig: _with_names(named, _NAMES[rig.name], index, ancestors) for rig in CONVENTIONS}
        best, *runners_up = sorted(
            CONVENTIONS, key=lambda rig: _count_explained_joints(rig, by_rig[rig], index), reverse=True
        )
        if len(by_rig[best]) >= len(named) + _MIN_ROLES:
            break
    else:
        if not named and len(_with_fingers(by_rig[best], best, names, skeleton, ancestors)) < _MIN_ROLES:
            return Humanoid("unknown", {})
    joints = _with_spine(_with_hips(by_rig[best], ancestors), ancestors)
    for rig in runners_up:  # roles that the best one left open
        names_but_hips = {role: forms for role, forms in _NAMES[rig.name].items() if role != "hips"}
        joints = _with_names(joints, names_but_hips, index, ancestors)
    joints = _with_fingers(joints, best, names, skeleton, ancestors)
    return Humanoid("custom" if named else best.name, joints)


def _count_explained_joints(convention: NamingConvention, joints: _Joints, index: Mapping[str, list[int]]) -> int:
    """How many joints of the body a convention explains, typical joints without a role included."""
    return len(set(joints.values()).union(*(index.get(mark, ()) for mark in _MARKS[convention.name])))


def _resolve_override(skeleton: Skeleton, override: Mapping[str, str]) -> _Joints:
    joints: _Joints = {}
    for role, name in override.items():
        if role not in _ROLES_ABOVE:
            raise InputError(f"override: {unknown_role(role)}")
        if name not in skeleton.index:
            raise InputError(
                f"override: {role}: the skeleton has no joint {name[:80]!r}{_nearest(name[:80], skeleton.names)}; "
                f"its {len(skeleton)} joints begin with {', '.join(skeleton.names[:3])}"
            )
        joint = skeleton.index[name]
        if joint in joints.values():
            other_role = next(role for role, taken in joints.items() if taken == joint)
            raise InputError(f"override: joint {name!r} is both {other_role} and {role}, expected one role for a joint")
        joints[role] = joint
    return joints


def _index(names: tuple[str, ...]) -> dict[str, list[int]]:
    """Simplified name -> the joints that bear it; of Rigify's several, the one that deforms the body first."""
    index: dict[str, list[int]] = {}
    for joint, name in sorted(enumerate(names), key=lambda pair: not pair[1].startswith("DEF")):
        index.setdefault(simplify(name), []).append(joint)
    return index


def _fits(role: str, joint: int, joints: _Joints, ancestors: _Ancestors) -> bool:
    """Whether role and joint are free, and the joint is below what the role hangs from and above what hangs from it."""
    over = next((over for over in _ROLES_ABOVE[role] if over in joints), None)
    return (
        role not in joints
        and joint not in joints.values()
        and (over is None or joints[over] in ancestors[joint])
        and all(joint in ancestors[lower] for below, lower in joints.items() if role in _ROLES_ABOVE[below])
    )


def _with_names(
    joints: _Joints, names: Mapping[str, tuple[str, ...]], index: Mapping[str, list[int]], ancestors: _Ancestors
) -> _Joints:
    """Adds the joints that fit a rig's names (role -> simplified names) without breaking the order of the body."""
    options = {role: [joint for form in forms for joint in index.get(form, ())] for role, forms in names.items()}
    if "hips" in options:
        # The hips carry most of the found joints; the pelvis of DAZ and Character Creator carries only the legs.
        rest = {*joints.values(), *(listed[0] for role, listed in options.items() if listed and role != "hips")}
        load = {joint: sum(joint in ancestors[assigned] for assigned in rest - {joint}) for joint in options["hips"]}
        options["hips"] = sorted((j for j in load if 2 * load[j] >= len(rest - {j})), key=lambda j: -load[j])
    joints = dict(joints)
    for role, candidates in options.items():
        joint = next((joint for joint in candidates if _fits(role, joint, joints, ancestors)), None)
        if joint is not None:
            joints[role] = joint
    return joints


def _with_fingers(
    joints: _Joints, convention: NamingConvention, names: tuple[str, ...], skeleton: Skeleton, ancestors: _Ancestors
) -> _Joints:
    """Adds the fingers below the hands."""
    joints = dict(joints)
    parents, parts = skeleton.parents.tolist(), [side_and_words(name) for name in names]
    for side in SIDES:
        fingers = find_fingers(parents, parts, side, joints.get(side + "Hand"), convention.first_of_thumb)
        for (finger, segment), joint in fingers.items():
            role = side + finger_roles(FINGERS[finger])[segment]
            if _fits(role, joint, joints, ancestors):
                joints[role] = joint
    return joints


def _with_hips(joints: _Joints, ancestors: _Ancestors) -> _Joints:
    """Adds the joint in which legs and trunk meet as hips if no name gives them."""
    legs = [joints[role] for role in ("leftUpperLeg", "rightUpperLeg") if role in joints]
    trunk = [joints[role] for role in ("neck", "head", "leftUpperArm", "rightUpperArm") if role in joints]
    shared = frozenset.intersection(*(ancestors[joint] for joint in legs + trunk)) if len(legs) == 2 and trunk else ()
    if not shared or not _fits("hips", max(shared), joints, ancestors):
        return joints
    return {**joints, "hips": max(shared)}


def _with_spine(joints: _Joints, ancestors: _Ancestors) -> _Joints:
    """Adds the roles of the spine, counted off between hips and neck.

    One joint is the spine, two are spine and chest. Of more, the first is the spine, the last that carries the
    shoulders is the upper chest, and the chest is the middle one.
    """
    arms = (joints.get(f"{side}Shoulder", joints.get(f"{side}UpperArm")) for side in SIDES)
    shoulders = [joint for joint in arms if joint is not None]
    ends = next(([joints[role]] for role in ("neck", "head") if role in joints), shoulders)
    if "hips" not in joints or not ends:
        return joints
    shared = frozenset.intersection(*(ancestors[joint] for joint in ends))
    chain = sorted(joint for joint in shared if joints["hips"] in ancestors[joint])
    if len(chain) > 2:
        carriers = [n for n, joint in enumerate(chain) if all(joint in ancestors[arm] for arm in shoulders)]
        last = max(carriers, default=0)
        last = last if last >= 2 else len(chain) - 1
        chain = [chain[0], chain[(last + 1) // 2], chain[last]]
    joints = dict(joints)
    for role, joint in zip(_SPINE, chain, strict=False):
        if _fits(role, joint, joints, ancestors):
            joints[role] = joint
    return joints


def unknown_role(role: str) -> str:
    """The error message for an unknown role."""
    return f"unknown role {role!r}{_nearest(role, ROLES)}, expected a VRM 1.0 humanoid bone such as leftUpperArm"


def _nearest(word: str, known: Iterable[str]) -> str:
    """Returns the known word most similar to ``word`` as a question for a message; empty if none is similar."""
    spelled = {simplify(name): name for name in reversed(tuple(known))}
    matches = difflib.get_close_matches(simplify(word), spelled, n=1, cutoff=0.5)
    return f" (did you mean {spelled[matches[0]]!r}?)" if matches else ""
