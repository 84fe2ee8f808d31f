/** Points on an avatar's skin that follow its bones as players move them: the method of the Python module body/skin_surface. */

import { Matrix4, type Quaternion, Vector3 } from 'three';
import { skin_surface as SKIN } from './constants.js';
import { KdTree } from './kd_tree.js';
import { type SkinPoints, type SurfacePoint, thinned } from './points.js';

const { SURFACE } = SKIN;

/** The skin that hands meet (the outermost layer on head, neck and trunk), and that of the left and the right hand. */
export interface AvatarSkin {
  body: SkinSurface;
  hands: [SkinSurface, SkinSurface];
}

/** Places in the world, x y z each, and normals there. */
export interface PosedPoints {
  points: number[];
  normals: number[];
}

/** A point in the rest pose and the bones that carry it: columns of a surface's joints, the main one first. */
interface CarriedPoint {
  at: Vector3;
  normal: Vector3;
  columns: number[];
  weights: number[];
}

/** Points of skin and the bones that carry them. */
export class SkinSurface {
  /** Place and normal of each point, x y z. */
  private readonly rest: Float64Array;
  /** The first of each point's ``columns`` and ``weights``, and the end of the last's. */
  private readonly firsts: Uint32Array;
  private readonly columns: Uint16Array;
  private readonly weights: Float64Array;
  /** Columns of a turn and a place, 12 numbers a bone. */
  private readonly turns: Float64Array;

  constructor(
    points: CarriedPoint[],
    private readonly joints: { bone: number; origin: Vector3; toTPose: Quaternion }[],
    /** Distance between neighbouring points, m. */
    readonly spacing: number,
  ) {
    this.rest = Float64Array.from(points.flatMap(({ at, normal }) => [...at.toArray(), ...normal.toArray()]));
    this.columns = Uint16Array.from(points.flatMap(({ columns }) => columns));
    this.weights = Float64Array.from(points.flatMap(({ weights }) => weights));
    this.firsts = new Uint32Array(points.length + 1);
    points.forEach(({ columns }, k) => (this.firsts[k + 1] = this.firsts[k]! + columns.length));
    this.turns = new Float64Array(12 * joints.length);
  }

