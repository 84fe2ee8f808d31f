"""Makes true_splice.json: what the synthetic signer signed when the file was made.

Run as ``python tests/golden/make_true_splice.py``, and only when the signer's motion is meant to change: the file shows
on every machine whether the same seeds still make the same corpus. Positions in cm, joints by name, from the world's
origin between the feet; frames count from 0.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from signsplice.motion import kinematics
from signsplice.signer import notation, planner
from signsplice.signer.signer import JOINTS, draw_signer
from signsplice_workshop.corpora import sentences, truth

HERE = Path(__file__).parent
WORDS = ("MOTHER", "LEARN")
SEED = 3
SHOWN = ("RightHand", "LeftHand", "RightHandIndex3", "Head")


def signed() -> dict[str, Any]:
    """Two words, their splice, and the positions of some joints in some frames."""
    words = [planner.synthesize_word(notation.everyday()[gloss], draw_signer(SEED)) for gloss in WORDS]
    true = truth.splice(words[0], words[1])
    sentence = sentences.utter(words, changes=False).clip
    frames = (0, 20, 30, true.pre, true.pre + 1, true.pre + len(true.states), true.pre + len(true.states) + 1)
    positions = kinematics.forward(sentence, [JOINTS[name] for name in SHOWN])[1]
    golden = {
        "words": WORDS,
        "signer": SEED,
        "joints": SHOWN,
        "frames": [*map(len, words), len(sentence)],
        "events": [[w.events.up, w.events.start, w.events.end, w.events.down] for w in words],
        "splice": [true.pre, true.post, len(true.states)],
        "places": {str(frame): positions[frame].round(9).tolist() for frame in frames},
    }
    return json.loads(json.dumps(golden))  # type: ignore[no-any-return]


def main() -> None:
    """Write the file."""
    (HERE / "true_splice.json").write_text(json.dumps(signed(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
