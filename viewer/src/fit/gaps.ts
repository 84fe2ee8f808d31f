/** Skin distances within one body: between hands, and from hands and forearms to head, trunk and arms. */

import type { Body, Posed } from './body.js';
import { SIDES } from './body.js';

const TINY = 1e-12;

/** All pairs of some capsules with others, as rows of a body's capsules. */
export interface Block {
  own: number[];
  other: number[];
}

/** Pairs of capsules whose distance matters; ``own`` is of a hand or forearm. */
export interface Pairs {
  blocks: Block[];
  own: number[];
  other: number[];
}

/** 0 where a capsule is of the left arm or hand, 1 of the right, -1 where it is of head or trunk. */
export function sidesOf(body: Body): number[] {
  return body.capsules.map(({ side, region }) => (region === 'head' || region === 'trunk' ? -1 : SIDES.indexOf(side as 'left')));
}

export function rowsOf(body: Body, wanted: (region: string, side: string, key: string) => boolean): number[] {
  return body.capsules.flatMap(({ region, side, key }, row) => (wanted(region, side, key) ? [row] : []));
}

/** All pairs of a hand's capsules and those of head, trunk, other arm and other hand. */
export function skinPairs(body: Body): Pairs {
  const [left, right] = SIDES.map((own) => rowsOf(body, (region, side) => region === 'hand' && side === own));
  const solid = rowsOf(body, (region) => region === 'head' || region === 'trunk');
  const [leftArm, rightArm] = SIDES.map((own) => rowsOf(body, (region, side) => region.endsWith('Arm') && side === own));
  return pairsOf([
    { own: left!, other: [...solid, ...rightArm!] },
    { own: right!, other: [...solid, ...leftArm!] },
    { own: left!, other: right! },
  ]);
}

/** All pairs of a forearm and a capsule of head or trunk, but where arms begin. */
export function forearmPairs(body: Body, own: string): Pairs {
  const solid = rowsOf(
    body,
    (region, _, key) => (region === 'head' || region === 'trunk') && !key.endsWith('Shoulder') && !key.startsWith('collar'),
  );
  return pairsOf([{ own: rowsOf(body, (region, side) => region === 'lowerArm' && side === own), other: solid }]);
}

function pairsOf(blocks: Block[]): Pairs {
  return {
    blocks,
    own: blocks.flatMap(({ own, other }) => own.flatMap((row) => other.map(() => row))),
    other: blocks.flatMap(({ own, other }) => own.flatMap(() => other)),
  };
}

/** Capsules over time: ends x y z, capsule by capsule, frame by frame; radii at start and end. */
export type Capsules = Pick<Posed, 'starts' | 'ends' | 'radii'>;

/**
 * Mark the pairs that may be nearer than ``margin`` in a frame: first by a ball around each whole hand or forearm, then by
 * one around each of its capsules.
 */
export function markNear({ starts, ends, radii }: Capsules, frame: number, pairs: Pairs, margin: number, marks: Uint8Array): void {
  const first = (frame * radii.length) / 2;
  const middle = new Float64Array(3);
  let offset = 0;
  for (const { own, other } of pairs.blocks) {
    const middles = own.map((row) => [0, 1, 2].map((x) => 0.5 * (starts[3 * (first + row) + x]! + ends[3 * (first + row) + x]!)));
    const reaches = own.map((row) => 0.5 * axisLength(starts, ends, 3 * (first + row)) + Math.max(radii[2 * row]!, radii[2 * row + 1]!));
    for (let x = 0; x < 3; x++) middle[x] = middles.reduce((sum, point) => sum + point[x]!, 0) / own.length;
    const ball = Math.max(
      ...middles.map(([x, y, z], a) => Math.hypot(x! - middle[0]!, y! - middle[1]!, z! - middle[2]!) + reaches[a]!),
    );
    other.forEach((row, b) => {
      const at = 3 * (first + row);
      const thick = Math.max(radii[2 * row]!, radii[2 * row + 1]!) + margin;
      if (squaredDistance(middle, starts, ends, at) >= (ball + thick) ** 2) return;
      middles.forEach((point, a) => {
        if (squaredDistance(point, starts, ends, at) < (reaches[a]! + thick) ** 2) marks[offset + a * other.length + b] = 1;
      });
    });
    offset += own.length * other.length;
  }
}

