"""Fits the pose of a standard person to the landmarks of one camera.

The camera is taken as orthographic and upright, the person as facing it. What a single camera cannot know is guessed:

- **Depth of arms** follows from foreshortening: a bone of known length that looks short points towards the camera or
  away from it (Taylor 2000, Computer Vision and Image Understanding 80: 349-363). Forearms point to the camera, upper
  arms ahead. A wrist is kept in front of head and trunk.
- **Hands.** The palm is a plane. Its image gives the plane's slant up to one sign (an orthographic plane and its mirror
  look the same), which the detector's own depth decides, over several frames. Fingers bend in the planes of the hand
  within the limits of their joints, so that their bones look as seen; the detector's depth decides between equals.
- **Head**: scaled orthography of twelve points of the face (a least-squares affine camera, made orthonormal).
- **Trunk**: it leans with the shoulders' middle and tilts with their line; its turns about the vertical are not found.

Places above the shoulders are scaled to the standard person's head, so that a hand at the chin is at the chin. What the
pose does not explain, the landmarks keep (``splicing.points``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from signsplice.body.arm_ik import move_wrists
from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.landmarks import EYES_M, FACE_MESH, Anchors
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.motion.points import Framing
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES, finger_roles


@dataclass(frozen=True)
class FitSettings:
    """Numbers of the fit: the bones' lengths were chosen on 24 shipped words as a camera sees them, of which depths are
    known, the others by eye on recordings.
    """

    smoothing_s: float = 0.04
    """Standard deviation of the bell that smooths landmarks in time, s: a frame at 25 fps, the detector's tremor."""
    depth_smoothing_s: float = 0.08
    """The same for depths, which tremble most where a bone is nearly in the image's plane, s."""
    sign_smoothing_s: float = 0.16
    """The same for the decision which way a palm is slanted, s."""
    least_confidence: float = 0.2
    """Confidence of a joint of the body from which on it is trusted; detectors guess joints outside of the image."""
    longest_forearm: float = 1.6
    """Length of a forearm in the image beyond which its wrist is no wrist, lengths of the standard one."""
    largest_scale: float = 1.2
    """Upper limit of the scale that arms ask for, relative to that of the shoulders."""
    bone: tuple[float, float] = (0.85, 1.1)
    """Limits of the length of a signer's bone, standard lengths: the longest that it is seen within these."""
    stretch: tuple[float, float] = (0.75, 1.35)
    """Limits of the scale of places above the shoulders."""
    forearm_twist: float = 0.6
    """Part of the hand's twist that the forearm takes; the wrist takes the rest."""
    hand_gap_m: float = 0.035
    """Least distance of a wrist from the skin of head and trunk, m: half of a hand's thickness, and some more."""
    finger_prior: float = 0.05
    """Weight of the detector's depth against a bone's place in the image, of squares of the bone's length."""


