/** The signer on the stage: the clip's mannequin, or an avatar that plays its VRM animation, fitted to its body. */

import { type VRM, type VRMHumanBoneName, VRMLoaderPlugin, VRMUtils } from '@pixiv/three-vrm';
import { createVRMAnimationClip } from '@pixiv/three-vrm-animation';
import {
  AnimationClip,
  AnimationMixer,
  Box3,
  Group,
  MathUtils,
  Mesh,
  NumberKeyframeTrack,
  type Object3D,
  Quaternion,
  QuaternionKeyframeTrack,
  Vector3,
  VectorKeyframeTrack,
} from 'three';
import { type AvatarBody, bodyOf, tracksOf } from './fit/avatar.js';
import { type Fitted, fitMotion, inSlices } from './fit/fit.js';
import { readGltf } from './gltf.js';
import { readAvatar, rolesOf } from './humanoid.js';
import type { Take } from './take.js';

const PLACE = ['hips', 'leftUpperArm', 'rightUpperArm'] as const;
const ROLES = [...PLACE, 'leftHand', 'rightHand', 'leftMiddleProximal', 'rightMiddleProximal'] as const;
const FAR = 0.5; // m from the middle, where a figure leaves the picture
const HANGING = 0.2; // of upper arms at rest, radians from straight down
const ARMS = ['left', 'right'].flatMap((side) => ['UpperArm', 'LowerArm', 'Hand'].map((bone) => side + bone));
const END = 1e-4; // seconds before a clip's end, since a looping action shows its first frame at the end
/** The bodies of avatars by their files: measuring a mesh takes longer than fitting a sentence. */
const bodies = new WeakMap<Uint8Array, AvatarBody>();

export class Person {
  readonly root = new Group();
  private readonly mixer: AnimationMixer;
  private body: AvatarBody | null = null; // of an avatar
  private shown = 0;
  private readonly palms: Object3D[];

  private constructor(
    figure: Object3D,
    private clip: AnimationClip,
    bone: (role: (typeof ROLES)[number]) => Object3D | null,
    private readonly vrm?: VRM,
    /** How the motion was fitted to an avatar; null where it plays as it is. */
    readonly fitted: Fitted | null = null,
  ) {
    this.root.add(figure);
    figure.traverse((node) => {
      node.frustumCulled = false; // the bounds of a skinned mesh do not follow its bones
      node.castShadow = node.receiveShadow = true;
    });
    const both = (left: (typeof ROLES)[number], right: (typeof ROLES)[number]) => [bone(left), bone(right)].filter((one) => one !== null);
    const hands = both('leftHand', 'rightHand');
    const knuckles = both('leftMiddleProximal', 'rightMiddleProximal');
    this.palms = knuckles.length ? knuckles : hands;
    this.mixer = new AnimationMixer(figure);
    this.mixer.clipAction(clip).play();
    this.at(0);
  }

  /** Length of the motion, s. */
  get duration(): number {
    return this.clip.duration;
  }

  /** The figure of a .glb, with its own motion. */
  static async mannequin(glb: Uint8Array<ArrayBuffer>): Promise<Person> {
    const gltf = await readGltf(glb, (parser) => new VRMLoaderPlugin(parser)); // for the materials of VRM
    const clip = gltf.animations[0];
    if (!clip) throw new Error('the file holds no animation');
    const roles = rolesOf(gltf.parser.json);
    const bones = new Map<string, Object3D>();
    for (const role of ROLES) if (roles.has(role)) bones.set(role, (await gltf.parser.getDependency('node', roles.get(role)!)) as Object3D);
    const start = Math.min(...clip.tracks.map(({ times }) => times[0]!));
    if (start) for (const track of clip.tracks) track.shift(-start);
    const person = new Person(gltf.scene, clip.resetDuration(), (role) => bones.get(role) ?? null);
    person.comeToFront(bones);
    return person;
  }

  /** Turn a figure to the camera by quarters of a turn, and bring one that stands elsewhere to the middle. */
  private comeToFront(bones: ReadonlyMap<string, Object3D>): void {
    const [hips, left, right] = PLACE.map((role) => bones.get(role)?.getWorldPosition(new Vector3()));
    if (!hips || !left || !right) return;
    const quarters = Math.round(Math.atan2(left.z - right.z, left.x - right.x) / (Math.PI / 2));
    this.root.rotation.y = (quarters * Math.PI) / 2;
    const { x, z } = hips.applyQuaternion(this.root.quaternion);
    if (Math.hypot(x, z) > FAR) this.root.position.set(-x, 0, -z);
    this.at(0);
  }

  /** An avatar whose arms hang. */
  static async atRest(content: Uint8Array<ArrayBuffer>): Promise<Person> {
    const [, avatar] = await readAvatar(content);
    for (const side of ['left', 'right'] as const) {
      const [arm, elbow] = [`${side}UpperArm`, `${side}LowerArm`].map((name) => avatar.humanoid.getNormalizedBoneNode(name as VRMHumanBoneName)!);
      const along = elbow!.getWorldPosition(new Vector3()).sub(arm!.getWorldPosition(new Vector3()));
      arm!.rotation.z = -Math.sign(along.x) * (Math.atan2(Math.abs(along.x), -along.y) - HANGING);
    }
    VRMUtils.rotateVRM0(avatar);
    return new Person(avatar.scene, new AnimationClip('', 0, []), (role) => avatar.humanoid.getRawBoneNode(role), avatar);
  }

