/** The T-pose of a skeleton that may stand a little otherwise at rest: the method of the Python module rig/t_pose. */

import { Matrix4, Quaternion, Vector3 } from 'three';
import { t_pose as POSE } from './constants.js';
import { SIDES } from './body.js';

const BONES: Record<string, readonly [string, readonly number[]]> = POSE.T_POSE_BONES;
const UPRIGHT: readonly string[] = POSE.UPRIGHT;

/** Rotations in the world's axes that bring bones at rest into the T-pose; bones in order, ``joints`` where they are at rest. */
export function toTPose(names: readonly string[], parents: readonly number[], joints: ReadonlyMap<string, Vector3>): Quaternion[] {
  const upright = uprightOf(joints);
  const found: Quaternion[] = [];
  names.forEach((name, k) => {
    const parent = parents[k]!;
    let turn = (parent < 0 || UPRIGHT.includes(name) ? upright : found[parent]!).clone();
    const towards = BONES[name];
    const child = towards && joints.get(towards[0]);
    if (child) {
      const bone = child.clone().sub(joints.get(name)!).applyQuaternion(turn);
      turn.premultiply(new Quaternion().setFromUnitVectors(bone.normalize(), new Vector3().fromArray(towards[1]).normalize()));
    } else if (name === 'leftHand' || name === 'rightHand') {
      turn = handTurn(name === 'leftHand' ? 'left' : 'right', joints, turn);
    }
    found.push(turn);
  });
  return found;
}

/** The rotation that brings the rest pose's up to +Y and its left to +X. */
function uprightOf(joints: ReadonlyMap<string, Vector3>): Quaternion {
  const top = ['head', 'neck', 'upperChest', 'chest', 'spine'].map((name) => joints.get(name)).find(Boolean);
  for (const part of ['UpperLeg', 'Shoulder', 'UpperArm']) {
    const [left, right] = SIDES.map((side) => joints.get(side + part));
    if (!top || !left || !right) continue;
    const [across, up] = [left.clone().sub(right), top.clone().sub(joints.get('hips')!)];
    if (across.clone().cross(up).length() > 1e-9) return frame(across, up);
  }
  return new Quaternion();
}

/** A hand follows the direction to its middle knuckle and its line of knuckles. */
function handTurn(side: 'left' | 'right', joints: ReadonlyMap<string, Vector3>, above: Quaternion): Quaternion {
  const [index, middle, little] = ['Index', 'Middle', 'Little'].map((finger) => joints.get(`${side}${finger}Proximal`));
  const out = side === 'left' ? 1 : -1;
  if (!middle) return above;
  const along = middle.clone().sub(joints.get(`${side}Hand`)!);
  if (!index || !little) {
    const now = along.applyQuaternion(above).normalize();
    return new Quaternion().setFromUnitVectors(now, new Vector3(out, 0, 0)).multiply(above);
  }
  const across = index.clone().sub(little);
  const back = across.clone().cross(along).multiplyScalar(out);
  if (!(back.length() > 1e-9 * along.length() * across.length())) return above;
  return frame(along.multiplyScalar(out), back);
}

/** The rotation that takes the direction ``y`` to +Y and the part of ``x`` at right angles to it to +X. */
function frame(x: Vector3, y: Vector3): Quaternion {
  const up = y.clone().normalize();
  const left = x.clone().addScaledVector(up, -x.dot(up)).normalize();
  return new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(left, up, left.clone().cross(up))).invert();
}
