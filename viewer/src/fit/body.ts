/** Bodies: bones at rest in the T-pose with the capsules that they carry, and where these are in each frame of a motion. */

import { Quaternion, Vector3 } from 'three';
import type { FitCapsule } from '../wire.js';
import type { AvatarSkin } from './skin_surface.js';

/** A bone of a humanoid. */
export interface Bone {
  /** Its VRM 1.0 name. */
  name: string;
  /** Number of the bone above, -1 for the hips; bones come after those that carry them. */
  parent: number;
  /** From the joint of the bone above in the T-pose, m. */
  offset: Vector3;
}

/** Bones and skin of one person. */
export interface Body {
  bones: Bone[];
  capsules: FitCapsule[];
  /** Median length of the palms' capsules, m. */
  handLength: number;
  /** Its mesh where hands meet it; null where that is not known. */
  skin: AvatarSkin | null;
}

/** Rotations of bones from the T-pose in the world's axes: x y z w, frame by frame. */
export type Rotations = Map<string, Float64Array>;

export const SIDES = ['left', 'right'] as const;

export function makeBody(bones: Bone[], capsules: FitCapsule[], skin: AvatarSkin | null = null): Body {
  const palms = capsules.filter(({ key }) => /(Palm|Mitten)$/.test(key)).map(lengthOf);
  return { bones, capsules, handLength: median(palms), skin };
}

export function lengthOf({ start, end }: FitCapsule): number {
  return Math.hypot(end[0] - start[0], end[1] - start[1], end[2] - start[2]);
}

export function median(values: number[]): number {
  const ordered = [...values].sort((a, b) => a - b);
  const half = ordered.length >> 1;
  return ordered.length % 2 ? ordered[half]! : (ordered[half - 1]! + ordered[half]!) / 2;
}

/** Joints of a body's bones in the T-pose, the hips at the origin, m. */
export function restPositions(bones: Bone[]): Vector3[] {
  const found: Vector3[] = [];
  for (const { parent, offset } of bones) found.push(parent < 0 ? new Vector3() : offset.clone().add(found[parent]!));
  return found;
}

/** Two bodies with the capsules that both have, in the same order. */
export function shared(one: Body, other: Body): [Body, Body] {
  const keys = new Map(other.capsules.map((capsule) => [capsule.key, capsule]));
  const kept = one.capsules.filter(({ key }) => keys.has(key));
  return [{ ...one, capsules: kept }, { ...other, capsules: kept.map(({ key }) => keys.get(key)!) }];
}

/** A body in the frames [from, to) of a motion, the hips at the origin; m. */
export class Posed {
  readonly frames: number;
  /** Ends of the capsules' axes: x y z, capsule by capsule, frame by frame. */
  readonly starts: Float64Array;
  readonly ends: Float64Array;
  /** At start and end, capsule by capsule. */
  readonly radii: Float64Array;
  /** Shoulder, elbow and wrist of the left, then of the right arm: x y z, frame by frame. */
  readonly arms: Float64Array;
  readonly armLengths: [number, number];

  constructor(readonly body: Body, readonly rotations: Rotations, readonly from: number, to: number) {
    const { bones, capsules } = body;
    this.frames = to - from;
    this.starts = new Float64Array(3 * this.frames * capsules.length);
    this.ends = new Float64Array(3 * this.frames * capsules.length);
    this.radii = Float64Array.from(capsules.flatMap(({ radii }) => radii));
    this.arms = new Float64Array(18 * this.frames);
    const number = new Map(bones.map(({ name }, k) => [name, k]));
    const carriers = capsules.map(({ bone }) => number.get(bone)!);
    const starts = capsules.map(({ start }) => new Vector3(...start));
    const ends = capsules.map(({ end }) => new Vector3(...end));
    const joints = SIDES.flatMap((side) => ['UpperArm', 'LowerArm', 'Hand'].map((bone) => number.get(side + bone)!));
    const positions = bones.map(() => new Vector3());
    const turns = bones.map(() => new Quaternion());
    const point = new Vector3();
    for (let t = 0; t < this.frames; t++) {
      this.pose(t, turns, positions);
      carriers.forEach((bone, c) => {
        const at = 3 * (t * capsules.length + c);
        point.copy(starts[c]!).applyQuaternion(turns[bone]!).add(positions[bone]!).toArray(this.starts, at);
        point.copy(ends[c]!).applyQuaternion(turns[bone]!).add(positions[bone]!).toArray(this.ends, at);
      });
      joints.forEach((bone, k) => positions[bone]!.toArray(this.arms, 18 * t + 3 * k));
    }
    const rest = restPositions(bones);
    const length = (k: number) => rest[joints[k]!]!.distanceTo(rest[joints[k + 1]!]!);
    this.armLengths = [length(0) + length(1), length(3) + length(4)];
  }

  /** Put rotations and joints of all bones in a frame into these. */
  pose(frame: number, turns: Quaternion[], positions: Vector3[]): void {
    this.body.bones.forEach(({ name, parent, offset }, k) => {
      const own = this.rotations.get(name);
      if (own) turns[k]!.fromArray(own, 4 * (this.from + frame));
      else if (parent >= 0) turns[k]!.copy(turns[parent]!);
      if (parent >= 0) positions[k]!.copy(offset).applyQuaternion(turns[parent]!).add(positions[parent]!);
    });
  }

  /** Where ``arms`` holds the shoulder (0), elbow (1) or wrist (2) of a side (0 left, 1 right) in a frame. */
  static at(frame: number, side: number, joint: number): number {
    return 18 * frame + 9 * side + 3 * joint;
  }
}
