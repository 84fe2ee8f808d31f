/**
 * Where elbows go: turned about the line from shoulder to wrist, so that forearms keep as clear of head and trunk as at the source.
 * The method of the Python module body/swivel.
 */

import { Vector3 } from 'three';
import { movedArms } from './arms.js';
import { Posed, SIDES } from './body.js';
import { retarget as MARGINS, swivel as SWIVEL } from './constants.js';
import { forearmPairs, gap, gapBetween, markNear, skinGap } from './gaps.js';
import type { Moves } from './solver.js';

const { GRID, TURN, TURN_WEIGHT, CHANGE_WEIGHT, WIDTH_S, LEAST_WIDTH, DEEP, AROUND_S } = SWIVEL;

/** Angles of left and right elbow, frame by frame, radians. */
export function* chooseSwivels(source: Posed, carried: Posed, moves: Moves, fps: number): Generator<void, Float64Array> {
  const chosen = new Float64Array(2 * carried.frames);
  const arms = movedArms(carried, moves);
  for (const side of [0, 1]) {
    yield;
    const forearm = new Forearm(source, carried, arms, side);
    const turns = forearm.solids.length ? yield* forearm.turns(fps) : null;
    turns?.forEach((angle, t) => (chosen[2 * t + side] = angle));
  }
  return chosen;
}

/** A forearm over time and the solids near it. */
class Forearm {
  /** Rows of the capsules that it comes near in any frame. */
  readonly solids: number[] = [];
  private readonly own: number;
  private readonly capsules = new Float64Array(12);

  constructor(
    private readonly source: Posed,
    private readonly carried: Posed,
    private readonly arms: Float64Array,
    private readonly side: number,
  ) {
    const pairs = forearmPairs(carried.body, SIDES[side]!);
    this.own = pairs.own[0] ?? -1;
    if (this.own < 0) return;
    const [starts, ends] = [carried.starts.slice(), carried.ends.slice()];
    const n = carried.radii.length / 2;
    const marks = new Uint8Array(pairs.own.length);
    for (let t = 0; t < carried.frames; t++) {
      for (let x = 0; x < 3; x++) {
        starts[3 * (t * n + this.own) + x] = arms[Posed.at(t, side, 1) + x]!;
        ends[3 * (t * n + this.own) + x] = arms[Posed.at(t, side, 2) + x]!;
      }
      markNear({ starts, ends, radii: carried.radii }, t, pairs, MARGINS.FOREARM_MARGIN_M, marks);
    }
    this.solids = pairs.other.filter((_, k) => marks[k]);
  }

  /** Turns of the elbow, radians, that keep the forearm from lying deeper in a solid than at the source. */
  *turns(fps: number): Generator<void, Float64Array> {
    const { frames } = this.carried;
    const turns = new Float64Array(frames);
    const elbow = new Vector3();
    const deep: number[] = [];
    for (let t = 0; t < frames; t++) {
      if (this.depthCost(t, elbow.fromArray(this.arms, Posed.at(t, this.side, 1))) > DEEP) deep.push(t);
    }
    if (!deep.length) return turns;
    const reach = Math.ceil(AROUND_S * fps);
    const from = Math.max(deep[0]! - reach, 0);
    const to = Math.min(deep.at(-1)! + reach + 1, frames);
    const costs: number[][] = [];
    for (let t = from; t < to; t++) {
      if (t % 32 === 31) yield;
      const [s, e, w] = [0, 1, 2].map((joint) => new Vector3().fromArray(this.arms, Posed.at(t, this.side, joint))) as [Vector3, Vector3, Vector3];
      const axis = w.sub(s).divideScalar(w.length() + 1e-9);
      const middle = axis.clone().multiplyScalar(e.sub(s).dot(axis));
      const out = e.sub(middle);
      const across = axis.clone().cross(out);
      middle.add(s);
      costs.push(
        GRID.map((angle) => {
          elbow.copy(middle).addScaledVector(out, Math.cos(angle)).addScaledVector(across, Math.sin(angle));
          return this.depthCost(t, elbow) + TURN_WEIGHT * (angle / TURN) ** 2;
        }),
      );
    }
    turns.set(smoothed(smoothest(costs).map((k) => GRID[k]!), Math.max(WIDTH_S * fps, LEAST_WIDTH)), from);
    return turns;
  }

  /** Squared depth of the forearm beyond the source's, summed over the solids, cm^2. */
  private depthCost(t: number, elbow: Vector3): number {
    const { starts, ends, radii } = this.carried;
    const n = radii.length / 2;
    const wrist = Posed.at(t, this.side, 2);
    elbow.toArray(this.capsules, 0);
    for (let x = 0; x < 3; x++) this.capsules[3 + x] = this.arms[wrist + x]! - this.capsules[x]!;
    let cost = 0;
    for (const row of this.solids) {
      for (let x = 0; x < 3; x++) {
        const k = 3 * (t * n + row) + x;
        this.capsules[6 + x] = starts[k]!;
        this.capsules[9 + x] = ends[k]! - starts[k]!;
      }
      skinGap(this.capsules, radii[2 * this.own]!, radii[2 * this.own + 1]!, radii[2 * row]!, radii[2 * row + 1]!);
      if (gap.distance >= 0) continue;
      const now = gap.distance;
      gapBetween(this.source, t, this.own, row);
      const depth = Math.max(-now - Math.max(-gap.distance, 0), 0);
      cost += 1e4 * depth * depth;
    }
    return cost;
  }
}

/** The choice of each row with the least cost in all, changes included (Viterbi). */
function smoothest(costs: number[][]): number[] {
  const back: number[][] = [];
  let best = costs[0]!;
  for (const row of costs.slice(1)) {
    const came: number[] = [];
    best = row.map((cost, k) => {
      let least = 0;
      const total = (from: number) => best[from]! + CHANGE_WEIGHT * (from - k) ** 2;
      for (let from = 1; from < best.length; from++) if (total(from) < total(least)) least = from;
      came.push(least);
      return total(least) + cost;
    });
    back.push(came);
  }
  const chosen = [best.indexOf(Math.min(...best))];
  for (const came of back.reverse()) chosen.push(came[chosen.at(-1)!]!);
  return chosen.reverse();
}

/** Values smoothed by a bell of a width in frames. */
function smoothed(values: number[], width: number): number[] {
  const side = Math.ceil(3 * width);
  const bell = Array.from({ length: 2 * side + 1 }, (_, k) => Math.exp(-0.5 * ((k - side) / width) ** 2));
  const sum = bell.reduce((total, weight) => total + weight, 0);
  const value = (k: number) => values[Math.max(0, Math.min(values.length - 1, k))]!;
  return values.map((_, t) => bell.reduce((total, weight, k) => total + (weight / sum) * value(t + k - side), 0));
}
