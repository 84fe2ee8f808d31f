/** The vertices of a mesh that are skin, and the plain statistics that capsules are fitted with. */

import { Vector3 } from 'three';
import { skin_surface as POINTS } from './constants.js';
import { clip } from './gaps.js';

/** Fewer vertices than this are too few to measure. */
export const MIN_POINTS = POINTS.MIN_POINTS;

const { SURFACE } = POINTS;

/** A point of a surface. */
export interface SurfacePoint {
  at: Vector3;
  normal: Vector3;
  /** The vertices of its triangle, and how much of each is in it. */
  corners: [number, number, number];
  shares: [number, number, number];
}

/** What the name of a vertex's material tells: clothing, or what may be no skin. */
export interface Kind {
  isCloth: boolean;
  isDoubtful: boolean;
}

export class SkinPoints {
  private readonly points: Vector3[] = [];
  /** The bones that carry each vertex, and how much. */
  readonly carriers: { bones: number[]; weights: number[] }[] = [];
  /** Bone -> the vertices that it carries, and how much. */
  private readonly carried = new Map<number, { vertex: number; weight: number }[]>();

  private readonly kinds: Kind[] = [];

  private readonly triangles: [number, number, number][] = [];

  /** The number of a vertex that is added; bones of these numbers carry it, so much. */
  add(point: Vector3, bones: number[], weights: number[], kind: Kind): number {
    const vertex = this.points.push(point) - 1;
    this.carriers.push({ bones, weights });
    this.kinds.push(kind);
    bones.forEach((bone, k) => {
      if (!this.carried.has(bone)) this.carried.set(bone, []);
      this.carried.get(bone)!.push({ vertex, weight: weights[k]! });
    });
    return vertex;
  }

  /** Add a triangle between vertices of these numbers. */
  addTriangle(a: number, b: number, c: number): void {
    this.triangles.push([a, b, c]);
  }

  /**
   * The same without doubtful vertices on parts of the body with enough other skin; the part to which a bone belongs, and the least
   * area of each part.
   */
  withoutDoubtful(partOf: (bone: number) => string, least: ReadonlyMap<string, number>): SkinPoints {
    const parts = this.carriers.map(({ bones, weights }) => partOf(bones[weights.indexOf(Math.max(...weights))]!));
    const areas = new Map<string, number>();
    for (const [first, second, third] of this.triangles) {
      if (this.kinds[first]!.isDoubtful) continue;
      const [a, b, c] = [first, second, third].map((vertex) => this.points[vertex]!) as [Vector3, Vector3, Vector3];
      const area = 0.5 * b.clone().sub(a).cross(c.clone().sub(a)).length();
      areas.set(parts[first]!, (areas.get(parts[first]!) ?? 0) + area);
    }
    const kept = new SkinPoints();
    const numbers = this.points.map((point, vertex) => {
      const [part, kind, { bones, weights }] = [parts[vertex]!, this.kinds[vertex]!, this.carriers[vertex]!];
      const isKept = !kind.isDoubtful || (areas.get(part) ?? 0) < least.get(part)!;
      return isKept ? kept.add(point, bones, weights, kind) : -1;
    });
    for (const [first, second, third] of this.triangles) {
      const [a, b, c] = [numbers[first]!, numbers[second]!, numbers[third]!];
      if (Math.min(a, b, c) >= 0) kept.addTriangle(a, b, c);
    }
    return kept;
  }

  /** The vertices that these bones carry together, by half or more: of bare skin where enough of it is modelled, else of clothes too. */
  of(bones: number[]): Vector3[] {
    return [...this.numbersOf(bones, true)].map((vertex) => this.points[vertex]!);
  }

  private numbersOf(bones: number[], isBare: boolean): Set<number> {
    const sums = new Map<number, number>();
    for (const { vertex, weight } of bones.flatMap((bone) => this.carried.get(bone) ?? [])) sums.set(vertex, (sums.get(vertex) ?? 0) + weight);
    const own = [...sums].flatMap(([vertex, sum]) => (sum >= SURFACE.owned_weight ? [vertex] : []));
    const bare = isBare ? own.filter((vertex) => !this.kinds[vertex]!.isCloth) : [];
    return new Set(bare.length >= SURFACE.bare_multiple * MIN_POINTS ? bare : own);
  }

  /** Points on the triangles that these bones carry, about ``step`` apart; of bare skin where that is wanted and enough is modelled. */
  surface(bones: number[], step: number, isBare = false): SurfacePoint[] {
    const own = this.numbersOf(bones, isBare);
    const triangles = this.triangles.flatMap((triangle) => {
      if (!triangle.every((vertex) => own.has(vertex))) return [];
      const [a, b, c] = triangle.map((vertex) => this.points[vertex]!) as [Vector3, Vector3, Vector3];
      const normal = b.clone().sub(a).cross(c.clone().sub(a));
      if (!(normal.length() > 0)) return [];
      const longest = Math.max(a.distanceTo(b), b.distanceTo(c), c.distanceTo(a));
      return [{ a, b, c, corners: triangle, normal: normal.normalize(), rows: clip(Math.ceil(longest / step), 1, SURFACE.triangle_rows) }];
    });
    const samples = triangles.reduce((sum, { rows }) => sum + (rows * (rows + 1)) / 2, 0);
    const points: SurfacePoint[] = [];
    for (let n = 1; n <= SURFACE.triangle_rows; n++) {
      for (const { a, b, c, corners, normal, rows } of triangles) {
        if ((samples > SURFACE.most_samples ? 1 : rows) !== n) continue;
        for (let j = 0; j < n; j++) {
          for (let i = 0; i + j < n; i++) {
            const [u, v] = [(i + 1 / 3) / n, (j + 1 / 3) / n];
            const at = a.clone().multiplyScalar(1 - u - v).addScaledVector(b, u).addScaledVector(c, v);
            points.push({ at, normal, corners, shares: [1 - u - v, u, v] });
          }
        }
      }
    }
    return points;
  }
}

/** Of points, the first in each cube of space. */
export function thinned(points: SurfacePoint[], edge: number): SurfacePoint[] {
  const found = new Map<string, SurfacePoint>();
  for (const point of points) {
    const key = `${Math.floor(point.at.x / edge)} ${Math.floor(point.at.y / edge)} ${Math.floor(point.at.z / edge)}`;
    if (!found.has(key)) found.set(key, point);
  }
  return [...found.values()];
}

/** The value (one of them) below which a share of the values lies. */
export function quantile(values: number[], share: number): number {
  const ordered = Float64Array.from(values).sort();
  return ordered[Math.floor(share * (ordered.length - 1) + 0.5)]!;
}

/** Points whose x and y lie within ``half`` of a place, or within two or four times that; null where these are too few too. */
export function around(points: Vector3[], x: number, y: number, half: number): Vector3[] | null {
  for (const wider of SURFACE.window_factors) {
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
