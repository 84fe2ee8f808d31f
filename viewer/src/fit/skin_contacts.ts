/** Hands on an avatar's posed skin, the last moves of its wrists: the method of the Python module body/skin_contacts, which says what
 * is sought. */

import { Quaternion, Vector3 } from 'three';
import { fit as FIT, skin_contacts as SKIN, skin_surface as SURFACE } from './constants.js';
import { clip } from './gaps.js';
import { KdTree } from './kd_tree.js';
import { type AvatarSkin, leastHeight } from './skin_surface.js';
import { addRow, type Fit, type Moves } from './solver.js';

const { CONTACTS } = FIT;
const { SETTINGS, HANDS, KINDS } = SKIN;

const ANYWHERE = { place: new Vector3(), radius: Infinity };

/** A frame in which a hand is near other skin. */
interface Meeting {
  frame: number;
  side: number;
  isOfHands: boolean;
  /** The height of the hand above the other skin at the source, m. */
  wanted: number;
  /** Weights of that where the hand is higher, and where it is lower. */
  held: number;
  weight: number;
  /** How much hands touch, 0 to 1. */
  together: number;
  pose: Pose | null;
}

/** The points of a hand that are near the other skin, and that skin. */
interface Pose {
  hand: Float64Array;
  tree: KdTree;
  normals: number[];
}

/** ``moves`` of the wrists with those that put hands where they lay on the skin at the source. */
export function* movesOnSkin(fit: Fit, skin: AvatarSkin, moves: Moves): Generator<void, Moves> {
  const meetings = KINDS.flatMap(([side, what]) => meetingsOf(fit, side, what === HANDS));
  const body = fit.carried.body.bones;
  const [turns, positions] = [body.map(() => new Quaternion()), body.map(() => new Vector3())];
  for (const meeting of meetings) {
    yield;
    fit.carried.pose(meeting.frame, turns, positions);
    meeting.pose = poseOf(meeting, skin, turns, positions, moves);
  }
  let more: Moves = new Float64Array(moves.length);
  for (let round = 0; round < (meetings.length ? SETTINGS.rounds : 0); round++) more = yield* better(fit, skin, meetings, more);
  return moves.map((move, k) => move + more[k]!);
}

/** The frames in which a hand is near the body, or the left hand near the right one, while it signs. */
function meetingsOf({ near, sides, source, signing, frames }: Fit, side: number, isOfHands: boolean): Meeting[] {
  const least = new Float64Array(frames).fill(Infinity);
  near.frames.forEach((frame, k) => {
    const other = near.other[k]!;
    const isHand = source.body.capsules[other]!.region === 'hand';
    if (sides[near.own[k]!] !== side || (isOfHands ? !isHand : sides[other]! >= 0)) return;
    least[frame] = Math.min(least[frame]!, near.distances[k]!);
  });
  return [...least].flatMap((then, frame) => {
    const active = isOfHands ? Math.min(signing[2 * frame]!, signing[2 * frame + 1]!) : signing[2 * frame + side]!;
    if (then === Infinity || active <= 0) return [];
    const weight = CONTACTS.weight * active;
    const deep = Math.max(Math.abs(then + 0.5 * CONTACTS.press_depth_m) - 0.5 * CONTACTS.press_depth_m, 0);
    const held = then < CONTACTS.touch_distance_m ? weight * Math.exp(-deep / CONTACTS.fade_m) : 0;
    const together = Math.exp(-Math.max(then, 0) / SETTINGS.together_fade_m);
    return [{ frame, side, isOfHands, wanted: clip(then, -CONTACTS.press_depth_m, CONTACTS.clearance_m), held, weight, together, pose: null }];
  });
}

/** Both skins in a frame, with the wrists moved; null where they are far apart. */
function poseOf(
  { frame, side, isOfHands }: Meeting, skin: AvatarSkin, turns: Quaternion[], positions: Vector3[], moves: Moves,
): Pose | null {
  const moved = (points: number[], of: number) => Float64Array.from(points, (value, k) => value + moves[6 * frame + 3 * of + (k % 3)]!);
  const hand = moved(skin.hands[side]!.posed(turns, positions, ANYWHERE).points, side);
  const middle = new Vector3();
  for (let k = 0; k < hand.length; k += 3) middle.add(new Vector3().fromArray(hand, k));
  middle.multiplyScalar(3 / hand.length);
  const by = isOfHands ? new Vector3().fromArray(moves, 6 * frame + 3) : new Vector3();
  let radius = 0;
  for (let k = 0; k < hand.length; k += 3) radius = Math.max(radius, middle.distanceTo(new Vector3().fromArray(hand, k)));
  const around = { place: middle.sub(by), radius: radius + SETTINGS.comparison_m };
  const other = (isOfHands ? skin.hands[1] : skin.body).posed(turns, positions, around);
  const tree = new KdTree(isOfHands ? moved(other.points, 1) : Float64Array.from(other.points));
  const apart = Array.from({ length: hand.length / 3 }, (_, k) => {
    const isNear = tree.nearest(hand[3 * k]!, hand[3 * k + 1]!, hand[3 * k + 2]!, SETTINGS.comparison_m) >= 0;
    return isNear ? Math.sqrt(tree.squared) : Infinity;
  });
  const most = Math.min(SETTINGS.comparison_m, apart.reduce((one, distance) => Math.min(one, distance), Infinity) + SETTINGS.hand_layer_m);
  const kept = hand.filter((_, k) => apart[Math.floor(k / 3)]! < most);
  return kept.length ? { hand: kept, tree, normals: other.normals } : null;
}

/** Better moves in place of ``more``. */
function* better(fit: Fit, skin: AvatarSkin, meetings: Meeting[], more: Moves): Generator<void, Moves> {
  const band = fit.smoothBand();
  const right: Moves = new Float64Array(more.length);
  for (let k = 0; k < more.length; k++) band.add(k, k, SETTINGS.move_weight);
  const [jacobian, by] = [new Float64Array(6), new Vector3()];
  for (const { frame, side, isOfHands, wanted, held, weight, together, pose } of meetings) {
    yield;
    by.fromArray(more, 6 * frame + 3 * side);
    if (isOfHands) {
      by.sub(new Vector3().fromArray(more, 6 * frame + 3));
      for (let x = 0; x < 3; x++) {
        for (const k of [x, 3 + x]) band.add(6 * frame + k, 6 * frame + k, SETTINGS.together_weight * together);
        band.add(6 * frame + 3 + x, 6 * frame + x, -SETTINGS.together_weight * together);
      }
    }
    if (!pose) continue;
    const mostAcross = SETTINGS.edge_spacings * (isOfHands ? skin.hands[1] : skin.body).spacing;
    const { least, out } = leastHeight(pose.hand, by, pose.tree, pose.normals, mostAcross, SURFACE.HALF_THICKNESS_M[isOfHands ? 1 : 0], SETTINGS.lowest_fade_m);
    const lack = wanted - least;
    const now = lack > 0 ? weight : held;
    if (least === Infinity || now <= 0) continue;
    jacobian.fill(0);
    out.toArray(jacobian, 3 * side);
    if (isOfHands) out.negate().toArray(jacobian, 3);
    addRow(band, right, frame, jacobian, now, lack, more);
  }
  return yield* band.solve(right, 1);
}
