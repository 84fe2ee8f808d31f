"""The naming conventions of humanoid rigs, as tables: which word stands for which part of the body.

Words are in the form that ``joint_names.simplify`` gives, without the side: ``LeftForeArm``, ``forearm.L`` and
``lForeArm`` are all ``forearm``. A slash separates spellings of one joint, best first. Fingers have no tables, see
``fingers``.
"""

from __future__ import annotations

from dataclasses import dataclass

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


_HIK_ARM, _HIK_LEG = "shoulder arm forearm hand", "upleg leg foot toebase/toe"
_VRM_ARM, _VRM_LEG = "shoulder upperarm lowerarm hand", "upperleg lowerleg foot toes/toe"
_VRM_SPINE = "spine chest upperchest"

# Where two rigs explain a skeleton equally well, the one that stands first here gives its name.
CONVENTIONS = (
    # MotionBuilder's names: Mixamo, Vicon's and Rokoko's exports for it, Captury, LaFAN1.
    NamingConvention("mixamo", _HIK_ARM, _HIK_LEG),
    NamingConvention("neuron", _HIK_ARM, _HIK_LEG, marks="inhandthumb inhandindex inhandmiddle inhandring inhandpinky"),
    NamingConvention("cmu", _HIK_ARM, _HIK_LEG, marks="hipjoint lowerback fingerbase"),
    # Vicon's short names, as in the Trinity and BEAT corpora.
    NamingConvention("vicon", "shoulder arm arm1 hand", _HIK_LEG),
    NamingConvention("vrm", _VRM_ARM, _VRM_LEG, spine=_VRM_SPINE, marks="thumbmetacarpal"),
    # Unity Humanoid and VRM 0.x: the thumb's joints bear the fingers' names.
    NamingConvention("unity", _VRM_ARM, _VRM_LEG, spine=_VRM_SPINE, marks="thumbintermediate"),
    NamingConvention("vroid", _VRM_ARM, "upperleg lowerleg foot toebase", spine=_VRM_SPINE),
    NamingConvention(
        "rigify",
        "shoulder upperarm forearm hand",
        "thigh shin foot toe",
        hips="spine",
        neck="spine004",
        head="spine006/head/spine005",
        marks="palm01 palm02 palm03 palm04 heel02",
    ),
    # The classic BVH names (Biovision, Xsens' BVH). They and SMPL-X say shoulder for upper arm, hip for upper leg.
    NamingConvention(
        "bvh",
        "collar shoulder/uparm elbow/lowarm/forearm wrist/hand",
        "hip/upleg knee/lowleg ankle/foot toe/toes/toebase/foot",
        marks="hand chest chest2 chest3 chest4",
    ),
    NamingConvention("smplx", "collar shoulder elbow wrist", "hip knee ankle foot", marks="spine3 hand"),
    # Poser, DAZ and Second Life; Genesis 3 and 8 part a limb's bend from its twist.
    NamingConvention(
        "daz",
        "collar shldr/shldrbend/shoulder forearm/forearmbend hand",
        "thigh/thighbend shin foot toe",
        marks="abdomen abdomen2 abdomenlower carpal1 carpal2 carpal3 carpal4 buttock",
    ),
    NamingConvention(
        "biped",
        "clavicle upperarm forearm hand",
        "thigh calf foot toe0",
    ),
    # MakeHuman's game rig too.
    NamingConvention(
        "unreal",
        "clavicle upperarm lowerarm hand",
        "thigh calf foot ball",
        marks="spine01 indexmetacarpal middlemetacarpal ringmetacarpal pinkymetacarpal",
    ),
    NamingConvention(
        "rokoko",  # Rokoko's own "Newton" skeleton
        "shoulder arm forearm hand",
        "thigh shin foot toe",
    ),
    NamingConvention(
        "xsens",
        "shoulder upperarm forearm/lowerarm hand",
        "upperleg lowerleg foot toe",
        marks="l5 l3 t12 t8 carpus",
    ),
    NamingConvention(
        "characterCreator",
        "clavicle upperarm forearm hand",
        "thigh calf foot toebase",
        neck="necktwist01",
        marks="waist",
    ),
    NamingConvention("optitrack", "shoulder uarm farm hand", "thigh shin foot toe", marks="ab"),
    NamingConvention(
        "acclaim",  # ASF/AMC
        "clavicle humerus radius wrist/hand",
        "femur tibia foot toes",
        hips="root",
        marks="hipjoint lowerback upperback thorax",
    ),
    NamingConvention(
        "makehuman",
        "clavicle upperarm01 lowerarm01 wrist",
        "upperleg01 lowerleg01 foot toe11",
        hips="root",
    ),
    NamingConvention(
        "autorig",
        "shoulder armstretch/arm forearmstretch/forearm hand",
        "thighstretch/thigh legstretch/leg foot toes01",
        hips="rootx",
        neck="neckx",
        head="headx",
    ),
    NamingConvention(
        "advancedSkeleton",
        "scapula shoulder elbow wrist",
        "hip knee ankle toes",
        hips="rootm",
        neck="neckm",
        head="headm",
    ),
    NamingConvention(
        "mmd",
        "shoulder arm elbow wrist",
        "leg knee ankle toe",
        hips="waist/lowerbody/center",
        first_of_thumb=0,
    ),
)
