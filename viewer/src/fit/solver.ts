/**
 * Where wrists go on another body, so that hands keep their place on it and touch what they touched: the method of the Python
 * module body/fit, which says what is sought and why.
 */

import { Band, secondDifferences } from './band.js';
import { Posed } from './body.js';
import { fit as FIT } from './constants.js';
import { gap, gapBetween, markNear, type Pairs, sidesOf, skinGap, skinPairs } from './gaps.js';
import { Places } from './places.js';

const { WRISTS, CONTACTS, ARM_SHARES } = FIT;
const FRAMES_A_SLICE = 32;

/** Pairs that are near one another at some frames, in order of frames. */
interface Near {
  frames: number[];
  own: number[];
  other: number[];
  /** Skin distances at the source, m. */
  distances: number[];
}

/** Moves of both wrists, left x y z, right x y z, frame by frame, m. */
export type Moves = Float64Array;

/** The problem of one clip on two bodies with the same capsules: ``source`` as it was signed, ``carried`` with the same rotations. */
export class Fit {
  /** How far the places of each hand lie beyond its arm's reach where it signs, at most, m. */
  readonly outOfReach: [number, number] = [0, 0];
  readonly frames: number;
  /** 0 or 1 for the side of a capsule, -1 where it is of head or trunk. */
  readonly sides: number[];
  private readonly smooth: number;
  private readonly pairs: Pairs;
  private readonly first: number[];
  private readonly last: number[];
  readonly near: Near = { frames: [], own: [], other: [], distances: [] };
  private readonly places: Places;

  /** ``signing``: how much each arm signs, left and right, frame by frame. */
  constructor(readonly source: Posed, readonly carried: Posed, fps: number, readonly signing: Float64Array) {
    this.frames = source.frames;
    this.smooth = WRISTS.smoothness * (fps / WRISTS.smoothness_fps) ** 4;
    const { body } = source;
    this.places = new Places(source, carried, signing);
    this.pairs = skinPairs(body);
    this.sides = sidesOf(body);
    // How far both ends of a capsule move with a wrist: hands wholly, an elbow half-way.
    const { sleeve: upperArm, cuff: lowerArm } = ARM_SHARES;
    const shares = body.capsules.map(({ region }) => ({ head: [0, 0], trunk: [0, 0], upperArm, lowerArm, hand: [1, 1] })[region]);
    this.first = shares.map(([start]) => start!);
    this.last = shares.map(([, end]) => end!);
  }

  /** The moves of the wrists. */
  *moves(): Generator<void, Moves> {
    for (let t = 0; t < this.frames; t++) {
      if (t % FRAMES_A_SLICE === FRAMES_A_SLICE - 1) yield;
      this.places.add(t);
    }
    const moves = yield* this.solveLinear();
    this.measureReach(moves);
    yield* this.findNear(moves);
    return yield* this.touched(moves, this.carried, new Float64Array(moves.length), WRISTS.steps);
  }

  /** The moves once more, from ``moved``: the body with the arms as they lie after the moves so far. */
  *again(moved: Posed): Generator<void, Moves> {
    const base = new Float64Array(6 * this.frames);
    for (let t = 0; t < this.frames; t++) {
      for (const side of [0, 1]) {
        const at = Posed.at(t, side, 2);
        for (let x = 0; x < 3; x++) base[6 * t + 3 * side + x] = moved.arms[at + x]! - this.carried.arms[at + x]!;
      }
    }
    return yield* this.touched(base, moved, base, WRISTS.refining_steps);
  }

  // --- the linear stage ---

  private *solveLinear(): Generator<void, Moves> {
    const { diagonal, off, right } = this.places;
    const band = new Band(2 * this.frames, 4);
    for (let t = 0; t < this.frames; t++) {
      band.add(2 * t, 2 * t, diagonal[2 * t]!);
      band.add(2 * t + 1, 2 * t + 1, diagonal[2 * t + 1]!);
      band.add(2 * t + 1, 2 * t, off[t]!);
    }
    secondDifferences(this.frames, (row, column, value) => {
      for (const side of [0, 1]) band.add(2 * row + side, 2 * column + side, this.smooth * value);
    });
    return yield* band.solve(right.slice(), 3);
  }

