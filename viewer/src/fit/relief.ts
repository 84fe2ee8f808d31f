/** How far an avatar's skin lies above its capsules, where hands come near: the method of the Python module body/relief. */

import { type Quaternion, Vector3 } from 'three';
import { relief as RELIEF } from './constants.js';
import { clip } from './gaps.js';
import type { SurfacePoint } from './points.js';

const { AROUND_M, SHARP_M, FARTHEST_M, FACING, HIDDEN_M, SHOWN_M } = RELIEF;

/** A capsule under the surface, in the rest pose; ``fromTPose`` turns its bone's axes there from those of the T-pose. */
export interface CapsuleUnder {
  key: string;
  start: Vector3;
  end: Vector3;
  radii: [number, number];
  fromTPose: Quaternion;
}

/** The surface of an avatar's head, neck and trunk in its rest pose. */
export class Relief {
  private readonly under: Map<string, CapsuleUnder>;
  /** The surface's points by cubes whose edge is the farthest distance at which they count. */
  private readonly cubes = new Map<number, SurfacePoint[]>();

  constructor(surface: SurfacePoint[], under: CapsuleUnder[]) {
    this.under = new Map(under.map((one) => [one.key, one]));
    for (const point of surface) {
      const key = cube(point.at, 0, 0, 0);
      if (!this.cubes.has(key)) this.cubes.set(key, []);
      this.cubes.get(key)!.push(point);
    }
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
    let [sum, total] = [0, 0];
    for (let i = -1; i <= 1; i++) {
      for (let j = -1; j <= 1; j++) {
        for (let k = -1; k <= 1; k++) {
          for (const { at, normal } of this.cubes.get(cube(place, i, j, k)) ?? []) {
            const [x, y, z] = [at.x - place.x, at.y - place.y, at.z - place.z];
            const height = x * out.x + y * out.y + z * out.z;
            const squared = x * x + y * y + z * z;
            const beside = Math.max(squared - height * height, 0) / (AROUND_M * AROUND_M);
            if (beside >= 1 || squared > FARTHEST_M * FARTHEST_M || normal.dot(out) <= FACING) continue;
            const weight = (1 - beside) ** 2 * Math.exp(height / SHARP_M);
            sum += weight * height;
            total += weight;
          }
        }
      }
    }
    return total > 0 ? sum / total : 0;
  }

  /** How much of a place on a capsule is skin: 1 on the outside of all others, 0 within one. */
  private shown(key: string, place: Vector3): number {
    let deepest = 0;
    for (const { key: other, start, end, radii } of this.under.values()) {
      if (other === key) continue;
      const axis = end.clone().sub(start);
      const since = place.clone().sub(start);
      const t = clip(since.dot(axis) / (axis.lengthSq() + 1e-12));
      deepest = Math.max(deepest, radii[0] + t * (radii[1] - radii[0]) - since.addScaledVector(axis, -t).length());
    }
    return clip((HIDDEN_M - deepest) / (HIDDEN_M - SHOWN_M));
  }
}

/** The number of the cube that lies so many cubes beside that of a place. */
function cube({ x, y, z }: Vector3, i: number, j: number, k: number): number {
  const number = (value: number, beside: number) => Math.floor(value / FARTHEST_M) + beside + 512;
  return (number(x, i) * 1024 + number(y, j)) * 1024 + number(z, k);
}
