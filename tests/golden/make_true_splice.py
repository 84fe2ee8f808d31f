"""Makes true_splice.json with the procedural signer itself: what it signed when the file was made.

Run as ``python tests/golden/make_true_splice.py``, and only when the signer's motion is meant to change: the file says
on every machine whether the same seeds still make the same corpus. Places in cm, joints by name, from the world's
origin between the feet; frames count from 0.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from signsplice.motion import kinematics
from signsplice.synth import notation, planner, running, truth
from signsplice.synth.signer import JOINTS, signer

HERE = Path(__file__).parent
WORDS = ("MOTHER", "LEARN")
SEED = 3
SHOWN = ("RightHand", "LeftHand", "RightHandIndex3", "Head")


def signed() -> dict[str, Any]:
    """Two words, their splice, and the places of some joints in some frames of each."""
    words = [planner.isolated(notation.everyday()[gloss], signer(SEED)) for gloss in WORDS]
    true = truth.splice(*words)
    said = running.utter(words, changes=False).clip
    told: dict[str, Any] = {"words": WORDS, "signer": SEED, "joints": SHOWN}
    told["frames"] = [*map(len, words), len(said)]
    told["events"] = [[w.events.up, w.events.start, w.events.end, w.events.down] for w in words]
    told["splice"] = [true.pre, true.post, len(true.states)]
    at = (0, 20, 30, true.pre, true.pre + 1, true.pre + len(true.states), true.pre + len(true.states) + 1)
    places = kinematics.forward(said, [JOINTS[name] for name in SHOWN])[1]
    told["places"] = {str(frame): places[frame].round(9).tolist() for frame in at}
    return json.loads(json.dumps(told))  # type: ignore[no-any-return]


def main() -> None:
    """Write the file."""
    (HERE / "true_splice.json").write_text(json.dumps(signed(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
