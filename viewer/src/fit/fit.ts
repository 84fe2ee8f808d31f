/**
 * A motion on another body: rotations first, then wrists and elbows moved so that hands keep places and contacts, as the Python
 * module body/retarget does it.
 */

import { moveWrists } from './arms.js';
import { type Body, lengthOf, Posed, restPositions, type Rotations, shared, SIDES } from './body.js';
import { retarget as RETARGET } from './constants.js';
import { chooseSwivels } from './elbows.js';
import { movesOnSkin } from './skin_contacts.js';
import { Fit } from './solver.js';
import { keepThumbContacts } from './thumbs.js';

const { WINDOW, OVERLAP, ALIKE, SHORT, BEYOND_M } = RETARGET;
const SLICE_MS = 10; // of work between two frames of the page

/** A motion as it was signed. */
export interface Motion {
  body: Body;
  rotations: Rotations;
  frames: number;
  fps: number;
  /** Of the frames, s. */
  times: Float32Array;
  /** How much each arm signs, left and right, frame by frame. */
  signing: Float64Array;
}

export interface Fitted {
  /** Of all bones of the other body. */
  rotations: Rotations;
  /** How far places of the left and the right hand lie beyond the arm's reach, m; 0 where it is too little to tell. */
  beyond: [number, number];
  /** Whether the bodies differ, so that arms were moved. */
  isMoved: boolean;
}

/** The motion on another body. Yields now and then, so that the page can draw meanwhile (``inSlices``). */
export function* fitMotion(motion: Motion, onto: Body): Generator<void, Fitted> {
  const copied = carry(motion, onto);
  if (isAlike(motion.body, onto)) return { rotations: copied, beyond: [0, 0], isMoved: false };
  const [source, target] = shared(motion.body, onto);
  const { frames, fps } = motion;
  const whole = new Posed(source, motion.rotations, 0, frames);
  const rotations = yield* keepThumbContacts(whole, new Posed(target, copied, 0, frames), fps);
  const moves = new Float64Array(6 * frames);
  const swivels = new Float64Array(2 * frames);
  const beyond: [number, number] = [0, 0];
  for (let from = 0; from < Math.max(frames - OVERLAP, 1); from += WINDOW - OVERLAP) {
    const to = Math.min(from + WINDOW, frames);
    const carried = new Posed(target, rotations, from, to);
    yield;
    const fit = new Fit(new Posed(source, motion.rotations, from, to), carried, fps, motion.signing.subarray(2 * from, 2 * to));
    const first = yield* fit.moves();
    const turned = yield* chooseSwivels(fit.source, carried, first, fps);
    const again = yield* fit.again(new Posed(target, moveWrists(carried, first, turned), 0, to - from));
    const moved = target.skin ? yield* movesOnSkin(fit, target.skin, again) : again;
    for (let t = from; t < to; t++) {
      const share = from ? Math.min((t - from + 1) / (OVERLAP + 1), 1) : 1;
      for (let k = 0; k < 6; k++) moves[6 * t + k]! += share * (moved[6 * (t - from) + k]! - moves[6 * t + k]!);
      for (let k = 0; k < 2; k++) swivels[2 * t + k]! += share * (turned[2 * (t - from) + k]! - swivels[2 * t + k]!);
    }
    for (const side of [0, 1]) beyond[side] = Math.max(beyond[side]!, fit.outOfReach[side]!);
    yield;
  }
  const told = beyond.map((most) => (most > BEYOND_M ? most : 0)) as [number, number];
  return { rotations: moveWrists(new Posed(target, rotations, 0, frames), moves, swivels), beyond: told, isMoved: true };
}

/** Run work piece by piece, and let the page draw in between. */
export async function inSlices<Result>(work: Generator<void, Result>): Promise<Result> {
  for (;;) {
    const until = performance.now() + SLICE_MS;
    do {
      const { done, value } = work.next();
      if (done) return value;
    } while (performance.now() < until);
    await new Promise((next) => setTimeout(next));
  }
}

/** The motion's rotations for every bone of another body; a bone that the motion lacks turns with the one above. */
function carry({ rotations, frames }: Motion, { bones }: Body): Rotations {
  const carried: Rotations = new Map();
  const still = new Float64Array(4 * frames).map((_, k) => (k % 4 === 3 ? 1 : 0));
  for (const { name, parent } of bones) {
    carried.set(name, rotations.get(name) ?? (parent < 0 ? still : carried.get(bones[parent]!.name)!));
  }
  return carried;
}

/** Whether two bodies have the same proportions and size where it counts for hands. */
function isAlike(one: Body, other: Body): boolean {
  const [a, b] = [one, other].map(({ bones, capsules }) => {
    const lengths = new Map(capsules.map((capsule) => [capsule.key, lengthOf(capsule)]));
    for (const { key, radii } of capsules) radii.forEach((radius, k) => lengths.set(`${key} ${k}`, 2 * radius));
    const rest = restPositions(bones);
    const [left, right] = SIDES.map((side) => rest[bones.findIndex(({ name }) => name === `${side}UpperArm`)]!);
    return lengths.set('shoulders', left!.distanceTo(right!));
  }) as [Map<string, number>, Map<string, number>];
  const longest = Math.max(...a.values());
  return (
    a.size === b.size &&
    [...a].every(([key, length]) => Math.abs(length - (b.get(key) ?? Infinity)) <= ALIKE * Math.max(length, SHORT * longest))
  );
}
