"""A cutter and a transition of your own, passed to a splice beside those that ship.

Run: python examples/05_own_method.py [FOLDER]     (writes FOLDER/own_method.bvh; default out/examples)
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import signsplice as ss


class AfterThird(ss.Cutter):
    """Leaves a sign before its last third and enters the next after its first third."""

    name, summary = "after-third", "a third of each clip is left out at the seam"

    def cut(self, before: ss.Clip, after: ss.Clip) -> ss.Cut:
        """The last frame kept of the clip before, and the first kept of the clip after."""
        return ss.Cut(pre=len(before) * 2 // 3, post=len(after) // 3)


def cosine(problem: ss.CurveProblem) -> NDArray[np.float64]:
    """Displacements (n, K, 3) at the n new frames of K vectors: joint rotations, and the root's position."""
    # 0 at the last frame before the gap, 1 at the first after it. The curve stands still at both: it does not go on at
    # the speed of the signs (``problem.velocities``), which the curves that ship do.
    u = problem.times[:, None, None] / problem.seconds  # (n, 1, 1)
    return np.asarray((0.5 - 0.5 * np.cos(np.pi * u)) * problem.displacement)


def main(folder: Path) -> None:
    """Splice the same words by methods that ship and by one's own."""
    folder.mkdir(parents=True, exist_ok=True)
    with ss.open_lexicon() as lexicon:
        words = [lexicon.clip(gloss) for gloss in ("I", "LIKE", "COFFEE")]
    # An object takes the place of a name; cutter and transition can be chosen apart.
    own = ss.SpliceOptions(cutter=AfterThird(), transition=ss.CurveTransition("cosine", "eases out and in", cosine))
    for options in (ss.SpliceOptions(cutter="pose-velocity", transition="hermite"), own):
        result = ss.splice(words, options)
        jumps = ", ".join(f"{seam.velocity_jump:.2f}" for seam in result.seams)
        print(f"{result.cutter} and {result.transition}: {len(result.clip)} frames, velocity jumps {jumps} m/s")
    ss.save(result.clip, folder / "own_method.bvh")
    print(f"wrote {folder / 'own_method.bvh'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples"))