SETTINGS = FitSettings()
DEPTH_NOTE = "landmarks: depths are guessed from one camera, hands may be too near or too far, the trunk does not turn"
"""What is doubtful in every fitted pose."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """Places of landmarks over time, in metres of the person.

    places: place -> (T, 3) left, up, and the detector's depth towards the camera in its own scale.
    weights: place -> (T,) whether it was seen.
    """

    places: dict[str, FloatArray]
    weights: dict[str, NDArray[np.bool_]]

    def has(self, *names: str) -> bool:
        """Whether each of some places was seen in some frame."""
        return all(name in self.places for name in names)

    def stack(self, names: Sequence[str]) -> FloatArray:
        """Return places (T, K, 3)."""
        return np.stack([self.places[name] for name in names], axis=1)


@dataclass(frozen=True, eq=False)
class FittedPerson:
    """A person fitted to landmarks.

    local_rotations: (T, J, 4) of the skeleton.
    root_positions: (T, 3), m.
    framing: where the person stands in the image.
    notes: what was not found, one line each.
    """

    local_rotations: FloatArray
    root_positions: FloatArray
    framing: Framing
    notes: tuple[str, ...] = ()


def fit_person(
    anchors: Anchors,
    values: NDArray[np.float32],
    confidence: NDArray[np.float32],
    fps: float,
    skeleton: Skeleton,
) -> FittedPerson:
    """Fit a skeleton whose T-pose is all rotations at identity, in metres (``formats.smplx``), to landmarks (T, P, D).

    Raises ``InputError`` if both shoulders are seen together in no frame.
    """
    rest = kinematics.rest_positions(skeleton)
    roles = rig_info(skeleton).roles.joints
    framing, seen, notes = _look(anchors, values, confidence, fps, rest, roles)
    local = np.tile(rotation.IDENTITY, (len(values), len(skeleton), 1))
    trunk = _lean_trunk(local, seen, rest, roles)
    if not _turn_head(local, seen, roles, trunk, fps):
        notes = (*notes, "no face mesh is seen: the head stays upright")
    root = np.zeros((len(values), 3))
    root[:, 1] = -min(rest[:, 1])
    hands = [_fit_hand(local, seen, side, skeleton, roles, fps) for side in SIDES]
    for number, (side, hand) in enumerate(zip(SIDES, hands, strict=True)):
        if seen.has(f"{side}LowerArm", f"{side}Hand"):
            local = _point_arm(Clip(skeleton, local, root, fps), seen, number, hand)
        else:
            local = _hang_arm(local, side, roles)
            notes = (*notes, f"no {side} arm is seen: it hangs")
    return FittedPerson(rotation.continuous(local), root, framing, notes)


def _look(
    anchors: Anchors,
    values: NDArray[np.float32],
    confidence: NDArray[np.float32],
    fps: float,
    rest: FloatArray,
    roles: Mapping[str, int],
) -> tuple[Framing, _Seen, tuple[str, ...]]:
    """Return the framing, and the places of landmarks in metres: smooth, and interpolated where they were not seen."""
    places, weights = {}, {}
    for place, rows in anchors.rows.items():
        is_body = not place.startswith("face") and place.endswith(("Arm", "Hand", "Leg"))
        is_seen = confidence[:, rows[0]] > (SETTINGS.least_confidence if is_body else 0.0)
        if is_seen.any():
            places[place] = _fill(values[:, rows[0]].astype(np.float64), is_seen, SETTINGS.smoothing_s * fps)
            weights[place] = is_seen
    shoulders = [f"{side}UpperArm" for side in SIDES]
    if not all(name in places for name in shoulders) or not np.logical_and(*(weights[s] for s in shoulders)).any():
        raise InputError("it shows no signer: both shoulders are seen together in no frame")
    left, right = (places[name][:, :2] for name in shoulders)
    middle = 0.5 * (left + right)
    width = float(np.percentile(np.linalg.norm(left - right, axis=-1), 75.0))
    joints = [roles[name] for name in shoulders]
    scale = _scale(places, rest, roles, width / float(np.linalg.norm(rest[joints[0]] - rest[joints[1]])))
    if not scale > 0.0:
        raise InputError("it shows no signer: both shoulders are at one place")
    at, height = np.median(middle, axis=0), float(rest[joints, 1].mean())
    has_depth = values.shape[2] > 2
    depth = float(np.median([places[name][:, 2] for name in shoulders])) if has_depth else 0.0
    framing = Framing(scale, float(at[0]), float(at[1]) + scale * (height - float(rest[:, 1].min())), depth)
    notes = ("its signer is seen from behind, or mirrored",) if np.median(left[:, 0] - right[:, 0]) < 0.0 else ()
    metres = {}
    for place, image in places.items():
        towards = (depth - image[:, 2]) / scale if has_depth else np.zeros(len(image))
        metres[place] = np.column_stack([(image[:, 0] - at[0]) / scale, (at[1] - image[:, 1]) / scale, towards])
    _stretch_head(metres, rest[roles["head"], 1] + EYES_M - height)
    return framing, _Seen(metres, weights), notes


def _fill(values: FloatArray, is_seen: NDArray[np.bool_], sigma: float) -> FloatArray:
    """Return values (T, D) interpolated over unseen frames, the nearest seen one held at the ends, smoothed in time."""
    frames, known = np.arange(len(values)), np.flatnonzero(is_seen)
    columns = [np.interp(frames, known, values[known, k]) for k in range(values.shape[1])]
    return np.asarray(gaussian_filter1d(np.column_stack(columns), sigma, axis=0, mode="nearest"))


def _scale(places: Mapping[str, FloatArray], rest: FloatArray, roles: Mapping[str, int], least: float) -> float:
    """Return image units a metre: as the shoulders say (``least``), or as the longest arms ask for."""
    asked = [least]
    for side in SIDES:
        for above, below in (("UpperArm", "LowerArm"), ("LowerArm", "Hand")):
            if side + above in places and side + below in places:
                bone = np.linalg.norm(places[side + below][:, :2] - places[side + above][:, :2], axis=-1)
                length = np.linalg.norm(rest[roles[side + below]] - rest[roles[side + above]])
                asked.append(float(np.percentile(bone, 95.0) / length))
    return min(max(asked), SETTINGS.largest_scale * least)


def _stretch_head(places: dict[str, FloatArray], height: float) -> None:
    """Scale what is above the shoulders so that the eyes, if seen, are ``height`` above them."""
    if "face33" not in places or "face263" not in places:
        return
    eyes = float(np.median(0.5 * (places["face33"] + places["face263"])[:, 1]))
    stretch = float(np.clip(height / max(eyes, 1e-6), *SETTINGS.stretch))
    for place, positions in places.items():
        if not place.startswith("face"):  # the face's own shape gives the head's rotation
            positions[:, 1] *= np.where(positions[:, 1] > 0.0, stretch, 1.0)


def _lean_trunk(local: FloatArray, seen: _Seen, rest: FloatArray, roles: Mapping[str, int]) -> FloatArray:
    """Lean the spine with the middle of the shoulders, and tilt the chest with their line; returns the chest's global
    rotations (T, 4).
    """
    left, right = (seen.places[f"{side}UpperArm"] for side in SIDES)
    length = rest[roles["leftUpperArm"], 1] - rest[roles["spine"], 1]
    lean = -np.arctan(0.5 * (left + right)[:, 0] / length).clip(-0.45, 0.45)
    line = np.arctan2((left - right)[:, 1], np.abs((left - right)[:, 0]) + 1e-9)
    tilt = (line - lean).clip(-0.35, 0.35)
    for role, angle in (("spine", 0.5 * lean), ("chest", 0.5 * lean), ("upperChest", tilt)):
        local[:, roles[role]] = _turn(angle, 2)
    return _turn(lean + tilt, 2)


def _turn(angle: FloatArray, axis: int) -> FloatArray:
    """Return rotations (T, 4) by angles (T,), radians, about one of the axes."""
    return np.asarray(rotation.exp(angle[:, None] * np.eye(3)[axis]))


def _turn_head(local: FloatArray, seen: _Seen, roles: Mapping[str, int], trunk: FloatArray, fps: float) -> bool:
    """Turn neck and head, half of the way each, as the points of the face ask for; returns whether these are seen."""
    numbers = [number for number in FACE_MESH if seen.has(f"face{number}")]
    if len(numbers) < 6:
        return False
    shape = np.array([FACE_MESH[number] for number in numbers])
    shape = shape - shape.mean(axis=0)
    places = seen.stack([f"face{number}" for number in numbers])[..., :2]
    rows = np.einsum("tka,bk->tab", places - places.mean(axis=1, keepdims=True), np.linalg.pinv(shape))  # (T, 2, 3)
    rows /= np.linalg.norm(rows, axis=-1, keepdims=True) + 1e-9
    matrices = np.concatenate([rows, rotation.cross(rows[:, 0], rows[:, 1])[:, None]], axis=1)
    head = rotation.continuous(rotation.nearest(matrices))
    # The face's shape is a guess: what it says of the whole clip's pitch is one too.
    pitch = float(np.median(np.arcsin(np.clip(-rotation.rotate(head, np.array([0.0, 0.0, 1.0]))[:, 1], -1.0, 1.0))))
    head = rotation.multiply(_turn(np.full(1, -np.clip(pitch, -0.3, 0.3)), 0), head)
    turned = rotation.multiply(rotation.inverse(trunk), _smooth(head, SETTINGS.smoothing_s * fps))
    half = rotation.exp(0.5 * rotation.log(turned))
    local[:, roles["neck"]] = half
    local[:, roles["head"]] = rotation.multiply(rotation.inverse(half), turned)
    return True


def _smooth(quats: FloatArray, sigma: float) -> FloatArray:
    """Return rotations (T, 4) smoothed in time."""
    return np.asarray(rotation.normalize(gaussian_filter1d(rotation.continuous(quats), sigma, axis=0, mode="nearest")))


_PALM = ("Wrist", *(f"{finger}Proximal" for finger in ("Index", "Middle", "Ring", "Little")))
"""Places of the palm, without the side."""


def _fit_hand(
    local: FloatArray, seen: _Seen, side: str, skeleton: Skeleton, roles: Mapping[str, int], fps: float
) -> FloatArray | None:
    """Bend the fingers of a hand as seen, and return its global rotations (T, 4); relaxes them, and returns None, if it
    is never seen.
    """
    sign = 1.0 if side == "left" else -1.0
    names = [side + place for place in _PALM]
    if not seen.has(*names):
        for finger in FINGERS[1:]:
            for role, angle in zip(finger_roles(finger), (0.35, 0.45, 0.25), strict=True):
                local[:, roles[side + role]] = _turn(np.full(1, -sign * angle), 2)
        return None
    rest = kinematics.rest_positions(skeleton) - kinematics.rest_positions(skeleton)[roles[f"{side}Hand"]]
    palm = np.array([np.zeros(3), *(rest[roles[name]] for name in names[1:])])[:, [0, 2]] * (sign, 1.0)  # (5, 2)
    palm -= palm.mean(axis=0)
    places = seen.stack(names) - seen.stack(names).mean(axis=1, keepdims=True)
    image = np.einsum("tka,bk->tab", places[..., :2], np.linalg.pinv(palm))  # (T, 2, 2): images of both axes
    values, vectors = np.linalg.eigh(np.einsum("tab,tac->tbc", image, image))
    slant = np.sqrt(np.maximum(values[:, 1] - values[:, 0], 0.0))[:, None] * vectors[:, :, 0]  # (T, 2)
    flips = np.cumprod(np.r_[1.0, np.where((vectors[1:, :, 0] * vectors[:-1, :, 0]).sum(-1) < 0.0, -1.0, 1.0)])
    slant *= flips[:, None]
    asked = (places[..., 2] * (slant @ palm.T)).sum(axis=1)
    smooth = gaussian_filter1d(asked, SETTINGS.sign_smoothing_s * fps, mode="nearest")
    slant *= np.where(smooth < 0.0, -1.0, 1.0)[:, None]
    depths = slant @ palm.T  # (T, 5)
    depth_scale = max(float((depths * places[..., 2]).sum()), 0.0) / max(float((places[..., 2] ** 2).sum()), 1e-12)
    size = np.sqrt(np.maximum(values[:, 1], 1e-8))
    axes = np.concatenate([image, slant[:, None]], axis=1) / size[:, None, None]  # (T, 3, 2)
    matrices = np.concatenate([axes, rotation.cross(axes[..., 0], axes[..., 1])[..., None]], axis=2)
    basis = np.array([[sign, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -sign, 0.0]])  # fingers, thumb side, and their product
    hand = _smooth(rotation.nearest(matrices @ basis), SETTINGS.smoothing_s * fps)
    looks = _HandView(hand, sign, np.clip(size, 0.6, 1.5), depth_scale, fps)
    for finger in FINGERS[1:]:
        chain = [side + role for role in finger_roles(finger)]
        if seen.has(*chain, f"{side}{finger}Tip"):
            looks.bend_finger(local, seen.stack([*chain, f"{side}{finger}Tip"]), [roles[r] for r in chain], skeleton)
    chain = [side + role for role in finger_roles("Thumb")]
    if seen.has(*chain, f"{side}ThumbTip"):
        looks.bend_thumb(local, seen.stack([*chain, f"{side}ThumbTip"]), [roles[r] for r in chain], skeleton)
    return hand


_ANGLES = np.deg2rad(np.arange(-20.0, 281.0, 5.0))
"""Bends of a bone against the palm that are tried, radians."""
_BENDS = np.deg2rad([(-20.0, 95.0), (-5.0, 105.0), (-5.0, 80.0)])
"""Range of each joint of a finger, radians."""


@dataclass(frozen=True, eq=False)
class _HandView:
    """A hand as the camera sees it.

    rotations: (T, 4) global.
    sign: 1 for a left hand, whose fingers point along +X in the T-pose, -1 for a right one.
    size: (T,) of its image against that of the standard hand.
    depth_scale: factor that makes metres of the detector's depth.
    fps: frame rate.
    """

    rotations: FloatArray
    sign: float
    size: FloatArray
    depth_scale: float
    fps: float

    def bend_finger(self, local: FloatArray, places: FloatArray, joints: Sequence[int], skeleton: Skeleton) -> None:
        """Bend a finger's joints so that its bones look as seen. ``places``: (T, 4, 3) of its joints and its tip."""
        ahead, palm, thumb = (
            rotation.rotate(self.rotations, np.array(axis))
            for axis in ((self.sign, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
        )
        directions = np.cos(_ANGLES)[:, None] * ahead[:, None] + np.sin(_ANGLES)[:, None] * palm[:, None]  # (T, N, 3)
        angle, angles = np.zeros(len(places)), list[FloatArray]()
        for k, (low, high) in enumerate(_BENDS):
            bone = self._bone(places, k, joints, skeleton)
            missed = ((bone[:, None, :2] - directions[..., :2]) ** 2).sum(-1)
            missed += SETTINGS.finger_prior * (bone[:, None, 2] - directions[..., 2]) ** 2
            if k == 2:  # the last joint follows the one before it
                missed += 0.1 * (_ANGLES - (angle + 0.7 * (angle - angles[0]))[:, None]) ** 2
            bend = _ANGLES - angle[:, None]
            missed[(bend < low - 1e-9) | (bend > high + 1e-9)] = np.inf
            angle = gaussian_filter1d(_ANGLES[missed.argmin(axis=1)], SETTINGS.smoothing_s * self.fps, mode="nearest")
            angles.append(angle)
        bone, along = (
            self._bone(places, 0, joints, skeleton),
            np.cos(angles[0])[:, None] * ahead + np.sin(angles[0])[:, None] * palm,
        )
        aside = ((bone - along)[:, :2] * thumb[:, :2]).sum(-1) / ((thumb[:, :2] ** 2).sum(-1) + 0.3)
        spread = gaussian_filter1d(aside.clip(-0.26, 0.26), SETTINGS.smoothing_s * self.fps, mode="nearest")
        bends = np.diff(np.array(angles), axis=0, prepend=0.0)
        local[:, joints[0]] = rotation.multiply(_turn(-self.sign * spread, 1), _turn(-self.sign * bends[0], 2))
        for joint, bend in zip(joints[1:], bends[1:], strict=True):
            local[:, joint] = _turn(-self.sign * bend, 2)

    def bend_thumb(self, local: FloatArray, places: FloatArray, joints: Sequence[int], skeleton: Skeleton) -> None:
        """Point the bones of a thumb as seen, no joint farther than .8 radian from rest."""
        above = self.rotations
        for k, joint in enumerate(joints):
            rest = skeleton.offsets[joints[min(k + 1, 2)]]
            bone = self._bone(places, k, joints, skeleton)
            seen = rotation.rotate(rotation.inverse(above), bone / (np.linalg.norm(bone, axis=-1)[:, None] + 1e-9))
            turn = rotation.log(rotation.between_vectors(np.broadcast_to(rest, seen.shape), seen))
            turn *= np.minimum(1.0, 0.8 / (np.linalg.norm(turn, axis=-1)[:, None] + 1e-9))
            local[:, joint] = _smooth(rotation.exp(turn), SETTINGS.smoothing_s * self.fps)
            above = rotation.multiply(above, local[:, joint])

    def _bone(self, places: FloatArray, k: int, joints: Sequence[int], skeleton: Skeleton) -> FloatArray:
        """Return bone ``k`` (T, 3) as seen, in lengths of the standard hand's, no longer than 1 in the image."""
        length = float(np.linalg.norm(skeleton.offsets[joints[min(k + 1, 2)]])) * (0.8 if k == 2 else 1.0)
        bone = (places[:, k + 1] - places[:, k]) / (length * self.size[:, None])
        bone[:, 2] *= self.depth_scale
        bone[:, :2] /= np.maximum(np.linalg.norm(bone[:, :2], axis=-1)[:, None], 1.0)
        return np.asarray(bone)


def _point_arm(clip: Clip, seen: _Seen, side: int, hand: FloatArray | None) -> FloatArray:
    """Return the local rotations (T, J, 4) of a clip with an arm, 0 left or 1 right, pointed as seen."""
    name, sign, fps = SIDES[side], 1.0 - 2.0 * side, clip.fps
    roles = rig_info(clip.skeleton).roles.joints
    joints = [roles[name + part] for part in ("UpperArm", "LowerArm", "Hand")]
    matrices, positions = kinematics.forward(clip, [int(clip.skeleton.parents[joints[0]]), joints[0]])
    chest, shoulder = rotation.from_matrix(matrices[:, 0]), positions[:, 1]
    lengths = [float(np.linalg.norm(clip.skeleton.offsets[joint])) for joint in joints[1:]]
    origin = np.array([0.0, float(positions[:, 1, 1].mean()), 0.0])
    elbow = seen.places[f"{name}LowerArm"] + origin
    wrist = _wrist(seen, name, lengths[1]) + origin
    upper = _foreshorten((elbow - shoulder)[:, :2], lengths[0], fps)
    bent = shoulder + lengths[0] * upper
    fore = _foreshorten((wrist - bent)[:, :2], lengths[1], fps)
    z_axis = np.array([0.0, 0.0, 1.0])
    ahead = rotation.rotate(chest, z_axis)
    across = _perpendicular(fore, upper) + 0.15 * _perpendicular(ahead, upper) + 1e-6 * ahead
    arm = _frame(sign * upper, across)
    plain = rotation.multiply(rotation.between_vectors(upper, fore), arm)
    lower = plain
    if hand is not None:
        thumb = rotation.rotate(hand, np.array([0.0, 0.0, 1.0]))
        twisted = _frame(
            sign * fore, _perpendicular(thumb, fore) + 0.05 * rotation.rotate(plain, np.array([0.0, 0.0, 1.0]))
        )
        twist = rotation.log(rotation.multiply(rotation.inverse(plain), twisted))[:, 0].clip(-2.2, 2.2)
        lower = rotation.multiply(plain, _turn(SETTINGS.forearm_twist * twist, 0))
    local = np.array(clip.local_rotations)
    chain = [chest, arm, lower, lower if hand is None else hand]
    for joint, above, below in zip(joints, chain, chain[1:], strict=False):
        local[:, joint] = rotation.multiply(rotation.inverse(above), below)
    pointed = Clip(clip.skeleton, rotation.normalize(local), clip.root_positions, fps)
    moves = np.zeros((len(clip), 2, 3))
    at = bent + lengths[1] * fore
    moves[:, side, :2] = (wrist - at)[:, :2]
    moves[:, side, 2] = np.maximum(_front(pointed, wrist[:, :2]) + SETTINGS.hand_gap_m - at[:, 2], 0.0)
    moves = gaussian_filter1d(moves, SETTINGS.smoothing_s * fps, axis=0, mode="nearest")
    return move_wrists(pointed, moves).local_rotations


def _wrist(seen: _Seen, side: str, length: float) -> FloatArray:
    """Return the wrist (T, 3): that of the hand where it is seen, else the body's if it is near enough to the elbow."""
    wrist, elbow = seen.places[f"{side}Hand"], seen.places[f"{side}LowerArm"]
    is_far = np.linalg.norm((wrist - elbow)[:, :2], axis=-1) > SETTINGS.longest_forearm * length
    if not seen.has(f"{side}Wrist"):
        return wrist
    at_hand = seen.places[f"{side}Wrist"]
    use_hand = is_far | seen.weights[f"{side}Wrist"]
    return np.asarray(np.where(use_hand[:, None], at_hand, wrist))


def _foreshorten(seen: FloatArray, length: float, fps: float) -> FloatArray:
    """Return unit directions (T, 3), towards the camera, of a bone that looks as ``seen`` (T, 2); ``length``: of the
    standard person's, m.
    """
    apart = np.linalg.norm(seen, axis=-1)
    least, most = SETTINGS.bone
    length = float(np.clip(np.percentile(apart, 95.0), least * length, most * length))
    depth = np.sqrt(np.maximum(length**2 - apart**2, 0.0))
    depth = gaussian_filter1d(depth, SETTINGS.depth_smoothing_s * fps, mode="nearest")
    bone = np.column_stack([seen, depth])
    return np.asarray(bone / (np.linalg.norm(bone, axis=-1, keepdims=True) + 1e-9))


def _perpendicular(v: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the parts (T, 3) of vectors at right angles to unit axes."""
    return np.asarray(v - (v * axis).sum(-1, keepdims=True) * axis)


def _frame(x: FloatArray, z: FloatArray) -> FloatArray:
    """Return rotations (T, 4) that bring X to ``x``, unit vectors, and Z to ``z``, at right angles to these."""
    z = z / (np.linalg.norm(z, axis=-1, keepdims=True) + 1e-12)
    return rotation.from_matrix(np.stack([x, rotation.cross(z, x), z], axis=-1))


def _front(clip: Clip, at: FloatArray) -> FloatArray:
    """Return how far ahead (T,) the skin of head and trunk is at places ``at`` (T, 2) of the image, m; far behind where
    there is none.
    """
    body = body_capsules(clip.skeleton)
    rows = [*body.groups.head, *body.groups.trunk]
    starts, ends = (ends[:, rows] for ends in capsule_ends(body, *kinematics.forward(clip)))  # (T, C, 3)
    axis, offset = ends - starts, at[:, None] - starts[..., :2]
    part = ((offset * axis[..., :2]).sum(-1) / ((axis[..., :2] ** 2).sum(-1) + 1e-9)).clip(0.0, 1.0)
    radius = body.radii[rows, 0] + part * (body.radii[rows, 1] - body.radii[rows, 0])
    beside = ((offset - part[..., None] * axis[..., :2]) ** 2).sum(-1)
    front = starts[..., 2] + part * axis[..., 2] + np.sqrt(np.maximum(radius**2 - beside, 0.0))
    return np.asarray(np.where(beside < radius**2, front, -1.0).max(axis=1))


def _hang_arm(local: FloatArray, side: str, roles: Mapping[str, int]) -> FloatArray:
    """Return local rotations (T, J, 4) with an arm that hangs."""
    local = np.array(local)
    sign = 1.0 if side == "left" else -1.0
    local[:, roles[f"{side}UpperArm"]] = _turn(np.full(1, -sign * 1.35), 2)
    local[:, roles[f"{side}LowerArm"]] = _turn(np.full(1, -sign * 0.2), 1)
    return local
