/** The signer on the stage: the clip's mannequin, or an avatar that plays its VRM animation, fitted to its body. */

import { VRMLoaderPlugin, VRMUtils, type VRM } from '@pixiv/three-vrm';
import { VRMAnimationLoaderPlugin, createVRMAnimationClip, type VRMAnimation } from '@pixiv/three-vrm-animation';
import { type AnimationClip, AnimationMixer, Box3, type BufferAttribute, Group, type Object3D, SkinnedMesh, Vector3 } from 'three';
import { type GLTF, GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { type AvatarBody, bodyOf, motionOf, tracksOf } from './fit/avatar.js';
import { type Fitted, fitMotion, inSlices, type Motion } from './fit/fit.js';
import { checkTrees } from './fit/mesh.js';
import { lighter, type Part, partsOf } from './light.js';
import type { FitSource } from './wire.js';

const ROLES = ['leftHand', 'rightHand', 'leftMiddleProximal', 'rightMiddleProximal', 'head'] as const;
const END = 1e-4; // seconds before a clip's end, since a looping action shows its first frame at the end
/** The bodies of avatars by their files: measuring a mesh takes longer than fitting a sentence. */
const bodies = new WeakMap<Uint8Array, AvatarBody>();

export class Person {
  readonly root = new Group();
  private readonly mixer: AnimationMixer;
  private readonly duration: number;
  private shown = 0;
  private readonly indices = new Map<SkinnedMesh, [BufferAttribute | null, BufferAttribute | null]>();
  private readonly parts: Map<Object3D, Part>;
  private readonly palms: Object3D[];

  private constructor(
    body: Object3D,
    clip: AnimationClip,
    bone: (role: (typeof ROLES)[number]) => Object3D | null,
    private readonly vrm?: VRM,
    /** How the motion was fitted to an avatar; null where it plays as it is. */
    readonly fitted: Fitted | null = null,
  ) {
    this.root.add(body);
    body.traverse((node) => {
      node.frustumCulled = false; // the bounds of a skinned mesh do not follow its bones
      node.castShadow = node.receiveShadow = true;
    });
    const both = (left: (typeof ROLES)[number], right: (typeof ROLES)[number]) => [bone(left), bone(right)].filter((one) => one !== null);
    const hands = both('leftHand', 'rightHand');
    const knuckles = both('leftMiddleProximal', 'rightMiddleProximal');
    this.palms = knuckles.length ? knuckles : hands;
    this.parts = partsOf(hands, bone('head'));
    this.mixer = new AnimationMixer(body);
    this.mixer.clipAction(clip).play();
    this.duration = clip.duration;
    this.at(0);
  }

  /** The mannequin of a .glb. */
  static async mannequin(glb: Uint8Array<ArrayBuffer>): Promise<Person> {
    const gltf = await new GLTFLoader().parseAsync(glb.buffer, '');
    const clip = gltf.animations[0];
    if (!clip) throw new Error('the file holds no animation');
    const roles = (gltf.parser.json as { extras?: { humanoid?: Record<string, string> } }).extras?.humanoid ?? {};
    const nodes = gltf.parser.json.nodes as { name: string }[];
    const bones = new Map<string, Object3D>();
    for (const role of ROLES) {
      // three.js renames nodes but keeps their numbers.
      const number = nodes.findIndex((node) => node.name === roles[role]);
      if (number >= 0) bones.set(role, (await gltf.parser.getDependency('node', number)) as Object3D);
    }
    return new Person(gltf.scene, clip, (role) => bones.get(role) ?? null);
  }

  /** Throws if a file is not an avatar that can be shown. */
  static async checkAvatar(vrm: Uint8Array<ArrayBuffer>): Promise<void> {
    VRMUtils.deepDispose((await readAvatar(vrm))[1].scene);
  }

  /** An avatar (.vrm) with the motion of a .vrma, fitted to its body where that of the signer is known. */
  static async avatar(vrm: Uint8Array<ArrayBuffer>, vrma: Uint8Array<ArrayBuffer>, source: FitSource | null): Promise<Person> {
    const [file, avatar] = await readAvatar(vrm);
    const motion = await new GLTFLoader()
      .register((parser) => new VRMAnimationLoaderPlugin(parser))
      .parseAsync(vrma.slice().buffer, '');
    const animation = (motion.userData['vrmAnimations'] as VRMAnimation[] | undefined)?.[0];
    if (!animation) throw new Error('the clip has no VRM animation');
    const clip = createVRMAnimationClip(animation, avatar);
    let fitted: Fitted | null = null;
    if (source) {
      const body = bodies.get(vrm) ?? bodyOf(file, avatar);
      bodies.set(vrm, body);
      fitted = await fitClip(clip, avatar, body, await motionOf(motion, animation, source));
    }
    VRMUtils.rotateVRM0(avatar);
    return new Person(avatar.scene, clip, (role) => avatar.humanoid.getRawBoneNode(role), avatar, fitted);
  }

  /** Draw fewer triangles and no shadows on the body, or all again; ``stature`` in metres. */
  lighten(on: boolean, stature: number): void {
    this.root.traverse((node) => {
      if (!(node instanceof SkinnedMesh)) return;
      const { geometry } = node;
      if (!this.indices.has(node)) this.indices.set(node, [geometry.index, lighter(node, this.parts, stature) ?? geometry.index]);
      geometry.setIndex(this.indices.get(node)![on ? 1 : 0]);
      node.receiveShadow = !on;
    });
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
    for (const [{ geometry }, indices] of this.indices) {
      const other = indices.find((index) => index !== geometry.index);
      if (other) geometry.setAttribute('otherIndex', other); // three.js frees the buffers of what a geometry holds
    }
    VRMUtils.deepDispose(this.root);
  }
}

/** Give a clip that an avatar plays the rotations that are fitted to the avatar's body. */
async function fitClip(clip: AnimationClip, avatar: VRM, body: AvatarBody, motion: Motion): Promise<Fitted> {
  const fitted = await inSlices(fitMotion(motion, body));
  const tracks = tracksOf(avatar, body, fitted.rotations, motion.times);
  const names = new Set(tracks.map(({ name }) => name));
  clip.tracks = [...clip.tracks.filter(({ name }) => !names.has(name)), ...tracks];
  return fitted;
}

async function readAvatar(vrm: Uint8Array<ArrayBuffer>): Promise<[GLTF, VRM]> {
  const file = await new GLTFLoader()
    .register(({ json }) => ({ name: 'SIGNSPLICE_trees', beforeRoot: async () => checkTrees(json) })) // a loop of nodes never loads
    .register((parser) => new VRMLoaderPlugin(parser))
    .parseAsync(vrm.slice().buffer, '');
  const avatar = file.userData['vrm'] as VRM | undefined;
  if (!avatar) throw new Error('it has no VRM part');
  return [file, avatar];
}