  private measureReach(moves: Moves): void {
    for (let t = 0; t < this.frames; t++) {
      for (const side of [0, 1]) {
        if (this.signing[2 * t + side]! <= WRISTS.signing_activity) continue;
        const { length } = this.arm(t, side, moves);
        this.outOfReach[side] = Math.max(this.outOfReach[side]!, length - this.carried.armLengths[side]!);
      }
    }
  }

  /** From shoulder to wrist, the wrist moved. */
  private arm(t: number, side: number, moves: Moves): { x: number; y: number; z: number; length: number } {
    const { arms } = this.carried;
    const [shoulder, wrist, at] = [Posed.at(t, side, 0), Posed.at(t, side, 2), 6 * t + 3 * side];
    const [x, y, z] = [0, 1, 2].map((k) => arms[wrist + k]! + moves[at + k]! - arms[shoulder + k]!) as [number, number, number];
    return { x, y, z, length: Math.sqrt(x * x + y * y + z * z) };
  }

  // --- the contact stage ---

  /** Find the pairs that are near at the source, or on the other body with its wrists moved. */
  private *findNear(moves: Moves): Generator<void, void> {
    const { source, carried, pairs, near, first, last, sides } = this;
    const [starts, ends] = [carried.starts.slice(), carried.ends.slice()];
    const n = sides.length;
    const marks = new Uint8Array(pairs.own.length);
    for (let t = 0; t < this.frames; t++) {
      if (t % FRAMES_A_SLICE === FRAMES_A_SLICE - 1) yield;
      sides.forEach((side, row) => {
        if (side < 0) return;
        for (let x = 0; x < 3; x++) {
          starts[3 * (t * n + row) + x]! += first[row]! * moves[6 * t + 3 * side + x]!;
          ends[3 * (t * n + row) + x]! += last[row]! * moves[6 * t + 3 * side + x]!;
        }
      });
      marks.fill(0);
      markNear(source, t, pairs, CONTACTS.touch_distance_m, marks);
      markNear({ starts, ends, radii: carried.radii }, t, pairs, CONTACTS.watch_distance_m, marks);
      for (let k = 0; k < marks.length; k++) {
        if (!marks[k]) continue;
        gapBetween(source, t, pairs.own[k]!, pairs.other[k]!);
        const then = gap.distance;
        if (then >= CONTACTS.touch_distance_m) {
          gapBetween({ starts, ends, radii: carried.radii }, t, pairs.own[k]!, pairs.other[k]!);
          if (gap.distance >= CONTACTS.watch_distance_m) continue;
        }
        near.frames.push(t);
        near.own.push(pairs.own[k]!);
        near.other.push(pairs.other[k]!);
        near.distances.push(then);
      }
    }
  }

  private *touched(moves: Moves, posed: Posed, base: Moves, steps: number): Generator<void, Moves> {
    for (let step = 0; step < steps; step++) moves = yield* this.step(moves, posed, base);
    return moves;
  }

  /** One Gauss-Newton step from ``moves``, on a body whose wrists are moved by ``base`` in ``posed``. */
  private *step(moves: Moves, posed: Posed, base: Moves): Generator<void, Moves> {
    const { diagonal, off } = this.places;
    const band = this.smoothBand();
    const right = this.places.right.slice();
    for (let k = 0; k < right.length; k++) right[k]! += WRISTS.damping * moves[k]!;
    for (let t = 0; t < this.frames; t++) {
      for (let x = 0; x < 3; x++) {
        band.add(6 * t + x, 6 * t + x, diagonal[2 * t]! + WRISTS.damping);
        band.add(6 * t + 3 + x, 6 * t + 3 + x, diagonal[2 * t + 1]! + WRISTS.damping);
        band.add(6 * t + 3 + x, 6 * t + x, off[t]!);
      }
    }
    this.addContacts(moves, posed, base, band, right);
    this.addReach(moves, band, right);
    return yield* band.solve(right, 1);
  }

