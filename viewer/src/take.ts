/** Motion that any avatar can play: rotations of the humanoid's bones, and the body that they were signed with. */

import type { VRMExpressionPresetName, VRMHumanBoneName } from '@pixiv/three-vrm';
import { VRMAnimation, VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';
import { AnimationMixer, NumberKeyframeTrack, type Object3D, Quaternion, QuaternionKeyframeTrack, Vector3, VectorKeyframeTrack } from 'three';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import { type AvatarBody, motionOf, signingOf, usualBodyOf } from './fit/avatar.js';
import { makeBody, type Rotations } from './fit/body.js';
import type { Motion } from './fit/fit.js';
import { readGltf } from './gltf.js';
import { readAvatar } from './humanoid.js';
import type { FitSource } from './wire.js';

/** Presets of VRM that are ARKit's coefficients; of the others an avatar may have several that move the same part. */
const LIDS: Readonly<Record<string, VRMExpressionPresetName>> = { eyeBlinkLeft: 'blinkLeft', eyeBlinkRight: 'blinkRight' };

export interface Take {
  animation: VRMAnimation;
  /** As the fit needs it. */
  motion: Motion;
}

/** What a .vrma holds; ``source``: the body of its signer, where it is known. */
export async function vrmaTake(content: Uint8Array<ArrayBuffer>, source: FitSource | null): Promise<Take> {
  const file = await readGltf(content, (parser) => new VRMAnimationLoaderPlugin(parser));
  const animation = (file.userData['vrmAnimations'] as VRMAnimation[] | undefined)?.[0];
  if (!animation) throw new Error('the clip has no VRM animation');
  return { animation, motion: await motionOf(file, animation, source) };
}

/** The motion in a .glb whose bones are known. */
export async function glbTake(content: Uint8Array<ArrayBuffer>, source: FitSource | null = null): Promise<Take> {
  const signer = await Signer.read(content, source);
  const times = signer.times;
  const worlds = signer.bones.map(() => new Float64Array(4 * times.length));
  const hips = new Float64Array(3 * times.length);
  times.forEach((time, frame) => signer.pose(time, worlds, hips, frame));
  return signer.take(worlds, hips, times);
}

/** The person in a .glb, who signs. */
export class Signer {
  readonly bones: string[];
  readonly times: Float32Array;
  private readonly mixer: AnimationMixer;
  /** Where the hips are at first, from whose height players scale the motion. */
  private readonly hips: Vector3;
  /** From a bone at rest as the file has it to the T-pose, both in the world's axes, inverted. */
  private readonly fromTPose: Quaternion[];

  private constructor(
    readonly file: GLTF,
    private readonly nodes: Object3D[],
    readonly body: AvatarBody,
    /** The bones' names in the file. */
    readonly names: string[],
  ) {
    const clip = file.animations[0];
    if (!clip) throw new Error('the file holds no animation');
    this.bones = body.bones.map(({ name }) => name);
    this.fromTPose = nodes.map((node, k) => node.getWorldQuaternion(new Quaternion()).invert().multiply(body.toTPose[k]!.clone().invert()));
    const longest = clip.tracks.reduce((one, other) => (other.times.length > one.times.length ? other : one));
    this.times = Float32Array.from(longest.times);
    (file.userData['leaveBindPose'] as (() => void) | undefined)?.();
    this.mixer = new AnimationMixer(file.scene);
    this.mixer.clipAction(clip).play();
    this.mixer.setTime(0);
    file.scene.updateMatrixWorld(true);
    this.hips = nodes[0]!.getWorldPosition(new Vector3());
  }

  static async read(content: Uint8Array<ArrayBuffer>, source: FitSource | null): Promise<Signer> {
    const [file, avatar] = await readAvatar(content);
    avatar.scene.updateMatrixWorld(true);
    const found = usualBodyOf(avatar);
    const body = source ? { ...found, ...makeBody(found.bones, source.capsules) } : found;
    const nodes = body.bones.map(({ name }) => avatar.humanoid.getRawBoneNode(name as VRMHumanBoneName)!);
    const { nodes: named } = file.parser.json as { nodes: { name: string }[] };
    const names = nodes.map((node) => named[file.parser.associations.get(node)!.nodes!]!.name);
    return new Signer(file, nodes, body, names);
  }

  /** Put rotations of the bones and the position of the hips at a time, in the world's axes, into a frame of these arrays. */
  pose(time: number, worlds: Float64Array[], hips: Float64Array, frame: number): void {
    this.mixer.setTime(Math.min(time, this.times.at(-1)! - 1e-5));
    this.file.scene.updateMatrixWorld(true);
    this.nodes.forEach((node, k) => node.getWorldQuaternion(new Quaternion()).toArray(worlds[k]!, 4 * frame));
    this.nodes[0]!.getWorldPosition(new Vector3()).toArray(hips, 3 * frame);
  }

  /** A take of such rotations and positions, and of ARKit's coefficients by their names, frame by frame. */
  take(worlds: Float64Array[], hips: Float64Array, times: Float32Array, faces: ReadonlyMap<string, Float32Array> = new Map()): Take {
    const frames = times.length;
    const rotations: Rotations = new Map();
    const animation = new VRMAnimation();
    const [own, above] = [new Quaternion(), new Quaternion()];
    this.body.bones.forEach(({ name, parent }, k) => {
      const values = new Float64Array(4 * frames);
      const local = new Float32Array(4 * frames);
      const over = parent < 0 ? null : rotations.get(this.bones[parent]!)!;
      for (let at = 0; at < values.length; at += 4) {
        own.fromArray(worlds[k]!, at).multiply(this.fromTPose[k]!).toArray(values, at);
        if (over) own.premultiply(above.fromArray(over, at).invert());
        own.toArray(local, at);
      }
      rotations.set(name, values);
      animation.humanoidTracks.rotation.set(name as VRMHumanBoneName, new QuaternionKeyframeTrack(name, times, local));
    });
    animation.restHipsPosition.copy(this.hips);
    animation.humanoidTracks.translation.set('hips', new VectorKeyframeTrack('hips', times, Float32Array.from(hips)));
    for (const [name, weights] of faces) {
      const track = new NumberKeyframeTrack(name, times, weights);
      animation.expressionTracks.custom.set(name, track);
      if (LIDS[name]) animation.expressionTracks.preset.set(LIDS[name], track);
    }
    animation.duration = times.at(-1)! - times[0]!;
    const fps = frames > 1 ? (frames - 1) / animation.duration : 30;
    const signing = signingOf(this.body, rotations, frames, fps);
    return { animation, motion: { body: this.body, rotations, frames, fps, times, signing } };
  }
}