  /** Points within a distance of a place, where bones have these rotations from the T-pose and these joints; all where none is given. */
  posed(turns: readonly Quaternion[], positions: readonly Vector3[], around: { place: Vector3; radius: number }): PosedPoints {
    const { rest, firsts, columns, weights, turns: moves } = this;
    const seen = new Float64Array(3 * this.joints.length); // the place as each bone sees it at rest
    this.joints.forEach(({ bone, origin, toTPose }, k) => {
      const turn = toTPose.clone().premultiply(turns[bone]!);
      const matrix = new Matrix4().makeRotationFromQuaternion(turn).setPosition(origin.clone().negate().applyQuaternion(turn).add(positions[bone]!));
      for (let column = 0; column < 4; column++) for (let row = 0; row < 3; row++) moves[12 * k + 3 * column + row] = matrix.elements[4 * column + row]!;
      around.place.clone().applyMatrix4(matrix.invert()).toArray(seen, 3 * k);
    });
    const found: PosedPoints = { points: [], normals: [] };
    const [{ x: px, y: py, z: pz }, near, far] = [around.place, around.radius ** 2, (around.radius + SURFACE.blend_distance_m) ** 2];
    const blend = new Float64Array(12);
    for (let n = 0; n + 1 < firsts.length; n++) {
      const [ax, ay, az] = [rest[6 * n]!, rest[6 * n + 1]!, rest[6 * n + 2]!];
      const main = 3 * columns[firsts[n]!]!;
      if ((ax - seen[main]!) ** 2 + (ay - seen[main + 1]!) ** 2 + (az - seen[main + 2]!) ** 2 >= far) continue;
      blend.fill(0);
      for (let k = firsts[n]!; k < firsts[n + 1]!; k++) {
        const [first, weight] = [12 * columns[k]!, weights[k]!];
        for (let c = 0; c < 12; c++) blend[c]! += weight * moves[first + c]!;
      }
      const x = blend[0]! * ax + blend[3]! * ay + blend[6]! * az + blend[9]!;
      const y = blend[1]! * ax + blend[4]! * ay + blend[7]! * az + blend[10]!;
      const z = blend[2]! * ax + blend[5]! * ay + blend[8]! * az + blend[11]!;
      if ((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2 >= near) continue;
      const [u, v, w] = [rest[6 * n + 3]!, rest[6 * n + 4]!, rest[6 * n + 5]!];
      const i = blend[0]! * u + blend[3]! * v + blend[6]! * w;
      const j = blend[1]! * u + blend[4]! * v + blend[7]! * w;
      const k = blend[2]! * u + blend[5]! * v + blend[8]! * w;
      const length = Math.sqrt(i * i + j * j + k * k) + 1e-12;
      found.points.push(x, y, z);
      found.normals.push(i / length, j / length, k / length);
    }
    return found;
  }
}

/**
 * The outermost skin that bones of these numbers carry; null where there is none, or too much. ``rest``, ``toTPose``: of all bones,
 * as they stand. ``isBare``: without clothes, where enough skin is modelled.
 */
export function skinSurface(
  points: SkinPoints, carriers: number[], rest: readonly Vector3[], toTPose: readonly Quaternion[], spacing: number, isBare: boolean,
): SkinSurface | null {
  const all = thinned(points.surface(carriers, spacing, isBare), spacing);
  const covered = coveredBy(all, spacing);
  const kept = all.filter((_, k) => !covered[k]);
  const bones = [...new Set(kept.flatMap(({ corners }) => corners.flatMap((corner) => points.carriers[corner]!.bones)))];
  if (!kept.length || kept.length * bones.length >= SURFACE.most_weights) return null;
  const joints = bones.map((bone) => ({ bone, origin: rest[bone]!, toTPose: toTPose[bone]! }));
  const columns = new Map(bones.map((bone, column) => [bone, column]));
  const carried = kept.map(({ at, normal, corners, shares }) => {
    const weights = new Map<number, number>();
    corners.forEach((corner, c) => {
      const { bones, weights: own } = points.carriers[corner]!;
      bones.forEach((bone, k) => weights.set(columns.get(bone)!, (weights.get(columns.get(bone)!) ?? 0) + shares[c]! * own[k]!));
    });
    const ordered = [...weights].sort(([, a], [, b]) => b - a);
    return { at, normal, columns: ordered.map(([column]) => column), weights: ordered.map(([, weight]) => weight) };
  });
  return new SkinSurface(carried, joints, spacing);
}

/** What ``leastHeight`` finds: the least height above a surface, infinite where none is near, and the direction out of it there. */
export interface Height {
  least: number;
  out: Vector3;
}

/**
 * The least height of a hand's points, moved by a vector, above a surface; points that are little higher count in its direction, by
 * ``sharp``, m. Those that lie farther ``beside`` the normal of the nearest point, or deeper than ``thick``, are beyond its edge.
 */
export function leastHeight(
  hand: ArrayLike<number>, by: Vector3, tree: KdTree, normals: ArrayLike<number>, beside: number, thick: number, sharp: number,
): Height {
  const heights: number[] = [];
  const rows: number[] = [];
  for (let k = 0; k < hand.length; k += 3) {
    const [x, y, z] = [hand[k]! + by.x, hand[k + 1]! + by.y, hand[k + 2]! + by.z];
    const row = 3 * tree.nearest(x, y, z, SURFACE.comparison_m);
    if (row < 0) continue;
    const { points } = tree;
    const height = (x - points[row]!) * normals[row]! + (y - points[row + 1]!) * normals[row + 1]! + (z - points[row + 2]!) * normals[row + 2]!;
    if (tree.squared - height * height >= beside * beside || height <= -thick) continue;
    heights.push(height);
    rows.push(row);
  }
  const least = heights.reduce((one, other) => Math.min(one, other), Infinity);
  const out = new Vector3();
  heights.forEach((height, k) => {
    const weight = Math.exp((least - height) / sharp);
    const row = rows[k]!;
    out.x += weight * normals[row]!;
    out.y += weight * normals[row + 1]!;
    out.z += weight * normals[row + 2]!;
  });
  return { least, out: out.divideScalar(out.length() + 1e-12) };
}

/** Which points lie under others that face the same way: skin below a shirt. */
function coveredBy(points: SurfacePoint[], spacing: number): boolean[] {
  const tree = new KdTree(Float64Array.from(points.flatMap(({ at }) => at.toArray())));
  const { cover_height_m: lift, cover_distance_m: reach, cover_points: most } = SURFACE;
  const away = new Vector3();
  return points.map(({ at, normal }) => {
    const near: { other: number; squared: number }[] = [];
    tree.within(Float64Array.of(...at.toArray()), reach, (other, squared) => near.push({ other, squared }));
    if (near.length > most) near.sort((a, b) => a.squared - b.squared).length = most;
    return near.some(({ other, squared }) => {
      const height = away.copy(points[other]!.at).sub(at).dot(normal);
      return height > lift && squared - height * height < spacing * spacing && points[other]!.normal.dot(normal) > SURFACE.facing_cosine;
    });
  });
}
