"""A clip on another body: rotations first, then moves of wrists and elbows, so that hands keep places and contacts.

Rotations alone do not keep places: on a body with shorter arms or wider shoulders, a hand that touched the temple lies
at the mouth or in the head. ``fit`` moves the wrists, ``swivel`` turns the elbows, ``arm_ik`` bends the arms. Hands
keep their rotations in the world, so that palms and fingers face as they did.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.body import arm_ik, swivel
from signsplice.body.capsules import Avatar, BodyCapsules, body_capsules
from signsplice.body.collision import Near, forearm_pairs, near_pairs, pair_clearances
from signsplice.body.contacts import SEPARATION_M, Contact, PosedBody, find_contacts, pose_body
from signsplice.body.fit import WRISTS, Fit
from signsplice.body.skin_contacts import SkinFit
from signsplice.body.thumb_contacts import keep_thumb_contacts
from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.rig.align import Reference, copy_rotations, list_names, placement, settle
from signsplice.rig.info import active_span, arms, rig_info
from signsplice.rig.inspection import clip_warnings
from signsplice.rig.rest_pose import with_rest_pose
from signsplice.rig.roles import FACE_BONES, SIDES

ALIKE = 0.005
"""Bodies whose arms, shoulders and hands, as parts of stature, differ by a smaller fraction than this count as one:
rotations are enough.
"""
_SHORT = 0.1
"""Lengths below this part of the longest count as that long in comparisons."""
BEYOND_M = 0.02
"""A hand gets a warning if its place lies farther than this beyond its arm's reach, m."""
_FADE_S = 0.15
_HANGING = 0.95
"""Least height of a shoulder above its wrist while an arm hangs, arm lengths."""
_RAISED = 0.85
"""Largest height of a shoulder above its wrist while an arm is raised, arm lengths."""
_FOREARM_MARGIN_M = 0.03
_WINDOW = 1500
"""Frames that are fitted at a time, to keep memory small for long takes."""
_OVERLAP = 90
"""Frames that two successive windows share."""


@dataclass(frozen=True, eq=False)
class Retargeted:
    """A clip on another body.

    clip: the clip on the other skeleton.
    warnings: facts that a user should know about it, one line each.
    contacts: contacts of the hands at the source, and their distances after; empty if nothing moved.
    """

    clip: Clip
    warnings: tuple[str, ...] = ()
    contacts: tuple[Contact, ...] = ()


def retarget(clip: Clip, onto: Clip | Skeleton) -> Retargeted:
    """Returns ``clip`` on the body of another clip, skeleton or avatar (``ss.read_avatar``), at its own place and
    rate: hands keep their places on the body and their contacts.

    Raises ``RigMismatchError`` if the two rigs have nothing in common.
    """
    clip = with_rest_pose(clip)
    fitted = _fit_clip(clip, _body_reference(clip, onto, clip.fps))
    lines = [f"{clip.name}: {line}" for line in clip_warnings(clip)]
    if isinstance(onto, Avatar):
        lines = [*onto.warnings, *_face_warnings(clip, onto), *lines]
    return replace(fitted, warnings=(*lines, *fitted.warnings))


def _body_reference(clip: Clip, onto: Clip | Skeleton, fps: float) -> Reference:
    """Returns the reference with the body ``onto``, at the clip's place in the clip's unit."""
    if not isinstance(onto, Clip | Skeleton):
        what = f"{onto!r:.60}" if isinstance(onto, str) else f"a {type(onto).__name__}"
        raise TypeError(f"onto is {what}, expected a clip or an avatar; a file's is load(path) or read_avatar(path)")
    skeleton = onto if isinstance(onto, Skeleton) else with_rest_pose(onto).skeleton
    pose = np.tile([0.0, 0.0, 0.0, 1.0], (len(skeleton), 1)) if isinstance(onto, Skeleton) else onto.local_rotations[0]
    name = onto.name if isinstance(onto, Clip) else onto.label if isinstance(onto, Avatar) else "the skeleton"
    has_face = isinstance(onto, Avatar) and onto.file is not None  # which morph targets show, or its own bones
    return Reference(skeleton, fps, placement(clip), pose, name, FACE_BONES if has_face else ())


def reference_onto(first: Clip, onto: Clip | Skeleton, fps: float) -> Reference:
    """Returns the reference with the body ``onto`` and a rate, at the place of ``first`` as it stands on that body.
    Raises as ``retarget`` does.
    """
    to = _body_reference(first, onto, fps)
    return replace(to, placement=placement(copy_rotations(first, to, isinstance(to.skeleton, Avatar))[0]))


def align(clip: Clip, to: Reference) -> Retargeted:
    """Returns ``clip`` on the skeleton, frame rate, position and facing of a reference; keeps places and contacts if
    the bodies differ. Raises as ``rig.align.copy_rotations`` does.
    """
    fitted = _fit_clip(clip, to)
    return Retargeted(settle(fitted.clip, to), fitted.warnings, fitted.contacts)


