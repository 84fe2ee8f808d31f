"""Constructed HamNoSys signs that use every symbol that is supported, as names; none is a word of a language."""

from __future__ import annotations

from signsplice.written import symbols

CODES = {name: code for code, name in symbols.SYMBOLS.items()}
ELSEWHERE = ("coreftag", "corefref", "wristtopulse", "wristtoback", "wristtothumb", "wristtopinky", "mime", "etc")
"""Symbols that are refused."""
_POINT = "finger2 thumbacrossmod extfingeru palml"
_HAND_PARTS = ("palm", "handback", "thumbside", "pinkyside", "thumbball", "wristback", "wristpulse")
_FLAT = "flathand extfingero palmd"
_TWO = "parbegin flathand extfingerol palmd plus flathand extfingeror palmu parend"
_FORWARD = "shoulders lrat close moveo"


def code(names: str) -> str:
    """The characters of some symbols."""
    return "".join(CODES[name] for name in names.split())


def constructed() -> dict[str, str]:
    """Gloss -> names of its symbols."""
    out: dict[str, str] = {}

    def add(kind: str, names: str) -> None:
        out[f"{kind}-{sum(gloss.startswith(f'{kind}-') for gloss in out) + 1}"] = names

    for shape in symbols.SHAPES:
        add("SHAPE", f"{shape} extfingerol palml {_FORWARD}")
    for thumb in symbols.THUMBS:
        add("THUMB", f"flathand {thumb} extfingerul palmd chest close mover")
    for bend in symbols.BENDS:
        add("BEND", f"finger23 {bend} extfingerul palmd {_FORWARD} smallmod")
        add("BEND", f"flathand pinky {bend} extfingeruo palmd {_FORWARD}")
    for digit in symbols.DIGITS:
        add("SPECIAL", f"finger2 {digit} extfingeru palmd {_FORWARD} smallmod")
    add("BETWEEN", f"flathand between finger2345 thumboutmod extfingerul palmd {_FORWARD}")
    add("BETWEEN", f"flathand fingerbendmod between fingerhookmod extfingerul palmd {_FORWARD}")
    add("CROSSED", f"finger23 indexfinger cross middlefinger extfingeru palmd {_FORWARD}")
    add("ENCLOSED", f"fist thumb between indexfinger middlefinger extfingeru palmd {_FORWARD}")
    for name in (n for n in CODES if n.startswith("extfinger")):
        across = "palmd" if name.removeprefix("extfinger") in ("l", "r", "ul", "ur", "dl", "dr", "o", "ol") else "palml"
        place = "stomach" if name in ("extfingerd", "extfingerdl", "extfingerdr") else "shoulders"
        add("FINGERS", f"flathand {name} {across} {place} close moveu smallmod")
    for name in (n for n in CODES if n.startswith("palm") and n != "palm"):
        add("PALM", f"flathand extfingero {name} chest lrat close moveo smallmod")
    add("MEAN", "flathand extfingerol between extfingero palmd between palmdl chest close moveo")
    for place in symbols.PLACES:
        close = "armextended" if place == "neutralspace" else "touch"
        hand = "finger2 thumbacrossmod extfingerl palmd" if place == "headtop" else _POINT
        add("PLACE", f"{hand} {place} {close} moveo smallmod repeatfromstart")
    for side in ("lrat", "lrbeside"):
        add("SIDE", f"{_FLAT} {side} shoulders close moveo smallmod")
        add("SIDE", f"{_FLAT} chest {side} close moveo smallmod")
    add("HALFWAY", f"{_FLAT} chest between stomach close mover")
    add("BEHIND", f"{_POINT} ear behind close moved smallmod")
    for part in (*symbols.FINGER_PARTS, "thumbside", "pinkyside", "handback", "palm"):
        finger = "indexfinger " if part in symbols.FINGER_PARTS else ""
        add("OWN", f"{_POINT} chin seqbegin touch {finger}{part} seqend moveo smallmod")
    for part in _HAND_PARTS:
        add(
            "SITE",
            f"symmlr parbegin finger2 plus flathand parend extfingero palmd {part} touch moveu smallmod",
        )
    add(
        "MEET", f"symmlr {_FLAT} parbegin palm plus fingertip middlefinger parend touch chest close mover replace palmu"
    )
    joint = "indexfinger fingermidjoint"
    for contact in ("touch", "close", "cross", "interlock"):
        add(
            "PAIR",
            f"symmlr finger2 extfingerol palmd parbegin {joint} plus {joint} parend {contact} moved repeatfromstart",
        )
    for name in (n for n in CODES if n.startswith("move") and n not in ("movecross", "moveX")):
        add("MOVE", f"{_POINT} shoulders lrat close {name}")
    for name in (n for n in CODES if n.startswith("circle")):
        add("CIRCLE", f"{_POINT} shoulders lrat close {name} smallmod repeatfromstart")
    for clock in ("clocku", "clockul", "clockl", "clockdl", "clockd", "clockdr", "clockr", "clockur"):
        add("CLOCK", f"{_POINT} shoulders close circleo {clock}")
    add("CLOCK", f"{_POINT} shoulders close circleo clocku clockd clockfull")
    for ellipse in symbols.KINDS["ellipse"]:
        add("ELLIPSE", f"{_POINT} shoulders close circleo {ellipse} largemod")
    for arc in symbols.KINDS["arc"]:
        across = "moveo" if arc in ("arcl", "arcr") else "mover"
        add("ARC", f"{_POINT} shoulders close {across} {arc} largemod")
    for zigzag in ("wavy", "zigzag"):
        add("ZIGZAG", f"{_POINT} shoulders close moveo {zigzag} smallmod")
    for size in ("smallmod", "largemod", "increasing", "decreasing"):
        add("SIZE", f"{_FLAT} chest close circleu {size} repeatfromstartseveral")
    for manner in symbols.KINDS["manner"]:
        add("MANNER", f"{_FLAT} chest close moved {manner}")
    for wrist in (*symbols.KINDS["wrist"], "fingerplay"):
        add("LOCAL", f"finger2345 thumboutmod extfingeruo palmd shoulders close {wrist}")
    for crossing in ("movecross", "moveX", "nomotion"):
        add("OTHER", f"{_FLAT} chest close {crossing}")
    for repeat in symbols.REPEATS:
        add("REPEAT", f"{_POINT} shoulders lrat close moveo smallmod {repeat}")
    add("BRACKET", f"{_FLAT} chest close parbegin moveo replace extfingeru palmd parend")
    add("BRACKET", f"{_FLAT} chest close seqbegin mover movel seqend repeatfromstart")
    add("BRACKET", f"{_FLAT} chest close fusionbegin moved moveo fusionend")
    add("BRUSH", f"{_FLAT} chest close movel chest brushing")
    add("TARGET", f"{_POINT} shoulders lrat close moveui chin touch")
    add("HANDS", f"symmpar {_FLAT} chest close mover")
    add("HANDS", f"symmlr alternatingmotion {_FLAT} shoulders lrat close moved smallmod repeatfromstart")
    add("HANDS", f"symmlr nonipsi {_FLAT} shoulders close moved")
    add("HANDS", f"nondominant {_FLAT} chest close mover")
    add("HANDS", f"symmlr {_FLAT} chest lrat close parbegin moved plus moveu parend repeatfromstart")
    add(
        "HANDS",
        "parbegin finger2 extfingero palmd plus flathand extfingeror palmu parend chest close nondominant moveu",
    )
    add("OTHER", f"version40 {_POINT} orirelative {_FORWARD} repeatfromstart alternatingmotion")
    for symmetry in ("symmlr largemod", "symmlr fingerstraightmod", "symmpar fingerstraightmod largemod"):
        add("FLIPPED", f"{symmetry} fist thumbacrossmod extfingerol palml chest close moveuo smallmod repeatfromstart")
    add("FLIPPED", f"symmlr fingerstraightmod largemod {_POINT} shoulders close circlel smallmod repeatfromstart")
    add("BRUSH", f"{_FLAT} chest lrat close parbegin movel seqbegin brushing chest touch seqend replace palmu parend")
    add("BRUSH", f"{_TWO} palm close movel seqbegin brushing palm touch seqend")
    add("SHIFT", f"{_FLAT} chest close moved smallmod seqbegin repeatfromstartseveral mover seqend")
    add("ZIGZAG", f"{_POINT} shoulders close mover zigzag ellipsev")
    add(
        "MEET",
        "symmlr flathand extfingeru palml parbegin neck plus fingertip middlefinger seqbegin touch fingertip "
        "middlefinger seqend parend moved smallmod",
    )
    add("MEET", "symmlr flathand extfingeruo palml touch shoulders mover")
    add("BEHIND", f"{_FLAT} ear lrat close parbegin movei arcu replace extfingeri parend behind")
    add("BODY", f"{_POINT} chin touch moveo smallmod seqbegin head twisting seqend")
    return out
