/** How far an avatar's skin lies above its capsules, where hands come near: the method of the Python module body/skin_surface. */

import { type Quaternion, Vector3 } from 'three';
import { skin_surface as SKIN } from './constants.js';
import { clip } from './gaps.js';
import type { SurfacePoint } from './points.js';

const { RELIEF, SURFACE } = SKIN;
const FARTHEST_M = RELIEF.place_distance_m;

/** A capsule under the surface, in the rest pose; ``fromTPose`` turns its bone's axes there from those of the T-pose. */
export interface CapsuleUnder {
  key: string;
  start: Vector3;
  end: Vector3;
  radii: [number, number];
  fromTPose: Quaternion;
}

const EDGE = FARTHEST_M / 2; // of a cube, m

/** The surface of an avatar's head, neck and trunk in its rest pose. */
export class Relief {
  private readonly under: Map<string, CapsuleUnder>;
  /** The surface's points and their normals, x y z each, by cubes of space. */
  private readonly cubes = new Map<number, Float64Array>();
  private readonly distances: Float64Array; // scratch: squared, of the points around a place

  constructor(surface: SurfacePoint[], under: CapsuleUnder[]) {
    this.under = new Map(under.map((one) => [one.key, one]));
    const cubes = new Map<number, number[]>();
    for (const { at, normal } of surface) {
      const number = cubeAt(Math.floor(at.x / EDGE), Math.floor(at.y / EDGE), Math.floor(at.z / EDGE));
      if (!cubes.has(number)) cubes.set(number, []);
      cubes.get(number)!.push(at.x, at.y, at.z, normal.x, normal.y, normal.z);
    }
    this.distances = new Float64Array(surface.length);
    for (const [number, points] of cubes) this.cubes.set(number, Float64Array.from(points));
  }

  /** Height of the skin above a capsule, m: where along its axis, and in which direction in the axes of the T-pose. */
  height(key: string, at: number, direction: Vector3): number {
    const capsule = this.under.get(key);
    if (!capsule) return 0;
    const out = direction.clone().applyQuaternion(capsule.fromTPose);
    const radius = capsule.radii[0] + at * (capsule.radii[1] - capsule.radii[0]);
    const place = capsule.start.clone().lerp(capsule.end, at).addScaledVector(out, radius);
    const shown = this.shown(key, place);
    return shown ? shown * this.above(place, out) : 0;
  }

  private above(place: Vector3, out: Vector3): number {
    const [px, py, pz, nx, ny, nz] = [place.x, place.y, place.z, out.x, out.y, out.z];
    const [i, j, k] = [Math.floor(px / EDGE), Math.floor(py / EDGE), Math.floor(pz / EDGE)];
    const near: Float64Array[] = [];
    let count = 0;
    for (let a = i - 2; a <= i + 2; a++) {
      for (let b = j - 2; b <= j + 2; b++) {
        for (let c = k - 2; c <= k + 2; c++) {
          const points = this.cubes.get(cubeAt(a, b, c));
          if (!points) continue;
          near.push(points);
          for (let n = 0; n < points.length; n += 6) {
            const squared = (points[n]! - px) ** 2 + (points[n + 1]! - py) ** 2 + (points[n + 2]! - pz) ** 2;
            if (squared < FARTHEST_M * FARTHEST_M) this.distances[count++] = squared;
          }
        }
      }
    }
    if (!count) return 0;
    const { nearest_points: nearest, line_distance_m: lineDistance } = RELIEF;
    const most = count > nearest ? this.distances.subarray(0, count).sort()[nearest - 1]! : FARTHEST_M * FARTHEST_M;
    let sum = 0;
    let total = 0;
    for (const points of near) {
      for (let n = 0; n < points.length; n += 6) {
        const x = points[n]! - px;
        const y = points[n + 1]! - py;
        const z = points[n + 2]! - pz;
        const squared = x ** 2 + y ** 2 + z ** 2;
        if (squared > most) continue;
        const height = x * nx + y * ny + z * nz;
        const beside = Math.max(squared - height * height, 0) / (lineDistance * lineDistance);
        if (beside >= 1 || points[n + 3]! * nx + points[n + 4]! * ny + points[n + 5]! * nz <= SURFACE.facing_cosine) continue;
        const weight = (1 - beside) * (1 - beside) * Math.exp(height / RELIEF.outermost_fade_m);
        sum += weight * height;
        total += weight;
      }
    }
    return total > 0 ? sum / total : 0;
  }

  /** How much of a place on a capsule is skin: 1 on the outside of all others, 0 within one. */
  private shown(key: string, place: Vector3): number {
    let deepest = 0;
    for (const { key: other, start, end, radii } of this.under.values()) {
      if (other === key) continue;
      const [x, y, z] = [end.x - start.x, end.y - start.y, end.z - start.z];
      const [u, v, w] = [place.x - start.x, place.y - start.y, place.z - start.z];
      const t = clip((x * u + y * v + z * w) / (x * x + y * y + z * z + 1e-12));
      const away = Math.sqrt((u - t * x) ** 2 + (v - t * y) ** 2 + (w - t * z) ** 2);
      deepest = Math.max(deepest, radii[0] + t * (radii[1] - radii[0]) - away);
    }
    const { hidden_depth_m: hidden, visible_depth_m: visible } = RELIEF;
    return clip((hidden - deepest) / (hidden - visible));
  }
}

/** The number of a cube of space. */
function cubeAt(i: number, j: number, k: number): number {
  return ((i + 512) * 1024 + j + 512) * 1024 + k + 512;
}
