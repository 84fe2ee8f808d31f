/**
 * Arms bent so that wrists move by given vectors, bone lengths kept and hands turned as before: the method of the Python module
 * body/arm_ik, which gives the equations.
 */

import { Quaternion, Vector3 } from 'three';
import { Posed, type Rotations, SIDES } from './body.js';
import { arm_ik as IK } from './constants.js';
import { clip } from './gaps.js';
import type { Moves } from './solver.js';

const HINGES = IK.HINGES.map(([x, y, z]) => new Vector3(x, y, z));

interface Bent {
  /** Of all below the elbow about the elbow. */
  bend: Quaternion;
  /** Then of the whole arm about the shoulder. */
  aim: Quaternion;
  elbow: Vector3;
  wrist: Vector3;
}

/**
 * The rotations of a body's bones in the frames of ``posed``, with its wrists moved; a place beyond reach is approached as far as
 * possible. ``swivels``: angles of left and right elbow about the line from shoulder to wrist, frame by frame.
 */
export function moveWrists(posed: Posed, moves: Moves, swivels: Float64Array): Rotations {
  const { frames, from, rotations } = posed;
  const moved: Rotations = new Map();
  for (const [bone, values] of rotations) moved.set(bone, values.slice(4 * from, 4 * (from + frames)));
  const quaternion = new Quaternion();
  SIDES.forEach((name, side) => {
    const [upper, lower] = [moved.get(`${name}UpperArm`)!, moved.get(`${name}LowerArm`)!];
    for (let t = 0; t < frames; t++) {
      const { bend, aim } = bent(posed, t, side, moves, swivels[2 * t + side]!);
      quaternion.fromArray(upper, 4 * t).premultiply(aim).toArray(upper, 4 * t);
      quaternion.fromArray(lower, 4 * t).premultiply(bend).premultiply(aim).toArray(lower, 4 * t);
    }
  });
  return moved;
}

/** Shoulders, elbows and wrists as ``Posed.arms`` has them, after ``moveWrists``. */
export function movedArms(posed: Posed, moves: Moves): Float64Array {
  const arms = posed.arms.slice();
  for (let t = 0; t < posed.frames; t++) {
    for (const side of [0, 1]) {
      const { elbow, wrist } = bent(posed, t, side, moves, 0);
      elbow.toArray(arms, Posed.at(t, side, 1));
      wrist.toArray(arms, Posed.at(t, side, 2));
    }
  }
  return arms;
}

function bent(posed: Posed, t: number, side: number, moves: Moves, swivel: number): Bent {
  const [s, e, w] = [0, 1, 2].map((joint) => new Vector3().fromArray(posed.arms, Posed.at(t, side, joint))) as [Vector3, Vector3, Vector3];
  const way = new Vector3().fromArray(moves, 6 * t + 3 * side).add(w).sub(s);
  const [upper, lower] = [e.clone().sub(s), w.clone().sub(e)];
  const [a, b] = [upper.length(), lower.length()];
  const wanted = clip(way.length(), Math.abs(a - b) / IK.REACH + IK.TINY, IK.REACH * (a + b));
  const normal = upper.clone().cross(lower);
  if (normal.length() < IK.STRAIGHT * a * b) {
    const turn = new Quaternion().fromArray(posed.rotations.get(`${SIDES[side]!}UpperArm`)!, 4 * (posed.from + t));
    normal.copy(HINGES[side]!).applyQuaternion(turn);
    const along = upper.clone().divideScalar(a);
    normal.addScaledVector(along, -normal.dot(along));
  }
  const turn = flexion(a, b, wanted) - flexion(a, b, w.clone().sub(s).length());
  const bend = new Quaternion().setFromAxisAngle(normal.normalize(), turn);
  const forearm = lower.applyQuaternion(bend);
  const reach = upper.clone().add(forearm).normalize();
  const aim = new Quaternion().setFromUnitVectors(reach, way.normalize());
  if (swivel) aim.premultiply(new Quaternion().setFromAxisAngle(way, swivel));
  const elbow = upper.applyQuaternion(aim).add(s);
  return { bend, aim, elbow, wrist: forearm.applyQuaternion(aim).add(elbow) };
}

/** Radians by which an elbow is bent, 0 when straight. */
function flexion(a: number, b: number, distance: number): number {
  return Math.PI - Math.acos(clip((a * a + b * b - distance * distance) / (2 * a * b), -1));
}
