/** A VRM animation and an avatar as the fit sees them, and the fitted motion as tracks that the avatar plays. */

import type { VRM, VRMHumanBoneName } from '@pixiv/three-vrm';
import { VRMHumanBoneList, VRMHumanBoneParentMap } from '@pixiv/three-vrm';
import type { VRMAnimation } from '@pixiv/three-vrm-animation';
import { type Object3D, Quaternion, QuaternionKeyframeTrack, Vector3 } from 'three';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import type { FitSource } from '../wire.js';
import { type Body, type Bone, makeBody, Posed, type Rotations } from './body.js';
import { usualCapsules } from './capsules.js';
import { info as ARMS, retarget as RETARGET } from './constants.js';
import type { Motion } from './fit.js';
import { clip } from './gaps.js';
import { skinOf } from './mesh.js';
import { fitSkin } from './skin.js';
import { toTPose as turnsToTPose } from './t_pose.js';

/** The motion of a .vrma with the body of its signer, or a usual one where that is not known. */
export async function motionOf(file: GLTF, animation: VRMAnimation, source: FitSource | null): Promise<Motion> {
  const { rotation } = animation.humanoidTracks;
  const { humanBones } = file.parser.json.extensions.VRMC_vrm_animation.humanoid as { humanBones: Record<string, { node: number }> };
  const nodes = new Map<VRMHumanBoneName, Object3D>();
  for (const name of VRMHumanBoneList) {
    const number = humanBones[name]?.node;
    if (number !== undefined) nodes.set(name, (await file.parser.getDependency('node', number)) as Object3D);
  }
  file.scene.updateMatrixWorld(true);
  const joints = new Map([...nodes].map(([name, node]) => [name, new Vector3().setFromMatrixPosition(node.matrixWorld)]));
  const bones = bonesAt(joints);
  const times = rotation.get('hips' as VRMHumanBoneName)!.times;
  const frames = times.length;
  if (source && source.signing.length !== frames) throw new Error('the VRM animation and the body of its signer have other numbers of frames');
  const fps = frames > 1 ? (frames - 1) / (times.at(-1)! - times[0]!) : 30;
  const rotations: Rotations = new Map();
  const [above, own] = [new Quaternion(), new Quaternion()];
  for (const { name, parent } of bones) {
    const values = new Float64Array(4 * frames);
    const local = rotation.get(name as VRMHumanBoneName)?.values;
    const over = parent < 0 ? null : rotations.get(bones[parent]!.name)!;
    for (let t = 0; t < frames; t++) {
      if (over) above.fromArray(over, 4 * t);
      if (local) own.fromArray(local, 4 * t);
      else own.identity();
      own.premultiply(above).normalize().toArray(values, 4 * t);
    }
    rotations.set(name, values);
  }
  const body = makeBody(bones, source?.capsules ?? usualCapsules(bones, new Map()));
  const signing = source ? Float64Array.from(source.signing.flat()) : signingOf(body, rotations, frames, fps);
  return { body, rotations, frames, fps, times: Float32Array.from(times), signing };
}

/** How much each arm signs in each frame: 1 while it is raised and the arms are away from rest, else 0. */
export function signingOf(body: Body, rotations: Rotations, frames: number, fps: number): Float64Array {
  const { HANGING, RAISED, FADE_S } = RETARGET;
  const { arms, armLengths } = new Posed(body, rotations, 0, frames);
  /** Height of an elbow (1) or wrist (2) above where it hangs, arm lengths. */
  const lift = (frame: number, side: number, joint: number) =>
    1 + (arms[Posed.at(frame, side, joint) + 1]! - arms[Posed.at(frame, side, 0) + 1]!) / armLengths[side]!;
  const reach = Float64Array.from({ length: frames }, (_, t) => Math.max(lift(t, 0, 2), lift(t, 1, 2)));
  const peak = reach.reduce((one, other) => Math.max(one, other));
  /** Frames from an end on until the arms leave their rest there. */
  const atRest = (ordered: Float64Array, end: number) => {
    const isBelow = [0, 1].every((side) => lift(end, side, 2) < lift(end, side, 1));
    const rise = peak - ordered[0]!;
    return isBelow && rise > ARMS.NO_REST_LIFT ? ordered.findIndex((height) => height >= ordered[0]! + ARMS.RAISED_FRACTION * rise) : 0;
  };
  const start = atRest(reach, 0);
  const stop = frames - atRest(reach.slice().reverse(), frames - 1);
  return Float64Array.from({ length: 2 * frames }, (_, k) => {
    const t = k >> 1;
    const outside = Math.max(start - t, t - (stop - 1), 0) / fps;
    return clip((HANGING - 1 + lift(t, k % 2, 2)) / (HANGING - RAISED)) * clip(1 - outside / FADE_S);
  });
}

/** An avatar's body in the T-pose, and the rotations that bring its bones there from where they are at rest, world axes. */
export interface AvatarBody extends Body {
  toTPose: Quaternion[];
}

