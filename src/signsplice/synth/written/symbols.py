"""The symbols of HamNoSys 4: names and code points of Hamburg's font, as its conversion tables and SiGML name them.

The names are those of the elements of HamNoSys SiGML without their ``ham``. The rows agree with the table of the
package ``hamnosys`` 0.1.0 (MIT), which is not needed to run: a test compares them where it is installed.
"""

from __future__ import annotations

_DIRECTIONS = ("u", "ur", "r", "dr", "d", "dl", "l", "ul", "ol", "o", "or", "il", "i", "ir", "ui", "di", "do", "uo")
_AXES = ("o", "i", "d", "u", "l", "r", "ul", "dr", "ur", "dl", "ol", "ir", "or", "il", "ui", "do", "uo", "di")
_ROWS = {
    0xE000: "fist flathand finger2 finger23 finger23spread finger2345 pinch12 pinchall pinch12open cee12 ceeall "
    "ceeopen thumboutmod thumbacrossmod thumbopenmod",
    0xE010: "fingerstraightmod fingerbendmod fingerhookmod doublebent doublehooked",
    0xE020: " ".join(f"extfinger{d}" for d in _DIRECTIONS),
    0xE038: "palmu palmur palmr palmdr palmd palmdl palml palmul",
    0xE040: "head headtop forehead eyebrows eyes nose nostrils ear earlobe cheek lips tongue teeth chin underchin neck "
    "shouldertop shoulders chest stomach belowstomach",
    0xE058: "lrbeside lrat coreftag corefref",
    0xE05F: "neutralspace upperarm elbow elbowinside lowerarm wristback wristpulse thumbball palm handback thumbside "
    "pinkyside",
    0xE070: "thumb indexfinger middlefinger ringfinger pinky fingertip fingernail fingerpad fingermidjoint fingerbase "
    "fingerside",
    0xE07C: "wristtopulse wristtoback wristtothumb wristtopinky",
    0xE080: " ".join(f"move{d}" for d in _DIRECTIONS),
    0xE092: " ".join(f"circle{d}" for d in _AXES),
    0xE0A4: "fingerplay nodding swinging twisting stircw stirccw replace",
    0xE0AD: "movecross moveX nomotion clocku clockul clockl clockdl clockd clockdr clockr clockur clockfull arcl arcu "
    "arcr arcd wavy zigzag",
    0xE0C0: "ellipseh ellipseur ellipsev ellipseul increasing decreasing smallmod largemod fast slow tense rest halt",
    0xE0D0: "close touch interlock cross armextended behind brushing",
    0xE0D8: "repeatfromstart repeatfromstartseveral repeatcontinue repeatcontinueseveral repeatreverse "
    "alternatingmotion",
    0xE0E0: "seqbegin seqend parbegin parend fusionbegin fusionend between plus symmpar symmlr nondominant nonipsi etc "
    "orirelative",
    0xE0F0: "mime version40",
}  # fmt: skip
SYMBOLS = {chr(first + n): name for first, row in _ROWS.items() for n, name in enumerate(row.split())}
"""Code point -> name."""
NAMES = frozenset(SYMBOLS.values())
ALIASES = {
    "pinchopen": "pinch12open", "cee12open": "ceeopen", "flat": "flathand", "movex": "moveX",
    "repeatreversed": "repeatreverse",
}  # fmt: skip
"""Names that are written for others by mistake or by habit -> the names."""

SHAPES = {
    name: {"flathand": "flat", "ceeopen": "cee12open"}.get(name, name)
    for name in _ROWS[0xE000].split()[:12]
}  # fmt: skip
THUMBS = {"thumboutmod": "out", "thumbacrossmod": "across", "thumbopenmod": "opposed"}
BENDS = {
    "fingerstraightmod": "bent", "fingerbendmod": "round", "fingerhookmod": "hooked", "doublebent": "dblbent",
    "doublehooked": "dblhooked",
}  # fmt: skip
DIGITS = {"thumb": 1, "indexfinger": 2, "middlefinger": 3, "ringfinger": 4, "pinky": 5}
FINGER_PARTS = {
    "fingertip": "tip", "fingernail": "nail", "fingerpad": "pad", "fingermidjoint": "midjoint", "fingerbase": "base",
    "fingerside": "side",
}  # fmt: skip
HAND_PARTS = {"palm": "palmar", "handback": "dorsal", "thumbside": "radial", "pinkyside": "ulnar", "thumbball": ""}
"""Parts of a hand -> the side of a finger that they say after one."""
WRIST_SIDES = {"wristback": "dorsal", "wristpulse": "palmar"}
PLACES = {name: name for name in (*_ROWS[0xE040].split(), "upperarm", "elbow", "elbowinside", "lowerarm")}
PLACES |= {"neutralspace": "neutral"}
CONTACTS = ("close", "touch", "interlock", "cross", "armextended", "brushing")
ARCS = {"arcl": "l", "arcu": "u", "arcr": "r", "arcd": "d"}
ELLIPSES = {"ellipseh": "l", "ellipseur": "ur", "ellipsev": "u", "ellipseul": "ul"}
WRISTS = ("nodding", "swinging", "twisting", "stircw", "stirccw")
MANNERS = ("fast", "slow", "tense", "rest", "halt")
REPEATS = {
    "repeatfromstart": "fromstart", "repeatfromstartseveral": "fromstart_several", "repeatcontinue": "continue",
    "repeatcontinueseveral": "continue_several", "repeatreverse": "reverse",
}  # fmt: skip
BRACKETS = {"seqbegin": "seqend", "parbegin": "parend", "fusionbegin": "fusionend"}
