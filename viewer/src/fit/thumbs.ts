/** Thumbs that keep what they touch within their hand, on a hand of other proportions: the method of the Python module
 * body/thumb_contacts, which gives the equations. */

import { Quaternion, Vector3 } from 'three';
import { Band } from './band.js';
import { type Body, lengthOf, median, type Posed, type Rotations, SIDES } from './body.js';
import { capsules as HANDS, thumb_contacts as THUMBS } from './constants.js';
import { clip, gap, gapBetween } from './gaps.js';

const { ALIKE, MOST_RADIANS, NEAR_M, FADE_M, DAMPING, TOGETHER, APART_RADIANS, STEPS, WIDTH_S, THUMB, SEGMENTS, FLEXION } = THUMBS;
const N = 7; // unknowns: the thumb's rotation vector, and an angle for each finger

/** A pair of a thumb's capsule and a finger's or the palm's, in a frame. */
interface Touch {
  /** Points of the thumb and of what it touches, and what lies between them at the source. */
  p: Vector3;
  q: Vector3;
  wanted: Vector3;
  weight: number;
  /** 1 to 4 for a finger, 0 for the palm, which no finger moves. */
  finger: number;
}

/**
 * Rotations with thumbs and fingers turned at their first joints so that thumbs touch what they touched; the same where hands have
 * the same proportions. ``source``, ``carried``: both bodies in all frames, with the same capsules.
 */
export function* keepThumbContacts(source: Posed, carried: Posed, fps: number): Generator<void, Rotations> {
  const rotations: Rotations = new Map(carried.rotations);
  for (const side of SIDES) {
    const thumb = THUMB.map((name) => side + name).find((key) => rowOf(carried.body, key) >= 0);
    const firsts = [thumb ?? '', ...HANDS.FINGERS.slice(1).map((finger) => `${side}${finger}Proximal`)];
    if (firsts.some((key) => rowOf(carried.body, key) < 0) || areAlike(source.body, carried.body, side)) continue;
    const turns = yield* turnsOf(side, firsts, source, carried, fps);
    firsts.forEach((first, n) => turn(rotations, carried.body, first, turns, n));
  }
  return rotations;
}

function rowOf(body: Body, key: string): number {
  return body.capsules.findIndex((capsule) => capsule.key === key);
}

/** Whether the bones of two hands have the same proportions. */
function areAlike(one: Body, other: Body, side: string): boolean {
  const ratios = one.capsules.flatMap((capsule, row) => {
    const isOwn = capsule.key.startsWith(side) && HANDS.FINGERS.some((finger) => capsule.key.includes(finger));
    return isOwn && lengthOf(capsule) > 0 ? [lengthOf(other.capsules[row]!) / lengthOf(capsule)] : [];
  });
  const middle = median(ratios);
  return ratios.every((ratio) => Math.abs(ratio / middle - 1) < ALIKE);
}

/** Rotation vectors of the first joints of the thumb and four fingers, x y z each, frame by frame. */
function* turnsOf(side: string, firsts: string[], source: Posed, carried: Posed, fps: number): Generator<void, Float64Array> {
  const { body } = carried;
  const rows = firsts.map((key) => rowOf(body, key));
  const own = THUMB.slice(1).map((name) => rowOf(body, side + name)).filter((row) => row >= 0);
  const other = HANDS.FINGERS.slice(1).flatMap((finger, n) =>
    SEGMENTS.map((segment) => ({ row: rowOf(body, side + finger + segment), finger: segment === 'Palm' ? 0 : n + 1 })).filter(({ row }) => row >= 0),
  );
  const turns = new Float64Array(15 * carried.frames);
  const [turn, bones] = [new Quaternion(), firsts.map((key) => carried.rotations.get(key)!)];
  for (let t = 0; t < carried.frames; t++) {
    if (t % 16 === 15) yield;
    const touches = own.flatMap((thumb) => other.flatMap(({ row, finger }) => touchOf(source, carried, t, thumb, row, finger)));
    if (!touches.length) continue;
    const pivots = rows.map((row) => new Vector3().fromArray(carried.starts, 3 * (t * body.capsules.length + row)));
    const axes = bones.slice(1).map((values) => new Vector3().fromArray(FLEXION).applyQuaternion(turn.fromArray(values, 4 * (carried.from + t))));
    solve(touches, pivots, axes, coupling(source, t, rows.slice(1))).forEach((vector, n) => vector.toArray(turns, 15 * t + 3 * n));
  }
  return spreadInTime(turns, 15, WIDTH_S * fps);
}

function touchOf(source: Posed, carried: Posed, t: number, thumb: number, row: number, finger: number): Touch[] {
  gapBetween(source, t, thumb, row);
  const weight = Math.exp(-Math.max(gap.distance, 0) / FADE_M) - Math.exp(-NEAR_M / FADE_M);
  if (weight <= 0) return [];
  const { starts, ends, radii } = carried;
  const [p, q] = ([[thumb, gap.ownAt], [row, gap.otherAt]] as const).map(([of, at]) => {
    const k = 3 * ((t * radii.length) / 2 + of);
    return new Vector3().fromArray(starts, k).lerp(new Vector3().fromArray(ends, k), at);
  }) as [Vector3, Vector3];
  const thick = radii[2 * thumb]! + gap.ownAt * (radii[2 * thumb + 1]! - radii[2 * thumb]!);
  const otherThick = radii[2 * row]! + gap.otherAt * (radii[2 * row + 1]! - radii[2 * row]!);
  const wanted = new Vector3().fromArray(gap.normal).multiplyScalar(gap.distance + thick + otherThick);
  return [{ p, q, wanted, weight, finger }];
}