def fit_body(source: Clip, source_body: BodyCapsules, carried: Clip, body: BodyCapsules) -> Retargeted:
    """Returns ``carried``, the rotations of ``source`` on another skeleton, with arms moved to keep places and
    contacts, and thumbs turned if hands have other proportions.
    """
    carried = keep_thumb_contacts(source, source_body, carried, body)
    metres, active = rig_info(carried.skeleton).sizes.unit.metres, signing(source)
    moves, swivels = np.zeros((len(source), 2, 3)), np.zeros((len(source), 2))
    beyond, contacts = np.zeros(2), []
    for start in range(0, max(len(source) - _OVERLAP, 1), _WINDOW - _OVERLAP):
        part = slice(start, start + _WINDOW)
        fit = Fit(pose_body(source[part], source_body), pose_body(carried[part], body), source.fps, active[part])
        moved, turned, after = _solve_arms(fit, carried[part], metres)
        beyond = np.maximum(beyond, fit.out_of_reach)
        on_skin = None if body.skin is None else SkinFit(fit, body.skin, carried[part], metres, moved)
        contacts += _contacts(fit, after, start, on_skin)
        moved = moved if on_skin is None else on_skin.moves
        weight = _fade_in(len(moved), start > 0)
        moves[part] += weight[:, None, None] * (moved - moves[part])
        swivels[part] += weight[:, None] * (turned - swivels[part])
    moved_clip = arm_ik.move_wrists(carried, moves / metres, swivels)
    return Retargeted(moved_clip, _reach_warnings(beyond, source.name), tuple(contacts))


def _solve_arms(fit: Fit, carried: Clip, metres: float) -> tuple[FloatArray, FloatArray, PosedBody]:
    """Returns moves (T, 2, 3) of the wrists, m, turns (T, 2) of the elbows, and the body after both."""
    moves = fit.moves()
    shoulders, elbows, wrists = _solve_arm_positions(carried, moves, metres)
    swivels = _swivels(fit, shoulders, elbows, wrists)
    moves = fit.refine(fit.carried.with_arms(arm_ik.swivel_elbows(shoulders, elbows, wrists, swivels), wrists))
    shoulders, elbows, wrists = _solve_arm_positions(carried, moves, metres)
    return moves, swivels, fit.carried.with_arms(arm_ik.swivel_elbows(shoulders, elbows, wrists, swivels), wrists)


