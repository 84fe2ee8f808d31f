"""Draws every manual alphabet that ships as a sheet, to be looked at beside its descriptions.

    python workshop/runs/alphabets.py FOLDER     # FOLDER/alphabet-CODE.png

Each letter shows the hand in its first posture from the front and from the side; one that moves, or takes both hands,
also the signer at its end, with the path of the right hand.
"""

from __future__ import annotations

import sys
from pathlib import Path

from signsplice.lexicon.languages import ALPHABETS
from signsplice.render.picture import Image, draw, draw_dots, draw_hand, make_scene
from signsplice.render.sheet import write_cells
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice.signer.preview import DOT

CELL = 150
"""Side of a picture, pixels."""


def draw_letter(sign: Sign) -> list[tuple[Image, str]]:
    """Returns the pictures of a letter with their labels."""
    word, letter = planner.synthesize_word(sign), sign.gloss.removeprefix("fs-")
    start, stop = word.events.start, word.events.end
    front, side = (make_scene(word.clip, view) for view in ("front", "side"))
    cells = [(draw_hand(scene, start, "right", CELL), letter) for scene in (front, side)]
    if len(sign.segments) > 1 or sign.two_handed:
        path = front.hands[start : stop + 1, 1]
        cells.append((draw_dots(draw(front, stop, CELL, CELL), front, path, DOT, 2.0), f"{letter}: end"))
    return cells


def main() -> None:
    """Writes the sheets and prints their paths."""
    for code in ALPHABETS:
        path = Path(sys.argv[1]) / f"alphabet-{code}.png"
        write_cells([cell for sign in notation.alphabet(code).values() for cell in draw_letter(sign)], path, 12)
        print(path)


if __name__ == "__main__":
    main()
