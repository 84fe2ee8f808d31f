"""Joins words into one continuous animation, and says where each pair was joined.

Run: python examples/01_splice.py [FOLDER]     (writes FOLDER/splice.bvh and FOLDER/splice.glb; default out/examples)
"""

import sys
from pathlib import Path

import signsplice as ss


def main(folder: Path) -> None:
    """Splice three words that ship, and save the result."""
    folder.mkdir(parents=True, exist_ok=True)

    # A word is a clip: a skeleton, and the rotations of its joints over time. Yours come from ss.load("word.bvh").
    with ss.open_lexicon() as lexicon:
        words = [lexicon.clip(gloss) for gloss in ("HELLO", "MY", "NAME")]

    # Without options, the networks that ship choose the cuts and make the new frames.
    result = ss.splice(words)

    # A dictionary clip begins and ends at rest. One after another the arms drop between the words; spliced they do not.
    print(f"one after another {ss.concatenate(words).seconds:.2f} s, spliced {result.clip.seconds:.2f} s")

    # Frames of a sign come from its word, bit for bit, except the joints that it does not move (``span.remade``): those
    # are new, as transitions are, so that a person moves between the signs. Ranges of frames are half-open.
    for span in result.spans:
        print(f"{span.kind:10} {span.name or '':6} frames {span.output[0]:3d} to {span.output[1]:3d}")
    for seam in result.seams:
        print(f"{seam.before} -> {seam.after}: {seam.seconds:.2f} s, fastest wrist {seam.peak_speed_m_s:.2f} m/s")

    # The suffix names the format: .bvh for animation software, .glb for Blender and browsers, with a person in it.
    for name in ("splice.bvh", "splice.glb"):
        ss.save(result.clip, folder / name)
        print(f"wrote {folder / name}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples"))