def _solve_arm_positions(carried: Clip, moves: FloatArray, metres: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    shoulders, elbows, wrists = arm_ik.solve_arm_positions(carried, moves / metres)
    return metres * shoulders, metres * elbows, metres * wrists


def _fade_in(n_frames: int, is_later: bool) -> FloatArray:
    """Returns the weight (T,) of a window in the blend with the one before."""
    weight = np.ones(n_frames)
    if is_later:
        weight[:_OVERLAP] = np.linspace(0.0, 1.0, _OVERLAP + 2)[1 : 1 + min(_OVERLAP, n_frames)]
    return weight


def _fit_clip(clip: Clip, to: Reference) -> Retargeted:
    carried, warnings, is_one_body = copy_rotations(clip, to, by_role=isinstance(to.skeleton, Avatar))
    source, target = clip.skeleton, to.skeleton
    if is_one_body and not isinstance(target, Avatar):
        return Retargeted(carried, warnings)
    if not (rig_info(source).has_arms and rig_info(target).has_arms) or _is_alike(source, target):
        return Retargeted(carried, warnings)
    fitted = fit_body(clip, body_capsules(source), carried, body_capsules(target))
    return Retargeted(fitted.clip, (*warnings, *fitted.warnings), fitted.contacts)


def _is_alike(a: Skeleton, b: Skeleton) -> bool:
    """Tells whether two bodies have the same proportions as far as hands depend on them, in any unit and size; with an
    avatar, the same size too.
    """
    sizes = []
    for skeleton in (a, b):
        rig_sizes, body = rig_info(skeleton).sizes, body_capsules(skeleton)
        has_skin = isinstance(a, Avatar) or isinstance(b, Avatar)  # its own; other skin follows from bones
        scale = rig_sizes.unit.metres if has_skin else 1.0 / rig_sizes.stature
        lengths = dict(zip(body.keys, np.linalg.norm(body.ends - body.starts, axis=-1), strict=True))
        measures = {key: scale * float(length) for key, length in lengths.items()}
        if has_skin:
            measures |= {f"{key} {k}": 2.0 * scale * float(body.radii[n, k])
                     for n, key in enumerate(body.keys) for k in (0, 1)}  # fmt: skip
        sizes.append({**measures, "shoulders": scale * rig_sizes.shoulder_width})
    first, second = sizes
    longest = max(first.values())
    return first.keys() == second.keys() and all(
        abs(first[key] - second[key]) <= ALIKE * max(first[key], _SHORT * longest) for key in first
    )


def signing(clip: Clip) -> FloatArray:
    """Returns the activity of each arm (T, 2): 1 while it is raised and the arms are away from rest, else 0."""
    seen = arms(clip)
    start, stop = active_span(seen)
    frames = np.arange(len(clip))
    outside = np.maximum(np.maximum(start - frames, frames - (stop - 1)), 0) / clip.fps
    drop = (seen.shoulders - seen.wrists) @ seen.up / seen.length
    raised = np.clip((_HANGING - drop) / (_HANGING - _RAISED), 0.0, 1.0)
    return np.asarray(raised * np.clip(1.0 - outside / _FADE_S, 0.0, 1.0)[:, None])


def _swivels(fit: Fit, shoulders: FloatArray, elbows: FloatArray, wrists: FloatArray) -> FloatArray:
    """Returns turns (T, 2) of both elbows that keep forearms as clear of head, trunk and other arm as at the source;
    shoulders, elbows, wrists: (T, 2, 3) m.
    """
    source, target = fit.source, fit.carried
    source_pairs, target_pairs = (forearm_pairs(body, fit.shared) for body in (source.body, target.body))
    n, swivels = len(wrists), np.zeros((len(wrists), 2))
    starts, ends = target.starts.copy(), target.ends.copy()
    for side, name in enumerate(SIDES):
        lower, upper = (target.body.keys.index(f"{name}{bone}Arm") for bone in ("Lower", "Upper"))
        starts[:, lower], ends[:, lower], ends[:, upper] = elbows[:, side], wrists[:, side], elbows[:, side]
    for side in (0, 1):
        (columns,) = np.nonzero(target_pairs.own_side == side)
        if not len(columns):
            continue
        forearm = target_pairs.own[columns[0]]
        _, k = near_pairs(starts, ends, target.radii, target_pairs, _FOREARM_MARGIN_M)
        solids = np.intersect1d(k, columns)
        if not len(solids):
            continue
        frames, k = np.repeat(np.arange(n), len(solids)), np.tile(solids, n)
        source_distance = pair_clearances(source.starts, source.ends, source.radii, source_pairs, frames, k).distance
        rows = target_pairs.other[solids]
        obstacles = swivel.Obstacles(starts[:, rows], ends[:, rows], target.radii[rows])
        arm = swivel.BentArm(shoulders[:, side], elbows[:, side], wrists[:, side], target.radii[forearm])
        swivels[:, side] = swivel.choose(arm, obstacles, np.maximum(-source_distance.reshape(n, -1), 0.0), fit.fps)
    return swivels


def _face_warnings(clip: Clip, avatar: Avatar) -> tuple[str, ...]:
    """Returns a line about coefficients of a clip's face that an avatar from a file cannot show."""
    if clip.face is None or avatar.file is None:
        return ()
    from signsplice.motion.face import target_weights  # loads scipy, which few clips need

    _, lost = target_weights(clip.face, [control.name for control in avatar.file.face])
    return (f"{avatar.label}: its face does not show {list_names(lost)}",) if lost else ()


def _reach_warnings(beyond: FloatArray, name: str) -> tuple[str, ...]:
    """Returns a line for each hand whose places lie beyond its arm's reach."""
    return tuple(
        f"{name}: places of the {hand} hand lie up to {100.0 * excess:.0f} cm beyond the reach of this body's arm"
        for hand, excess in zip(SIDES, beyond.tolist(), strict=True)
        if excess > BEYOND_M
    )


def _contacts(fit: Fit, posed: PosedBody, start: int, on_skin: SkinFit | None) -> list[Contact]:
    """Returns the contacts of a window of the source while it signs, from frame ``start`` on, before and after."""
    (source_pairs, target_pairs), pairs = fit.pairs, fit.near
    activity = fit.active[pairs.frames, source_pairs.own_side[pairs.k]]
    shown = (pairs.distance < SEPARATION_M) & (activity > WRISTS.signing_activity)
    pairs = Near(pairs.frames[shown], pairs.k[shown], pairs.distance[shown])
    after = pair_clearances(posed.starts, posed.ends, posed.radii, target_pairs, pairs.frames, pairs.k).distance
    after = after if on_skin is None else on_skin.distances(source_pairs, pairs, after)
    guessed = fit.carried.body.guessed_regions
    contacts = find_contacts(fit.source.body, source_pairs, pairs, after, fit.n_frames, guessed)
    first = _OVERLAP if start else 0  # the window before holds earlier ones
    return [
        replace(contact, frames=(contact.frames[0] + start, contact.frames[1] + start))
        for contact in contacts
        if contact.frames[0] >= first
    ]
