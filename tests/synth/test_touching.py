"""Written signs: hands that touch by the part that is written, and wrists that are spared."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice.motion import rotation
from signsplice.signer import hand, pose
from signsplice.signer.arms import WRISTS, ease_wrists
from signsplice.signer.figure import pose_signer
from signsplice.signer.handshapes import handshape, thumb_depth
from signsplice.signer.location_targets import posture_holds
from signsplice.signer.locations import facing, resting
from signsplice.signer.planner import synthesize_word
from signsplice.signer.signer import STANDARD
from signsplice.written.compiler import compile_sign
from signsplice.written.tree import Motion, Place, Site, WrittenPosture, WrittenShape, WrittenSign


@pytest.mark.parametrize(
    ("shape", "fingers", "palm", "place", "site"),
    [
        ("finger2", "u", "l", "chin", Site("tip", (2,))),
        ("flat", "ul", "d", "forehead", Site("tip", (3,))),
        ("flat", "l", "l", "stomach", Site("palm")),
    ],
)
def test_the_written_part_touches_in_the_written_directions(
    shape: str, fingers: str, palm: str, place: str, site: Site
) -> None:
    start = WrittenPosture(WrittenShape(shape), (fingers,), (palm,), Place(place, contact="touch", hand=site))
    motions = (Motion("straight", ("o",), size="small"),)
    word = synthesize_word(compile_sign(WrittenSign("TRIED", "one", posture=start, motions=motions)))
    posed = pose_signer(word.states, STANDARD)
    wanted = [one for one in posture_holds(word.segments, word.sign, 30.0) if one.posture.touch]
    touches = [(stay.first, stay.posture) for stay in wanted if not stay.which]
    assert touches
    for frame, one in touches:
        assert abs(posed.distance(one, frame)[0]) < 0.5
        turned = pose.hand_rotations(word.states[frame], STANDARD)[0]
        assert rotation.angle_between(turned, facing(one.palm, one.fingers)) < np.deg2rad(12.0)


def test_a_hand_yields_only_where_its_wrist_is_not_easy_and_never_far() -> None:
    states = np.repeat(resting(STANDARD)[None], 13, axis=0)
    states[:, :3] = -15.0, 5.0, 30.0
    usual = pose.hand_rotations(states, STANDARD)
    bends = np.deg2rad(np.linspace(-75.0, 75.0, 13))
    fore = pose.solve_arm(states[:, :3], STANDARD).fore
    written = usual.copy()
    written[:, 0] = rotation.multiply(fore, rotation.exp(bends[:, None] * [0.0, 0.0, 1.0]))
    eased = ease_wrists(states, written, STANDARD, *np.zeros((2, *written.shape[:2], 3)))
    yielded = rotation.angle_between(pose.hand_rotations(eased, STANDARD), written)[:, 0]
    assert yielded.max() <= WRISTS.largest_yield + 1e-6
    assert yielded[[4, 5, 6, 7, 8]].max() < np.deg2rad(1.0)
    assert yielded[[0, 12]].min() > np.deg2rad(2.0)


def test_fingers_that_are_bent_twice_lie_on_an_enclosed_thumb() -> None:
    angles = handshape("flat.across.dblhooked.enclosed").angles
    points = hand.points(angles)
    thumb, index, knuckle = points[15], points[16], points[3]
    assert thumb_depth(angles) < 0.31
    assert thumb[1] < index[1], "before the palm it is farther out than the fingertips"
    assert np.linalg.norm(thumb - index) < np.linalg.norm(thumb - knuckle)