  /** An avatar (.vrm, or .glb) with a motion, fitted to its body where both have arms; ``known``: that body. */
  static async avatar(content: Uint8Array<ArrayBuffer>, take: Take, known: AvatarBody | null = null): Promise<Person> {
    const [file, avatar] = await readAvatar(content);
    const body = known ?? bodies.get(content) ?? bodyOf(file, avatar);
    bodies.set(content, body);
    const [clip, fitted] = await playable(avatar, body, take);
    VRMUtils.rotateVRM0(avatar);
    const person = new Person(avatar.scene, clip, (role) => avatar.humanoid.getRawBoneNode(role), avatar, fitted);
    person.body = body;
    return person;
  }

  /** Go on with a motion, of which the first ``overlap`` frames are there already and are blended. */
  async extend(take: Take, overlap: number): Promise<void> {
    const [clip] = await playable(this.vrm!, this.body!, take);
    this.mixer.stopAllAction();
    this.mixer.uncacheClip(this.clip);
    this.clip = joined(this.clip, clip, overlap);
    this.mixer.clipAction(this.clip).play();
    this.at(this.shown);
  }

  /** Show the pose at a time in seconds. */
  at(seconds: number): void {
    this.mixer.setTime(Math.max(0, Math.min(seconds, this.duration - END)));
    this.vrm?.update(Math.min(0.1, Math.abs(seconds - this.shown)));
    this.shown = seconds;
    this.root.updateMatrixWorld(true);
  }

  /** The box around the palms that are above a height in metres, or around both if none is; null if they are not known. */
  handsAt(height: number): Box3 | null {
    const positions = this.palms.map((palm) => palm.getWorldPosition(new Vector3()));
    const raised = positions.filter((position) => position.y > height);
    return positions.length ? new Box3().setFromPoints(raised.length ? raised : positions) : null;
  }

  dispose(): void {
    this.mixer.stopAllAction();
    VRMUtils.deepDispose(this.root);
  }
}

/** A motion as a clip that an avatar plays, with the rotations that are fitted to its body. */
async function playable(avatar: VRM, body: AvatarBody, { animation, motion }: Take): Promise<[AnimationClip, Fitted | null]> {
  const clip = createVRMAnimationClip(animation, avatar);
  if (!avatar.expressionManager) clip.tracks.push(...morphTracks(avatar.scene, animation));
  const hasArms = (bones: { name: string }[]) => ARMS.every((arm) => bones.some(({ name }) => name === arm));
  if (!hasArms(motion.body.bones) || !hasArms(body.bones)) return [clip, null];
  const fitted = await inSlices(fitMotion(motion, body));
  const tracks = tracksOf(avatar, body, fitted.rotations, motion.times);
  const names = new Set(tracks.map(({ name }) => name));
  clip.tracks = [...clip.tracks.filter(({ name }) => !names.has(name)), ...tracks];
  return [clip, fitted];
}

/** Tracks of morph targets that have the names of a face's coefficients, for a file without VRM's expressions. */
function morphTracks(figure: Object3D, { expressionTracks }: Take['animation']): NumberKeyframeTrack[] {
  const found: NumberKeyframeTrack[] = [];
  figure.traverse((node) => {
    const targets = (node instanceof Mesh && node.morphTargetDictionary) || {};
    for (const [name, { times, values }] of expressionTracks.custom) {
      if (name in targets) found.push(new NumberKeyframeTrack(`${node.uuid}.morphTargetInfluences[${targets[name]}]`, times, values));
    }
  });
  return found;
}

const slerpFlat = Quaternion.slerpFlat as unknown as (...all: [...Array<Float32Array | number>, number]) => void; // typed for number[]

/** A clip and one that goes on from it, blended over the frames that both have. */
function joined(before: AnimationClip, after: AnimationClip, overlap: number): AnimationClip {
  const tracks = after.tracks.map((track) => {
    const old = before.tracks.find(({ name }) => name === track.name);
    if (!old) return track;
    const size = track.getValueSize();
    const kept = old.times.length - overlap;
    const times = new Float32Array(kept + track.times.length);
    const values = new Float32Array(size * times.length);
    times.set(old.times.subarray(0, kept));
    times.set(track.times, kept);
    values.set(old.values.subarray(0, size * kept));
    values.set(track.values, size * kept);
    for (let k = 0; k < overlap; k++) {
      const at = size * (kept + k);
      const alpha = (k + 1) / (overlap + 1);
      if (size === 4) slerpFlat(values, at, old.values, at, track.values, size * k, alpha);
      else for (let n = 0; n < size; n++) values[at + n] = MathUtils.lerp(old.values[at + n]!, track.values[size * k + n]!, alpha);
    }
    const Track = size === 4 ? QuaternionKeyframeTrack : size === 1 ? NumberKeyframeTrack : VectorKeyframeTrack;
    return new Track(track.name, times, values);
  });
  return new AnimationClip(before.name, -1, tracks);
}
