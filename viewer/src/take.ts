/** Motion for any avatar: rotations of the humanoid's bones from its rest pose. Played so, hands do not keep their contacts. */

import { type VRMHumanBoneName, VRMHumanBoneList, VRMHumanBoneParentMap } from '@pixiv/three-vrm';
import { VRMAnimation, VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';
import { AnimationMixer, Quaternion, QuaternionKeyframeTrack, Vector3, VectorKeyframeTrack } from 'three';
import { readGltf } from './gltf.js';
import { readAvatar } from './humanoid.js';

/** The motion in a .vrma. */
export async function vrmaTake(content: Uint8Array<ArrayBuffer>): Promise<VRMAnimation> {
  const file = await readGltf(content, (parser) => new VRMAnimationLoaderPlugin(parser));
  const animation = (file.userData['vrmAnimations'] as VRMAnimation[] | undefined)?.[0];
  if (!animation) throw new Error('the clip has no VRM animation');
  return animation;
}

/** The motion in a .glb whose bones are known. */
export async function glbTake(content: Uint8Array<ArrayBuffer>): Promise<VRMAnimation> {
  const [file, { humanoid }] = await readAvatar(content);
  const [clip] = file.animations;
  if (!clip) throw new Error('the file holds no animation');
  file.scene.updateMatrixWorld(true);
  const bones = VRMHumanBoneList.flatMap((name) => {
    const node = humanoid.getRawBoneNode(name);
    return node ? [{ name, node, fromRest: node.getWorldQuaternion(new Quaternion()).invert(), turn: new Quaternion() }] : [];
  });
  const byName = new Map(bones.map((bone) => [bone.name, bone]));
  (file.userData['leaveRestPose'] as (() => void) | undefined)?.();
  const { times } = clip.tracks.reduce((one, other) => (other.times.length > one.times.length ? other : one));
  const rotations = bones.map(() => new Float32Array(4 * times.length));
  const hips = new Float32Array(3 * times.length);
  const mixer = new AnimationMixer(file.scene);
  mixer.clipAction(clip).play();
  times.forEach((time, frame) => {
    mixer.setTime(Math.min(time, times.at(-1)! - 1e-5));
    file.scene.updateMatrixWorld(true);
    bones.forEach(({ name, node, fromRest, turn }, k) => {
      node.getWorldQuaternion(turn).multiply(fromRest);
      const above = boneAbove(name, byName);
      const local = above ? above.turn.clone().invert().multiply(turn) : turn;
      local.toArray(rotations[k]!, 4 * frame);
    });
    bones[0]!.node.getWorldPosition(new Vector3()).toArray(hips, 3 * frame);
  });
  const animation = new VRMAnimation();
  animation.restHipsPosition.fromArray(hips);
  animation.humanoidTracks.translation.set('hips', new VectorKeyframeTrack('hips', times, hips));
  bones.forEach(({ name }, k) => animation.humanoidTracks.rotation.set(name, new QuaternionKeyframeTrack(name, times, rotations[k]!)));
  animation.duration = times.at(-1)! - times[0]!;
  return animation;
}

/** The nearest bone above one, of those that a person has. */
function boneAbove<Bone>(name: VRMHumanBoneName, bones: ReadonlyMap<VRMHumanBoneName, Bone>): Bone | undefined {
  let above = VRMHumanBoneParentMap[name];
  while (above && !bones.has(above)) above = VRMHumanBoneParentMap[above];
  return above ? bones.get(above) : undefined;
}
