/** The signer on the stage: the figure of a file with its own motion, or an avatar that plays a VRM animation. */

import { type VRM, type VRMHumanBoneName, VRMLoaderPlugin, VRMUtils } from '@pixiv/three-vrm';
import { createVRMAnimationClip, type VRMAnimation } from '@pixiv/three-vrm-animation';
import {
  AnimationClip,
  AnimationMixer,
  Box3,
  Group,
  type KeyframeTrack,
  Mesh,
  NumberKeyframeTrack,
  type Object3D,
  Vector3,
} from 'three';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import { readGltf } from './gltf.js';
import { readAvatar, rolesOf } from './humanoid.js';

const PLACE = ['hips', 'leftUpperArm', 'rightUpperArm'] as const;
const ROLES = [...PLACE, 'leftHand', 'rightHand', 'leftMiddleProximal', 'rightMiddleProximal'] as const;
const FAR = 0.5; // m from the middle, where a figure leaves the picture
const HANGING = 0.2; // of upper arms at rest, radians from straight down
const END = 1e-4; // seconds before a clip's end, since a looping action shows its first frame at the end

export class Person {
  readonly root = new Group();
  private readonly mixer: AnimationMixer;
  private shown = 0;
  private readonly palms: Object3D[];

  private constructor(
    readonly file: GLTF,
    private clip: AnimationClip,
    bone: (role: (typeof ROLES)[number]) => Object3D | null,
    /** Move what follows the bones: hair, clothes; seconds since the frame before. */
    private readonly follow: (seconds: number) => void = () => {},
    /** Whether rotations were made for another body, so that hands do not keep their contacts. */
    readonly isCopied = false,
  ) {
    const figure = file.scene;
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
    const vrm = gltf.userData['vrm'] as VRM | undefined; // of an avatar with motion for its bones and its face
    const roles = rolesOf(gltf.parser.json);
    const bones = new Map<string, Object3D>();
    for (const role of ROLES) {
      const bone = vrm?.humanoid.getRawBoneNode(role) ?? (roles.has(role) && ((await gltf.parser.getDependency('node', roles.get(role)!)) as Object3D));
      if (bone) bones.set(role, bone);
    }
    const start = Math.min(...clip.tracks.map(({ times }) => times[0]!));
    if (start) for (const track of clip.tracks) track.shift(-start);
    const person = new Person(gltf, clip.resetDuration(), (role) => bones.get(role) ?? null, (seconds) => {
      vrm?.nodeConstraintManager?.update();
      vrm?.springBoneManager?.update(seconds);
    });
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
    const [file, avatar] = await readAvatar(content);
    for (const side of ['left', 'right'] as const) {
      const [arm, elbow] = [`${side}UpperArm`, `${side}LowerArm`].map((name) => avatar.humanoid.getNormalizedBoneNode(name as VRMHumanBoneName)!);
      const along = elbow!.getWorldPosition(new Vector3()).sub(arm!.getWorldPosition(new Vector3()));
      arm!.rotation.z = -Math.sign(along.x) * (Math.atan2(Math.abs(along.x), -along.y) - HANGING);
    }
    VRMUtils.rotateVRM0(avatar);
    return new Person(file, new AnimationClip('', 0, []), (role) => avatar.humanoid.getRawBoneNode(role), (seconds) => avatar.update(seconds));
  }

  /** An avatar (.vrm, or .glb) that plays a motion by the rotations of its bones alone. */
  static async avatar(content: Uint8Array<ArrayBuffer>, motion: VRMAnimation): Promise<Person> {
    const [file, avatar] = await readAvatar(content);
    const clip = createVRMAnimationClip(motion, avatar);
    if (!avatar.expressionManager) clip.tracks.push(...morphTracks(avatar.scene, motion));
    VRMUtils.rotateVRM0(avatar);
    return new Person(file, clip, (role) => avatar.humanoid.getRawBoneNode(role), (seconds) => avatar.update(seconds), true);
  }

  /** Play tracks in place of the motion; with ``goesOn``, after its end. */
  play(tracks: KeyframeTrack[], goesOn: boolean): void {
    this.mixer.stopAllAction();
    this.mixer.uncacheClip(this.clip);
    this.clip = new AnimationClip(this.clip.name, -1, goesOn ? tracks.map((track) => appended(this.clip.tracks, track)) : tracks);
    this.mixer.clipAction(this.clip).play();
    this.at(this.shown);
  }

  /** Show the pose at a time in seconds. */
  at(seconds: number): void {
    this.mixer.setTime(Math.max(0, Math.min(seconds, this.duration - END)));
    this.follow(Math.min(0.1, Math.abs(seconds - this.shown)));
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

/** Tracks of morph targets that have the names of a face's coefficients, for a file without VRM's expressions. */
function morphTracks(figure: Object3D, { expressionTracks }: VRMAnimation): NumberKeyframeTrack[] {
  const found: NumberKeyframeTrack[] = [];
  figure.traverse((node) => {
    const targets = (node instanceof Mesh && node.morphTargetDictionary) || {};
    for (const [name, { times, values }] of expressionTracks.custom) {
      if (name in targets) found.push(new NumberKeyframeTrack(`${node.uuid}.morphTargetInfluences[${targets[name]}]`, times, values));
    }
  });
  return found;
}

/** A track after the one of its name, or after zeros in all keys that there are. */
function appended(before: KeyframeTrack[], track: KeyframeTrack): KeyframeTrack {
  const { times, values } = before.find(({ name }) => name === track.name) ?? { times: before[0]!.times, values: new Float32Array(before[0]!.times.length) };
  const joined = (one: Float32Array, other: Float32Array) => {
    const both = new Float32Array(one.length + other.length);
    both.set(one);
    both.set(other, one.length);
    return both;
  };
  const whole = track.clone();
  [whole.times, whole.values] = [joined(times, track.times), joined(values, track.values)];
  return whole;
}
