"""Handshapes of American Sign Language, each as the 21 angles of ``hand.ANGLES``.

Their descriptions follow Stokoe, Casterline and Croneberg (1965, A Dictionary of American Sign Language on Linguistic
Principles), Liddell and Johnson (1989, American Sign Language: The Phonological Base), Tennant and Gluszak Brown (1998,
The American Sign Language Handshape Dictionary) and the public page "American manual alphabet" of Wikipedia. The angles
were made for this project: solved once for contact without one finger passing through another (least squares within
``hand.LIMITS``), inspected in pictures, and rounded to a degree. No signer has checked them.

A name is a capital letter of the manual alphabet or a number, with a suffix for a variant: ``-open`` (the thumb or the
contact released), ``-closed`` (closed), ``-bent`` (bent at the knuckles, or crooked), ``-claw`` (all fingers crooked
and spread), ``-flat`` (bent at the knuckles only), ``-small`` (thumb and index finger alone). Some names are words:
index, thumb, horns, hook, rest and ILY. Two names may share one shape, as H and U do: those signs differ by the
direction of the hand or by movement. All are right hands; a left hand has the same angles, mirrored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property

import numpy as np

from signsplice.errors import InputError
from signsplice.motion.arrays import FloatArray
from signsplice.synth import hand


@dataclass(frozen=True, eq=False)
class Handshape:
    """A configuration of the fingers.

    name: the handshape's name
    angles: the 21 angles of ``hand.ANGLES``, radians, read-only
    note: how it is formed
    """

    name: str
    angles: FloatArray
    note: str

    def __post_init__(self) -> None:
        angles = np.array(self.angles, np.float64)
        if angles.shape != (len(hand.ANGLES),):
            raise InputError(f"handshape {self.name!r}: {angles.shape} angles, expected {len(hand.ANGLES)}")
        angles.flags.writeable = False
        object.__setattr__(self, "angles", angles)

    @cached_property
    def points(self) -> FloatArray:
        """Positions (20, 3) of ``hand.POINTS`` in the wrist's frame of the standard hand, cm."""
        return hand.points(self.angles)


