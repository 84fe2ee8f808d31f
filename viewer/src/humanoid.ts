/** Avatars: VRM files, and .glb files whose bones are known by name, which then act as VRM avatars do. */

import { VRM, VRMHumanoid, type VRMHumanBones, VRMLoaderPlugin, VRMUtils } from '@pixiv/three-vrm';
import { type Matrix4, type Object3D, Quaternion, SkinnedMesh, Vector3 } from 'three';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import { readGltf } from './gltf.js';

/** The words of rigs (Mixamo, Ready Player Me, VRM, Unity, Unreal, Rigify) for the bones of a limb. */
const LIMBS: [RegExp, string][] = [
  [/^(shoulder|clavicle|collar)$/, 'Shoulder'],
  [/^(upperarm|arm|uparm|upperarm01)$/, 'UpperArm'],
  [/^(lowerarm|forearm|forearm01)$/, 'LowerArm'],
  [/^(hand|wrist)$/, 'Hand'],
  [/^(upperleg|upleg|thigh|thigh01)$/, 'UpperLeg'],
  [/^(lowerleg|leg|shin|calf|shin01)$/, 'LowerLeg'],
  [/^(foot|ankle)$/, 'Foot'],
  [/^(toes?|toebase|ball)$/, 'Toes'],
];
const MIDDLE: [RegExp, string][] = [[/^(hips?|pelvis)$/, 'hips'], [/^neck0?1?$/, 'neck'], [/^head$/, 'head']];
const SPINE = ['spine', 'chest', 'upperChest'];
const FINGER = /^(?:hand|f)?(thumb|index|middle|ring|pinky|little)(?:finger)?(metacarpal|proximal|intermediate|distal|0?[1-3])$/;
const SEGMENTS = ['Proximal', 'Intermediate', 'Distal'];
const THUMB = ['Metacarpal', 'Proximal', 'Distal'];
const NEEDED = ['hips', ...['left', 'right'].flatMap((side) => ['UpperArm', 'LowerArm', 'Hand'].map((bone) => side + bone))];

interface Document {
  nodes?: { name?: string }[];
  skins?: { joints: number[] }[];
  extras?: { humanoid?: Record<string, string> };
}

/** The avatar in a .vrm or .glb file; a file without a VRM part gets one by the names of its bones. Throws for any other. */
export async function readAvatar(content: Uint8Array<ArrayBuffer>): Promise<[GLTF, VRM]> {
  const file = await readGltf(content, (parser) => new VRMLoaderPlugin(parser));
  return [file, (file.userData['vrm'] as VRM | undefined) ?? (await named(file))];
}

/** Throws if a file is not an avatar that can be shown. */
export async function checkAvatar(content: Uint8Array<ArrayBuffer>): Promise<void> {
  VRMUtils.deepDispose((await readAvatar(content))[1].scene);
}

async function named(file: GLTF): Promise<VRM> {
  const document = file.parser.json as Document;
  const bones: Record<string, { node: Object3D }> = {};
  for (const [role, node] of rolesOf(document)) bones[role] = { node: (await file.parser.getDependency('node', node)) as Object3D };
  // Nodes of a file that moves may be where they are in its first frame; where nothing moves them, they belong there.
  if (file.animations.length) {
    const places: [Object3D, Matrix4][] = [];
    file.scene.traverse((node) => places.push([node, node.matrix.compose(node.position, node.quaternion, node.scale).clone()]));
    file.scene.traverse((node) => node instanceof SkinnedMesh && node.skeleton.pose());
    const height = file.animations[0]!.tracks.find(({ name }) => name === `${bones['hips']?.node.name}.position`);
    if (height) bones['hips']!.node.position.fromArray(height.values); // a skin may be bound at any height
    file.userData['leaveRestPose'] = () => places.forEach(([node, matrix]) => matrix.decompose(node.position, node.quaternion, node.scale));
  }
  const missing = NEEDED.filter((role) => !bones[role]);
  if (missing.length) throw new Error(`it has no VRM part, and no bone known by name as ${missing.slice(0, 3).join(', ')}`);
  spreadArms(bones, file.scene);
  const humanoid = new VRMHumanoid(bones as unknown as VRMHumanBones);
  file.scene.add(humanoid.normalizedHumanBonesRoot);
  return new VRM({ scene: file.scene, humanoid, meta: { metaVersion: '1', name: '', authors: [], licenseUrl: '' } });
}