  /** The equations of moves of both wrists, with what ties frames to their neighbours. */
  smoothBand(): Band {
    const band = new Band(6 * this.frames, 17);
    secondDifferences(this.frames, (row, column, value) => {
      for (let k = 0; k < 6; k++) band.add(6 * row + k, 6 * column + k, this.smooth * value);
    });
    return band;
  }

  private addContacts(moves: Moves, posed: Posed, base: Moves, band: Band, right: Float64Array): void {
    const { near, first, last, sides } = this;
    const { starts, ends, radii } = posed;
    const n = sides.length;
    const capsules = new Float64Array(12);
    const jacobian = new Float64Array(6);
    const fill = (at: number, t: number, row: number) => {
      const side = Math.max(sides[row]!, 0);
      for (let x = 0; x < 3; x++) {
        const since = moves[6 * t + 3 * side + x]! - base[6 * t + 3 * side + x]!;
        const k = 3 * (t * n + row) + x;
        capsules[at + x] = starts[k]! + first[row]! * since;
        capsules[at + 3 + x] = ends[k]! - starts[k]! + (last[row]! - first[row]!) * since;
      }
    };
    for (let k = 0; k < near.frames.length; k++) {
      const [t, own, other, then] = [near.frames[k]!, near.own[k]!, near.other[k]!, near.distances[k]!];
      fill(0, t, own);
      fill(6, t, other);
      skinGap(capsules, radii[2 * own]!, radii[2 * own + 1]!, radii[2 * other]!, radii[2 * other + 1]!);
      const wanted = Math.min(then, CONTACTS.clearance_m);
      // A pair that lies deep at the source has no skin to touch: it may lie as deep, and is held the less.
      const off = Math.max(Math.abs(then + 0.5 * CONTACTS.press_depth_m) - 0.5 * CONTACTS.press_depth_m, 0);
      const held = then < CONTACTS.touch_distance_m ? CONTACTS.weight * Math.exp(-off / CONTACTS.fade_m) : 0;
      const weight = gap.distance < wanted ? CONTACTS.weight : held;
      if (weight <= CONTACTS.least_weight) continue;
      jacobian.fill(0);
      const [ownSide, otherSide] = [sides[own]!, sides[other]!];
      const ownShare = first[own]! + gap.ownAt * (last[own]! - first[own]!);
      const otherShare = otherSide < 0 ? 0 : first[other]! + gap.otherAt * (last[other]! - first[other]!);
      for (let x = 0; x < 3; x++) {
        jacobian[3 * ownSide + x]! += ownShare * gap.normal[x]!;
        jacobian[3 * Math.max(otherSide, 0) + x]! -= otherShare * gap.normal[x]!;
      }
      addRow(band, right, t, jacobian, weight, wanted - gap.distance, moves);
    }
  }

  /** Keep wrists within reach: the plane at right angles to the arm, where they are beyond. */
  private addReach(moves: Moves, band: Band, right: Float64Array): void {
    const jacobian = new Float64Array(6);
    for (let t = 0; t < this.frames; t++) {
      for (const side of [0, 1]) {
        const { x, y, z, length } = this.arm(t, side, moves);
        const most = WRISTS.reach * this.carried.armLengths[side]!;
        if (length <= most) continue;
        jacobian.fill(0);
        jacobian.set([x / length, y / length, z / length], 3 * side);
        addRow(band, right, t, jacobian, WRISTS.reach_weight, most - length, moves);
      }
    }
  }
}

/** Add a residual: its change with the moves of a frame, its weight, and what it lacks at the present moves. */
export function addRow(
  band: Band, right: Float64Array, t: number, jacobian: Float64Array, weight: number, lack: number, moves: Moves,
): void {
  let goal = lack;
  for (let i = 0; i < 6; i++) goal += jacobian[i]! * moves[6 * t + i]!;
  for (let i = 0; i < 6; i++) {
    if (!jacobian[i]) continue;
    for (let j = 0; j <= i; j++) band.add(6 * t + i, 6 * t + j, weight * jacobian[i]! * jacobian[j]!);
    right[6 * t + i]! += weight * jacobian[i]! * goal;
  }
}