# Degrees: of each finger spread, MCP, PIP, DIP; of the thumb flexion, abduction, opposition, MCP, IP. See hand.ANGLES.
_TABLE = """
                   index |         middle |           ring |         little |               thumb
A           0  84 102  66 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |   8 -10  31  23  11
    fist, the thumb upright against the side of the index finger
B           0   0   3   3 |   0   0   3   3 |   0   0   3   3 |   0   0   3   3 |  21  -4  38  70  66
    fingers straight and together, the thumb folded across the palm
C           0  27  52  34 |   0  32  52  34 |   0  36  50  32 |   0  38  46  30 | -11  44  37  50  27
    fingers together and curved, the thumb opposite, wide apart
D           0   3   4   4 |  -5  47  59  38 |  -1  56  51  36 |  -5  44  42  32 |  27  43  62  29  29
    index finger up, the others round to the thumb's tip
E           0  44 103  59 |   0  40 105  62 |   0  44 105  62 |   0  48 103  58 |   8  16  20  69  61
    fingers folded down, their tips on the thumb that lies below them
F          -1  46  50  31 |  -2   6   5   4 |  10   2   3   3 |  16   2   3   3 |   6  29  50  22  21
    tips of thumb and index finger meet, the other fingers up and spread
G           1  25   5   3 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |  16  -6  22  10  13
    index finger and thumb straight, side by side, a gap between them; the others in a fist
I           0  84 103  66 |   0  86 104  68 |   0  86 104  68 |   0   2   3   3 |   2  35  32  47  55
    little finger up, the others in a fist, the thumb across them
K           6   3   3   3 |  -2  48   8   5 |   0  86 104  68 |   0  86 102  64 |  20  -7  37  27  15
    index finger up, middle finger forward, the thumb's tip on the side of the middle finger's first bone
L           0   2   3   3 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 | -20 -12   0  -6 -10
    index finger up, the thumb straight out to the side
M           0  64  82  34 |   0  66  82  34 |  -1  54  75  34 |   0  92 102  66 |  50  -1  31  44   8
    three fingers folded over the thumb, whose tip lies between ring and little finger
N           0  62  84  36 |   1  53  80  36 |   0  90 104  68 |   0  86 102  64 |  34  -2  28  41  18
    two fingers folded over the thumb, whose tip lies between middle and ring finger
O          -6  45  49  38 |  -1  52  57  37 |  -2  50  52  37 |  -6  41  40  32 |  10  35  54  26  30
    fingers together and curved until they meet the thumb's tip
R          -8  13   4   4 |  12  -8  15   8 |   0  86 104  68 |   0  86 102  64 |  26  19  21  46  45
    index and middle finger crossed, the middle finger behind
S           0  83 103  66 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |   4  38  35  48  54
    fist, the thumb across the front of the fingers
T          17  40  86  54 |  -5  85  98  66 |   0  85 100  68 |   0  86 102  64 |   7  -6  27  52  21
    fist, the thumb's tip between index and middle finger
U           0   2   3   3 |   0   2   3   3 |   0  86 104  68 |   0  86 102  64 |  26  22  26  47  44
    index and middle finger up and together, the thumb on the ring finger
V          14   2   3   3 | -13   2   3   3 |   0  86 104  68 |   0  86 102  64 |  26  22  26  47  44
    index and middle finger up and spread, the thumb on the ring finger
W          12   2   3   3 |   0   2   3   3 |  12   2   3   3 |   4  61  44  28 |  50  45  65  41  20
    three fingers up and spread, the tips of thumb and little finger meet
X           0  14  96  62 |   0  86 105  68 |   0  86 104  68 |   0  86 102  64 |  10  26  23  45  53
    index finger hooked, the others in a fist, the thumb across them
Y           0  84 102  66 |   0  86 104  68 |   0  86 104  68 |  26   2   3   3 | -18  -8   0  -4 -10
    thumb and little finger out, the others in a fist
index       0   2   3   3 |   0  86 105  68 |   0  86 104  68 |   0  86 102  64 |  12  27  25  45  53
    index finger up, the others in a fist, the thumb across them
thumb       0  84 102  66 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 | -22 -14   0  -6 -12
    fist, the thumb stretched away from it
3          14   2   3   3 | -12   2   3   3 |   0  86 104  68 |   0  86 102  64 | -14  -6   0  -3  -8
    thumb, index and middle finger out and spread
4          15   2   3   3 |   3   2   3   3 |  10   2   3   3 |  18   2   3   3 |  21  -4  38  70  66
    four fingers straight and spread, the thumb folded across the palm
5          15   2   3   3 |   3   2   3   3 |  10   2   3   3 |  18   2   3   3 | -12  -4   0  -2  -6
    all fingers straight and spread, the thumb out
7          10   2   3   3 |   2   3   3   3 |   2  56  47  29 |  16   4   3   3 |  38  45  65  29  18
    tips of thumb and ring finger meet, the other fingers up and spread
8           8   2   3   3 |  -1  53  49  30 |  10   2   3   3 |  16   2   3   3 |  24  38  58  22  17
    tips of thumb and middle finger meet, the other fingers up and spread
1-bent      0  80   4   4 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |  12   5  25  12  15
    index finger straight, bent at the knuckle; the others in a fist
3-claw     12  14  64  36 | -10  14  64  36 |   0  86 104  68 |   0  86 102  64 | -10  16  10  12  25
    3 with all its fingers crooked
5-claw     14  16  62  36 |   2  16  62  36 |  10  16  62  36 |  18  16  60  36 |  -8  22  12  12  25
    5 with all its fingers crooked, as around a ball
8-open     10   2   3   3 |   0  58  12   6 |  10   2   3   3 |  16   2   3   3 |  -6   8   5   0   0
    5 with the middle finger bent forward at the knuckle
B-bent      0  85   5   5 |   0  85   5   5 |   0  85   5   5 |   0  85   5   5 |  12   5  10   5   5
    fingers straight and together, bent at the knuckles, the thumb beside the palm
B-open      0   0   3   3 |   0   0   3   3 |   0   0   3   3 |   0   0   3   3 |   2 -22   0   0   0
    fingers straight and together, the thumb out beside them
C-flat      0  60   6   4 |   0  62   6   4 |   0  64   6   4 |   0  66   6   4 |  38  32  46   5   0
    fingers together, straight, bent at the knuckles; the thumb opposite, apart, as an open beak
C-small     0  36  54  34 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |   3  41  42  24  18
    index finger and thumb curved, apart; the others in a fist
E-open      0  12  92  52 |   0  14  92  52 |   0  16  92  52 |   0  18  90  50 |  18   4  32  70  67
    fingers bent at their middle joints, their tips clear of the thumb that lies across the palm
F-open      0  40  48  28 |  -2   6   5   4 |  10   2   3   3 |  16   2   3   3 |  12  35  28  18  16
    F with the tips of thumb and index finger apart
G-closed   -1  69  22   8 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |  23  32  54   5   0
    index finger and thumb straight, their pulps together; the others in a fist
G-open      0  44  10   4 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |   6  38  46   5   0
    index finger and thumb straight, opposite, their tips apart, as an open beak; the others in a fist
H-bent      0  30  60  25 |   0  30  60  25 |   0  86 104  68 |   0  86 102  64 |  26  22  26  47  44
    U with both fingers curved down, as legs that hang over an edge
H-open      0   2   3   3 |   0   2   3   3 |   0  86 104  68 |   0  86 102  64 | -14  -6   0   0  -6
    U with the thumb out
L-bent      0  10  70  40 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 | -15   5  10  10  15
    L with the index finger crooked
O-flat     -3  81   8   4 |   0  84  14   9 |   0  80  10   4 |  -3  77   3   3 |  28  41  60  11   3
    fingers together, straight, bent at the knuckles until their pulps meet the thumb's
O-small    -1  45  50  33 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |   7  29  50  21  23
    tips of thumb and index finger meet, the others in a fist
U-bent      0  82   5   5 |   0  84   5   5 |   0  86 104  68 |   0  86 102  64 |  12   5  25  12  15
    index and middle finger straight and together, bent at the knuckles, the thumb beside
V-flat     14  40   3   3 | -13  40   3   3 |   0  86 104  68 |   0  86 102  64 |  26  22  26  47  44
    V, its straight fingers bent at the knuckles, as legs that stand
V-bent     12  10  80  45 | -10  10  80  45 |   0  86 104  68 |   0  86 102  64 |  26  22  26  47  44
    V with both fingers crooked
W-bent     10  10  80  45 |   0  10  80  45 |  10  10  80  45 |   0  79  79  50 |  46  24  42  40  35
    W with its three fingers crooked
X-open      0  34  80  44 |   0  86 104  68 |   0  86 104  68 |   0  86 102  64 |  13  33  34  17  22
    index finger and thumb crooked towards one another, apart, as to pluck a string
ILY         6   2   3   3 |   0  86 104  68 |   0  86 104  68 |  22   2   3   3 | -18  -8   0  -4 -10
    thumb, index and little finger out: I, L and Y in one
horns       4   2   3   3 |   0  86 105  68 |   0  87 103  68 |  12   2   3   3 |  20  36  42  46  52
    index and little finger up, the thumb on the middle and ring fingers
hook        0   6  58  38 |   0  86 105  68 |   0  86 104  68 |   0  86 102  64 |  10  26  23  45  53
    index finger half bent, the others in a fist, the thumb across them
rest        3  22  28  16 |   0  28  32  18 |   2  32  34  18 |   4  34  34  18 |  14  12  12  10  16
    a hand that hangs: fingers gently curled and a little spread, the thumb beside
"""

