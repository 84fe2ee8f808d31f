/** The places of wrists that the linear stage of a fit seeks: in signing space, on the body, and on the other hand. */

import { Posed, SIDES } from './body.js';
import { fit as FIT } from './constants.js';
import { clip, rowsOf } from './gaps.js';

const { WRISTS, ANCHORS } = FIT;

interface Anchor {
  row: number;
  at: number;
}

/** A point on a capsule, and the radius there. */
interface Point {
  x: number;
  y: number;
  z: number;
  radius: number;
}

/** The normal equations of those places, ``carried`` a body whose wrists may move. */
export class Places {
  // By frames: both diagonals and the off-diagonal of a 2 x 2 block, and its right sides.
  readonly diagonal: Float64Array;
  readonly off: Float64Array;
  readonly right: Float64Array;
  private readonly armScale: number;
  private readonly handScale: number;
  private readonly anchors: Anchor[][];
  private readonly solids: number[][];

  /** ``signing``: how much each arm signs, left and right, frame by frame. */
  constructor(private readonly source: Posed, private readonly carried: Posed, private readonly signing: Float64Array) {
    const { body, frames } = source;
    this.armScale = (carried.armLengths[0] + carried.armLengths[1]) / (source.armLengths[0] + source.armLengths[1]);
    this.handScale = carried.body.handLength / source.body.handLength;
    const row = (key: string) => body.capsules.findIndex((capsule) => capsule.key === key);
    this.anchors = SIDES.map((side) => ANCHORS.map(([key, at]) => ({ row: row(side + key), at })).filter((one) => one.row >= 0));
    const solid = rowsOf(body, (region) => region === 'head' || region === 'trunk');
    this.solids = [1, 0].map((other) => [...solid, ...rowsOf(body, (region, side) => region.endsWith('Arm') && side === SIDES[other])]);
    this.diagonal = new Float64Array(2 * frames).fill(WRISTS.space_weight);
    this.off = new Float64Array(frames);
    this.right = new Float64Array(6 * frames);
  }

  /** Add the places of a frame. */
  add(t: number): void {
    this.addSpace(t);
    for (const side of [0, 1]) this.addBodyPlaces(t, side);
    this.addHandPlaces(t);
  }

  /** The wrists' places in signing space. */
  private addSpace(t: number): void {
    const [theirs, ours] = [this.source.arms, this.carried.arms];
    for (const side of [0, 1]) {
      const wrist = Posed.at(t, side, 2);
      for (let x = 0; x < 3; x++) {
        const [left, right] = [Posed.at(t, 0, 0) + x, Posed.at(t, 1, 0) + x];
        const from = 0.5 * (theirs[left]! + theirs[right]!);
        const middle = 0.5 * (ours[left]! + ours[right]!);
        const place = middle + this.armScale * (theirs[wrist + x]! - from);
        this.right[6 * t + 3 * side + x]! += WRISTS.space_weight * (place - ours[wrist + x]!);
      }
    }
  }

  /** The places of a hand's anchors on head, trunk and the other arm. */
  private addBodyPlaces(t: number, side: number): void {
    const signs = this.signing[2 * t + side]!;
    if (!signs) return;
    const { source, carried } = this;
    const n = source.radii.length / 2;
    const at = 6 * t + 3 * side;
    for (const anchor of this.anchors[side]!) {
      const a = pointOn(source, t, anchor);
      const b = pointOn(carried, t, anchor);
      for (const row of this.solids[side]!) {
        const [i, j] = [3 * (t * n + row), 3 * (t * n + row)];
        const [qx, qy, qz] = [source.starts[i]!, source.starts[i + 1]!, source.starts[i + 2]!];
        const [vx, vy, vz] = [source.ends[i]! - qx, source.ends[i + 1]! - qy, source.ends[i + 2]! - qz];
        const along = (a.x - qx) * vx + (a.y - qy) * vy + (a.z - qz) * vz;
        const share = clip(along / (vx * vx + vy * vy + vz * vz + 1e-12));
        const [ox, oy, oz] = [a.x - qx - share * vx, a.y - qy - share * vy, a.z - qz - share * vz];
        const away = Math.sqrt(ox * ox + oy * oy + oz * oz) + 1e-9;
        const distance = away - radiusAt(source.radii, row, share) - a.radius;
        const weight = weightOf(distance) * signs;
        const wanted = (radiusAt(carried.radii, row, share) + b.radius + this.scaled(distance)) / away;
        const [s, e] = [carried.starts, carried.ends];
        this.diagonal[2 * t + side]! += weight;
        this.right[at]! += weight * (s[j]! + share * (e[j]! - s[j]!) + ox * wanted - b.x);
        this.right[at + 1]! += weight * (s[j + 1]! + share * (e[j + 1]! - s[j + 1]!) + oy * wanted - b.y);
        this.right[at + 2]! += weight * (s[j + 2]! + share * (e[j + 2]! - s[j + 2]!) + oz * wanted - b.z);
      }
    }
  }

  /** The places of one hand's anchors on the other hand. */
  private addHandPlaces(t: number): void {
    const signs = Math.min(this.signing[2 * t]!, this.signing[2 * t + 1]!);
    if (!signs) return;
    const [theirLeft, theirRight] = this.anchors.map((anchors) => anchors.map((one) => pointOn(this.source, t, one)));
    const [left, right] = this.anchors.map((anchors) => anchors.map((one) => pointOn(this.carried, t, one)));
    theirLeft!.forEach((a, i) => {
      theirRight!.forEach((b, j) => {
        const [dx, dy, dz] = [a.x - b.x, a.y - b.y, a.z - b.z];
        const away = Math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-9;
        const distance = away - a.radius - b.radius;
        const weight = weightOf(distance) * signs;
        const [p, q] = [left![i]!, right![j]!];
        const wanted = (p.radius + q.radius + this.scaled(distance)) / away;
        const way = [dx * wanted - (p.x - q.x), dy * wanted - (p.y - q.y), dz * wanted - (p.z - q.z)];
        this.diagonal[2 * t]! += weight;
        this.diagonal[2 * t + 1]! += weight;
        this.off[t]! -= weight;
        for (let x = 0; x < 3; x++) {
          this.right[6 * t + x]! += weight * way[x]!;
          this.right[6 * t + 3 + x]! -= weight * way[x]!;
        }
      });
    });
  }

  /** A skin distance on the other body: as it is where it is small, scaled as signing space where it is large. */
  private scaled(distance: number): number {
    const { hand_clearance_m: low, space_clearance_m: high } = WRISTS;
    const share = clip((distance - low) / (high - low));
    return distance * (this.handScale + (this.armScale - this.handScale) * share * share * (3 - 2 * share));
  }
}

function pointOn({ starts, ends, radii }: Posed, t: number, { row, at }: Anchor): Point {
  const k = 3 * ((t * radii.length) / 2 + row);
  const [x, y, z] = [0, 1, 2].map((c) => starts[k + c]! + at * (ends[k + c]! - starts[k + c]!)) as [number, number, number];
  return { x, y, z, radius: radiusAt(radii, row, at) };
}

function radiusAt(radii: Float64Array, row: number, at: number): number {
  return radii[2 * row]! + at * (radii[2 * row + 1]! - radii[2 * row]!);
}

function weightOf(distance: number): number {
  const near = 1 + Math.max(distance, 0) / WRISTS.anchor_fade_m;
  return 1 / (near * near * near * near);
}