/** How neighbouring fingers that lie together at the source hold each other, by pairs. */
function coupling({ starts, ends, radii }: Posed, t: number, rows: number[]): number[] {
  const along = rows.map((row) => {
    const k = 3 * ((t * radii.length) / 2 + row);
    return new Vector3().fromArray(ends, k).sub(new Vector3().fromArray(starts, k)).normalize();
  });
  return [0, 1, 2].map((n) => TOGETHER * Math.exp(-((Math.acos(clip(along[n]!.dot(along[n + 1]!), -1)) / APART_RADIANS) ** 2)));
}

/** Rotation vectors of the first joints of the thumb and four fingers, which bend about ``axes``. */
function solve(touches: Touch[], pivots: Vector3[], axes: Vector3[], together: number[]): Vector3[] {
  const x = new Float64Array(N);
  const vectors = () => [new Vector3(x[0], x[1], x[2]), ...axes.map((axis, n) => axis.clone().multiplyScalar(x[3 + n]!))];
  for (let step = 0; step < STEPS; step++) {
    const normal = Array.from({ length: N }, (_, i) => Float64Array.from({ length: N }, (_, j) => (i === j ? DAMPING : 0)));
    together.forEach((value, n) => {
      for (const [i, j, sign] of [[3, 3, 1], [4, 4, 1], [3, 4, -1], [4, 3, -1]] as const) normal[i + n]![j + n]! += sign * value;
    });
    const slope = Float64Array.from(normal, (row) => row.reduce((sum, value, j) => sum + value * x[j]!, 0));
    const turns = vectors().map(rotation);
    for (const { p, q, wanted, weight, finger } of touches) {
      const thumb = p.clone().sub(pivots[0]!).applyQuaternion(turns[0]!);
      const pivot = pivots[Math.max(finger, 1)]!;
      const arm = q.clone().sub(pivot);
      if (finger) arm.applyQuaternion(turns[finger]!);
      const error = thumb.clone().add(pivots[0]!).sub(pivot).sub(arm).sub(wanted);
      const columns = Array.from({ length: N }, () => new Vector3());
      for (let k = 0; k < 3; k++) columns[k]!.setComponent(k, 1).cross(thumb);
      if (finger) columns[2 + finger]!.copy(axes[finger - 1]!).cross(arm).negate();
      for (let i = 0; i < N; i++) {
        slope[i]! += weight * columns[i]!.dot(error);
        for (let j = 0; j < N; j++) normal[i]![j]! += weight * columns[i]!.dot(columns[j]!);
      }
    }
    const band = new Band(N, N - 1);
    for (let i = 0; i < N; i++) for (let j = 0; j <= i; j++) band.add(i, j, normal[i]![j]!);
    for (const work = band.solve(slope, 1); !work.next().done; );
    slope.forEach((value, i) => (x[i]! -= value));
    const most = Math.min(1, MOST_RADIANS / (Math.hypot(x[0]!, x[1]!, x[2]!) + 1e-12));
    for (let k = 0; k < N; k++) x[k] = k < 3 ? x[k]! * most : clip(x[k]!, -MOST_RADIANS, MOST_RADIANS);
  }
  return vectors();
}

function rotation(vector: Vector3): Quaternion {
  const angle = vector.length();
  return angle > 0 ? new Quaternion().setFromAxisAngle(vector.clone().divideScalar(angle), angle) : new Quaternion();
}

/** Values (``wide`` a frame) spread to their neighbours in time by a bell of a width in frames, no larger than the largest nearby. */
function spreadInTime(values: Float64Array, wide: number, width: number): Float64Array {
  const frames = values.length / wide;
  const side = Math.ceil(3 * width);
  const pushed = Array.from({ length: frames }, (_, t) => values.subarray(wide * t, wide * (t + 1)).some(Boolean));
  const spread = new Float64Array(values.length);
  for (let t = 0; t < frames; t++) {
    let total = 0;
    for (let from = Math.max(0, t - side); from <= Math.min(frames - 1, t + side); from++) {
      if (!pushed[from]) continue;
      const weight = Math.exp(-0.5 * ((from - t) / width) ** 2);
      total += weight;
      for (let k = 0; k < wide; k++) spread[wide * t + k]! += weight * values[wide * from + k]!;
    }
    for (let k = 0; k < wide; k++) spread[wide * t + k]! /= Math.max(total, 1);
  }
  return spread;
}

/** Turn a finger's first bone, and those below it, by the ``n``-th of five rotation vectors a frame. */
function turn(rotations: Rotations, { bones }: Body, first: string, turns: Float64Array, n: number): void {
  const moved = new Set([bones.findIndex(({ name }) => name === first)]);
  bones.forEach(({ parent }, k) => moved.has(parent) && moved.add(k));
  const [vector, own] = [new Vector3(), new Quaternion()];
  for (const bone of moved) {
    const values = rotations.get(bones[bone]!.name)!.slice();
    for (let t = 0; 4 * t < values.length; t++) {
      own.fromArray(values, 4 * t).premultiply(rotation(vector.fromArray(turns, 15 * t + 3 * n))).toArray(values, 4 * t);
    }
    rotations.set(bones[bone]!.name, values);
  }
}