_ALIASES = {
    "H": ("U", "U, pointing sideways"),
    "J": ("I", "I, whose little finger draws the letter"),
    "P": ("K", "K, pointing down"),
    "Q": ("G", "G, pointing down"),
    "Z": ("index", "the index finger draws the letter"),
    "0": ("O", "the letter O"),
    "1": ("index", "one finger"),
    "2": ("V", "two fingers, the palm turned in"),
    "6": ("W", "thumb and little finger meet"),
    "9": ("F", "thumb and index finger meet"),
    "10": ("thumb", "the thumb, twisted"),
    "25": ("8-open", "the middle finger wags"),
    "20-closed": ("G-closed", "L closes to this in 20"),
    "A-open": ("thumb", "A with the thumb away"),
}
"""Further names -> the shape, and how the signs that use this name differ."""


def _shapes() -> Iterator[Handshape]:
    lines = _TABLE.strip("\n").splitlines()[1:]
    known: dict[str, Handshape] = {}
    for row, note in zip(lines[::2], lines[1::2], strict=True):
        name, numbers = row.split(maxsplit=1)
        known[name] = Handshape(name, np.deg2rad(np.array(numbers.replace("|", " ").split(), np.float64)), note.strip())
    yield from known.values()
    for name, (shape, note) in _ALIASES.items():
        yield Handshape(name, known[shape].angles, f"as {shape}: {note}")


HANDSHAPES: dict[str, Handshape] = {shape.name: shape for shape in _shapes()}
"""Every handshape by name."""


def find(name: str) -> Handshape:
    """The handshape of that name. Raises ``InputError`` with the nearest names where there is none."""
    if name in HANDSHAPES:
        return HANDSHAPES[name]
    folded = {known.casefold(): known for known in HANDSHAPES}
    near = [folded[match] for match in get_close_matches(name.casefold(), folded, n=4, cutoff=0.4)]
    listed = ", ".join(near or HANDSHAPES)
    raise InputError(f"no handshape {name!r}; {'nearest' if near else 'known'}: {listed}")
