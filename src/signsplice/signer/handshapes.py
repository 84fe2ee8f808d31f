"""Handshapes of American Sign Language, each as the 21 angles of ``hand.ANGLES``; words/handshapes.txt lists them.

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

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import frozen
from signsplice.signer import hand
from signsplice.signer.tables import sections


@dataclass(frozen=True, eq=False)
class Handshape:
    """A configuration of the fingers.

    name: the handshape's name
    angles: the 21 angles of ``hand.ANGLES``, radians, read-only
    """

    name: str
    angles: FloatArray

    @cached_property
    def points(self) -> FloatArray:
        """Positions (20, 3) of ``hand.POINTS`` in the wrist's frame of the standard hand, cm."""
        return hand.points(self.angles)


_TABLE = sections(__file__, "handshapes")
_DEGREES = {name: [float(word) for word in words if word != "|"] for name, *words in _TABLE["shapes"]}
_ANGLES = {name: frozen(np.deg2rad(degrees)) for name, degrees in _DEGREES.items()}
_ANGLES |= {name: _ANGLES[shape] for name, shape in _TABLE["aliases"]}
HANDSHAPES = {name: Handshape(name, angles) for name, angles in _ANGLES.items()}
"""Every handshape by name."""
