/** The vertices of a mesh that are skin, and the plain statistics that capsules are fitted with. */

import type { Vector3 } from 'three';

/** Fewer vertices than this are too few to measure. */
export const MIN_POINTS = 6;
const OWN = 0.49; // of a vertex, by the bones that it belongs to

export class SkinPoints {
  private readonly points: Vector3[] = [];
  /** Bone -> the vertices that it carries, and how much. */
  private readonly carried = new Map<number, { vertex: number; weight: number }[]>();

  /** Add a vertex that bones of these numbers carry, and how much. */
  add(point: Vector3, bones: number[], weights: number[]): void {
    const vertex = this.points.push(point) - 1;
    bones.forEach((bone, k) => {
      if (!this.carried.has(bone)) this.carried.set(bone, []);
      this.carried.get(bone)!.push({ vertex, weight: weights[k]! });
    });
  }

  /** The vertices that these bones carry together, by half or more. */
  of(bones: number[]): Vector3[] {
    const sums = new Map<number, number>();
    for (const { vertex, weight } of bones.flatMap((bone) => this.carried.get(bone) ?? [])) sums.set(vertex, (sums.get(vertex) ?? 0) + weight);
    return [...sums].flatMap(([vertex, sum]) => (sum >= OWN ? [this.points[vertex]!] : []));
  }
}

/** The value (one of them) below which a share of the values lies. */
export function quantile(values: number[], share: number): number {
  const ordered = Float64Array.from(values).sort();
  return ordered[Math.floor(share * (ordered.length - 1) + 0.5)]!;
}

/** Points whose x and y lie within ``half`` of a place, or within two or four times that; null where these are too few too. */
export function around(points: Vector3[], x: number, y: number, half: number): Vector3[] | null {
  for (const wider of [1, 2, 4]) {
    const near = points.filter((point) => Math.max(Math.abs(point.x - x), Math.abs(point.y - y)) < wider * half);
    if (near.length >= MIN_POINTS) return near;
  }
  return null;
}

/** The least-squares line through values at ``t``, with a weight for each, at one place. */
export function line(t: number[], values: number[], at: number, weights = t.map(() => 1)): number {
  const total = weights.reduce((a, b) => a + b, 0);
  const mean = (of: (k: number) => number) => weights.reduce((sum, weight, k) => sum + (weight / total) * of(k), 0);
  const [middle, value] = [mean((k) => t[k]!), mean((k) => values[k]!)];
  const spread = mean((k) => (t[k]! - middle) ** 2);
  const slope = spread > 0 ? mean((k) => (t[k]! - middle) * (values[k]! - value)) / spread : 0;
  return value + slope * (at - middle);
}