function axisLength(starts: Float64Array, ends: Float64Array, at: number): number {
  return Math.hypot(ends[at]! - starts[at]!, ends[at + 1]! - starts[at + 1]!, ends[at + 2]! - starts[at + 2]!);
}

function squaredDistance(point: ArrayLike<number>, starts: Float64Array, ends: Float64Array, at: number): number {
  const [x, y, z] = [starts[at]!, starts[at + 1]!, starts[at + 2]!];
  const [u, v, w] = [ends[at]! - x, ends[at + 1]! - y, ends[at + 2]! - z];
  const [a, b, c] = [point[0]! - x, point[1]! - y, point[2]! - z];
  const along = clip((a * u + b * v + c * w) / (u * u + v * v + w * w + TINY));
  return (a - along * u) ** 2 + (b - along * v) ** 2 + (c - along * w) ** 2;
}

export function clip(value: number, least = 0, most = 1): number {
  return value < least ? least : value > most ? most : value;
}

/** What ``skinGap`` finds: distance (negative inside), the unit vector from the other capsule to the own one, and where along each
 * axis the nearest points lie, 0 to 1. */
export const gap = { distance: 0, normal: new Float64Array(3), ownAt: 0, otherAt: 0 };

/** Fill ``gap`` with the skin distance of two capsules: starts and axes p u, q v (Ericson 2005, 5.1.9), radii at both ends. */
export function skinGap(ends: Float64Array, r0: number, r1: number, s0: number, s1: number): void {
  const [px, py, pz, ux, uy, uz] = [ends[0]!, ends[1]!, ends[2]!, ends[3]!, ends[4]!, ends[5]!];
  const [qx, qy, qz, vx, vy, vz] = [ends[6]!, ends[7]!, ends[8]!, ends[9]!, ends[10]!, ends[11]!];
  const [rx, ry, rz] = [px - qx, py - qy, pz - qz];
  const uu = ux * ux + uy * uy + uz * uz + TINY;
  const vv = vx * vx + vy * vy + vz * vz + TINY;
  const uv = ux * vx + uy * vy + uz * vz;
  const ur = ux * rx + uy * ry + uz * rz;
  const vr = vx * rx + vy * ry + vz * rz;
  let s = clip((uv * vr - ur * vv) / Math.max(uu * vv - uv * uv, TINY));
  const t = clip((uv * s + vr) / vv);
  s = clip((uv * t - ur) / uu);
  const [x, y, z] = [rx + s * ux - t * vx, ry + s * uy - t * vy, rz + s * uz - t * vz];
  const away = Math.sqrt(x * x + y * y + z * z) + TINY;
  gap.distance = away - (r0 + s * (r1 - r0)) - (s0 + t * (s1 - s0));
  gap.normal[0] = x / away;
  gap.normal[1] = y / away;
  gap.normal[2] = z / away;
  gap.ownAt = s;
  gap.otherAt = t;
}

const ENDS = new Float64Array(12);

/** Fill ``gap`` with the skin distance of two capsules of a body in a frame. */
export function gapBetween({ starts, ends, radii }: Capsules, frame: number, own: number, other: number): void {
  const first = (frame * radii.length) / 2;
  for (let x = 0; x < 3; x++) {
    const [a, b] = [3 * (first + own) + x, 3 * (first + other) + x];
    ENDS[x] = starts[a]!;
    ENDS[3 + x] = ends[a]! - starts[a]!;
    ENDS[6 + x] = starts[b]!;
    ENDS[9 + x] = ends[b]! - starts[b]!;
  }
  skinGap(ENDS, radii[2 * own]!, radii[2 * own + 1]!, radii[2 * other]!, radii[2 * other + 1]!);
}