/** The bones of an avatar that stands as it was loaded. */
function standing(avatar: VRM) {
  const flip = facesBack(avatar) ? -1 : 1;
  const place = (point: Vector3) => point.set(flip * point.x, point.y, flip * point.z);
  const joints = new Map<VRMHumanBoneName, Vector3>();
  for (const name of VRMHumanBoneList) {
    const rest = avatar.humanoid.normalizedRestPose[name]?.position;
    const over = parentOf(name, joints);
    if (!rest) continue;
    const joint = place(new Vector3(...rest));
    joints.set(name, over ? joint.add(joints.get(over)!) : joint);
  }
  const atRest = bonesAt(joints);
  const names = atRest.map(({ name }) => name);
  const toTPose = turnsToTPose(names, atRest.map(({ parent }) => parent), joints);
  const bones = atRest.map(({ name, parent, offset }) => ({
    name, parent, offset: parent < 0 ? offset : offset.clone().applyQuaternion(toTPose[parent]!),
  }));
  const tips = new Map<string, Vector3[]>();
  names.forEach((name, k) => {
    if (name.endsWith('Distal')) tips.set(name, tipsOf(avatar, name, joints, place).map((tip) => tip.applyQuaternion(toTPose[k]!)));
  });
  return { place, joints, names, atRest, bones, toTPose, usual: usualCapsules(bones, tips) };
}

/** The body of a person of the usual proportions who stands as it was loaded. */
export function usualBodyOf(person: VRM): AvatarBody {
  const { bones, usual, toTPose } = standing(person);
  return { ...makeBody(bones, usual), toTPose };
}

/** The body of an avatar that stands as it was loaded, fitted to its mesh. */
export function bodyOf(file: GLTF, avatar: VRM): AvatarBody {
  const { place, joints, names, atRest, bones, toTPose, usual } = standing(avatar);
  // Measured as it stands, upright.
  const upright = toTPose[0]!;
  const hips = joints.get('hips')!;
  const points = skinOf(file, avatar, names, (point) => place(point).sub(hips).applyQuaternion(upright));
  const stood = {
    bones: atRest.map(({ name, parent, offset }) => ({ name, parent, offset: offset.clone().applyQuaternion(upright) })),
    toTPose: toTPose.map((turn) => turn.clone().multiply(upright.clone().invert())),
  };
  const { capsules, skin } = fitSkin(stood, usual, points);
  return { ...makeBody(bones, capsules, skin), toTPose };
}

/** Nodes below the last joint of a finger, from that joint. */
function tipsOf(avatar: VRM, name: string, joints: ReadonlyMap<string, Vector3>, place: (point: Vector3) => Vector3): Vector3[] {
  const node = avatar.humanoid.getRawBoneNode(name as VRMHumanBoneName);
  return (node?.children ?? []).map((child) => place(child.getWorldPosition(new Vector3())).sub(joints.get(name)!));
}

/** Tracks of the avatar's bones that play these rotations from the T-pose. */
export function tracksOf(avatar: VRM, { bones, toTPose }: AvatarBody, rotations: Rotations, times: Float32Array): QuaternionKeyframeTrack[] {
  const flip = facesBack(avatar) ? -1 : 1;
  const [own, above] = [new Quaternion(), new Quaternion()];
  return bones.map(({ name, parent }, bone) => {
    const values = rotations.get(name)!;
    const over = parent < 0 ? null : rotations.get(bones[parent]!.name)!;
    const local = new Float32Array(values.length);
    for (let k = 0; k < values.length; k += 4) {
      own.fromArray(values, k).multiply(toTPose[bone]!);
      if (over) own.premultiply(above.fromArray(over, k).multiply(toTPose[parent]!).invert());
      own.set(flip * own.x, own.y, flip * own.z, own.w).toArray(local, k);
    }
    const node = avatar.humanoid.getNormalizedBoneNode(name as VRMHumanBoneName)!;
    return new QuaternionKeyframeTrack(`${node.name}.quaternion`, times as unknown as number[], local as unknown as number[]);
  });
}

/** Whether an avatar at rest faces -Z, as those of VRM 0 do. */
function facesBack(avatar: VRM): boolean {
  return avatar.meta.metaVersion === '0';
}

function parentOf(name: VRMHumanBoneName, known: ReadonlyMap<VRMHumanBoneName, unknown>): VRMHumanBoneName | null {
  let over = VRMHumanBoneParentMap[name];
  while (over && !known.has(over)) over = VRMHumanBoneParentMap[over];
  return over;
}

/** Bones between joints in the T-pose. */
function bonesAt(joints: ReadonlyMap<VRMHumanBoneName, Vector3>): Bone[] {
  const names = VRMHumanBoneList.filter((name) => joints.has(name));
  return names.map((name) => {
    const over = parentOf(name, joints);
    const offset = joints.get(name)!.clone();
    return { name, parent: over ? names.indexOf(over) : -1, offset: over ? offset.sub(joints.get(over)!) : offset };
  });
}