/** Hold arms straight to the sides, as VRM's rest pose does. */
function spreadArms(bones: Record<string, { node: Object3D }>, scene: Object3D): void {
  for (const side of ['left', 'right']) {
    for (const [from, to] of [['UpperArm', 'LowerArm'], ['LowerArm', 'Hand'], ['Hand', 'MiddleProximal']]) {
      const [bone, end] = [bones[side + from!]?.node, bones[side + to!]?.node];
      if (!bone?.parent || !end) continue;
      scene.updateMatrixWorld(true);
      const along = end.getWorldPosition(new Vector3()).sub(bone.getWorldPosition(new Vector3())).normalize();
      const above = bone.parent.getWorldQuaternion(new Quaternion());
      const turn = new Quaternion().setFromUnitVectors(along, new Vector3(Math.sign(along.x), 0, 0));
      bone.quaternion.premultiply(above.clone().invert().multiply(turn).multiply(above));
    }
  }
}

/** Role -> node: as a file of ours says, else by names. */
export function rolesOf({ nodes = [], skins = [], extras }: Document): Map<string, number> {
  const found = new Map<string, number>();
  const own = Object.entries(extras?.humanoid ?? {});
  for (const [role, name] of own) found.set(role, nodes.findIndex((node) => node.name === name));
  if (own.length) return found;
  const joints = new Set(skins.flatMap((skin) => skin.joints));
  const spine: number[] = [];
  nodes.forEach(({ name = '' }, node) => {
    if (!joints.has(node)) return;
    const role = roleOf(name);
    if (role === 'spine') spine.push(node);
    else if (role && !found.has(role)) found.set(role, node);
  });
  // A proximal joint of the thumb is its first where an intermediate one follows.
  for (const side of ['left', 'right']) {
    const [first, second] = ['Proximal', 'Intermediate'].map((segment) => found.get(`${side}Thumb${segment}`));
    if (first === undefined || second === undefined) continue;
    found.set(`${side}ThumbMetacarpal`, first).set(`${side}ThumbProximal`, second).delete(`${side}ThumbIntermediate`);
  }
  const chain = spine.sort((a, b) => order(nodes[a]!.name!) - order(nodes[b]!.name!));
  if (!found.has('hips') && chain.length > 6) {
    // Rigify's spine goes from the hips to the head.
    const [hips, head] = [chain.shift()!, chain[5]!];
    found.set('hips', hips).set('neck', chain[3]!).set('head', head);
    chain.length = 3;
  }
  const last = chain.length - 1;
  const used = last < 2 ? chain : [chain[0]!, chain[(last + 1) >> 1]!, chain[last]!];
  used.forEach((node, k) => found.set(SPINE[k]!, node));
  return found;
}

/** Where a joint stands in the spine, by its name. */
function order(name: string): number {
  const word = name.toLowerCase();
  return word.includes('upperchest') ? 9 : /chest|ribs/.test(word) ? 8 : Number(/\d+$/.exec(word)?.[0] ?? 0);
}

function roleOf(name: string): string | null {
  const bare = name.replace(/^.*[:|]/, '').replace(/^(mixamorig\d*|J_Bip_C|J_Bip|Bip0*\d*|DEF|ORG|Character\d+)[_\W]*/, '');
  const [, before, middle, after, half = ''] = /^([Ll]eft|[Rr]ight|[lLrR](?=[_\W]|[A-Z]))?(.*?)(?:[_\W]([Ll]eft|[Rr]ight|[lLrR])((?<=\.[LR])\.\d+)?)?$/.exec(bare)!;
  const side = (before ?? after ?? '').toLowerCase();
  const word = (middle! + half).toLowerCase().replace(/[\W_]/g, '');
  if (!side) return /^(spine\d*|chest\d*|ribs|upperchest)$/.test(word) ? 'spine' : (MIDDLE.find(([words]) => words.test(word))?.[1] ?? null);
  const prefix = side.startsWith('l') ? 'left' : 'right';
  const limb = LIMBS.find(([words]) => words.test(word))?.[1];
  if (limb) return prefix + limb;
  const [, finger, segment] = FINGER.exec(word) ?? [];
  if (!finger || !segment) return null;
  const digit = finger === 'pinky' ? 'Little' : finger[0]!.toUpperCase() + finger.slice(1);
  const names = digit === 'Thumb' ? THUMB : SEGMENTS;
  if (digit !== 'Thumb' && segment === 'metacarpal') return null; // within the palm
  const number = Number(segment);
  return prefix + digit + (Number.isNaN(number) ? segment[0]!.toUpperCase() + segment.slice(1) : names[number - 1]);
}
