/** The vertices of an avatar's meshes that are skin, as the Python module formats/gltf_mesh finds them. */

import type { VRM } from '@pixiv/three-vrm';
import { type Matrix4, Mesh, type Object3D, SkinnedMesh, Vector3 } from 'three';
import type { GLTF } from 'three/addons/loaders/GLTFLoader.js';
import { gltf_mesh as WORDS } from './constants.js';
import { type Kind, SkinPoints } from './points.js';

const LOOSE: ReadonlySet<string> = new Set(WORDS.LOOSE);
const CLOTH: ReadonlySet<string> = new Set(WORDS.CLOTH);
const SKIN_JOINTS: ReadonlySet<string> = new Set(WORDS.SKIN_JOINTS);

interface Node {
  name?: string;
  mesh?: number;
  children?: number[];
}

/** The parts of a file's JSON that are read here. */
interface Document {
  nodes: Node[];
  meshes: { primitives: { material?: number }[] }[];
  materials?: { name?: string }[];
  extensions?: {
    VRMC_springBone?: { springs?: { joints?: { node: number }[] }[] };
    VRM?: { secondaryAnimation?: { boneGroups?: { bones?: number[] }[] } };
  };
}

/** Throws where the nodes of a file are no trees: one is a child of two, or below itself. */
export function checkTrees({ nodes = [] }: { nodes?: readonly Node[] }): void {
  const below = new Set<number>();
  nodes.forEach(({ children = [] }, node) =>
    children.forEach((child) => {
      if (!nodes[child] || below.has(child)) throw new Error(`node ${child} is a child of node ${node} and of another, or does not exist`);
      below.add(child);
    }),
  );
  const reached = [...nodes.keys()].filter((node) => !below.has(node));
  for (const node of reached) reached.push(...(nodes[node]!.children ?? []));
  if (reached.length === nodes.length) return;
  const found = new Set(reached);
  throw new Error(`node ${nodes.findIndex((_, node) => !found.has(node))} is its own ancestor, or below such a node`);
}

/** The vertices of skin, or of what may be skin, of an avatar that stands as it was loaded, carried by bones of these names; ``place`` moves them. */
export function skinOf(file: GLTF, avatar: VRM, names: readonly string[], place: (point: Vector3) => Vector3): SkinPoints {
  const carriers = new Carriers(file, avatar, names);
  const points = new SkinPoints();
  const json = file.parser.json as Document;
  avatar.scene.updateMatrixWorld(true);
  avatar.scene.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    const { meshes, primitives = 0 } = (file.parser.associations.get(object) ?? {}) as { meshes?: number; primitives?: number };
    const mesh = meshes === undefined ? undefined : json.meshes[meshes];
    const index = object.geometry.getIndex();
    if (!mesh || !index) return;
    const material = mesh.primitives[primitives]?.material;
    const name = (material === undefined ? undefined : json.materials?.[material]?.name) ?? '';
    const kind = { isCloth: [...words(name)].some((word) => CLOTH.has(word)) && !words(name).has('skin'), isDoubtful: isLoose(name) };
    const numbers = addVertices(object, new Set(index.array), carriers, points, place, kind);
    for (let k = 0; k + 2 < index.count; k += 3) {
      const [a, b, c] = [0, 1, 2].map((corner) => numbers.get(index.getX(k + corner)));
      if (a !== undefined && b !== undefined && c !== undefined) points.addTriangle(a, b, c);
    }
  });
  return points;
}

/** Add the vertices of a mesh that are skin; their numbers in the mesh -> in ``points``. */
function addVertices(
  mesh: Mesh, used: Set<number>, carriers: Carriers, points: SkinPoints, place: (point: Vector3) => Vector3, kind: Kind,
): Map<number, number> {
  const numbers = new Map<number, number>();
  const { position, skinIndex, skinWeight } = mesh.geometry.attributes;
  const skinned = mesh instanceof SkinnedMesh && skinIndex && skinWeight ? mesh : null;
  const bones = skinned ? skinned.skeleton.bones : [mesh];
  const matrices = bones.map((bone, k) => (skinned ? bone.matrixWorld.clone().multiply(skinned.skeleton.boneInverses[k]!) : bone.matrixWorld));
  const carried = bones.map((bone) => carriers.of(bone));
  if (!skinned && carried[0]!.row === null) return numbers;
  const [at, sum, part] = [new Vector3(), new Vector3(), new Vector3()];
  for (const vertex of [...used].sort((a, b) => a - b)) {
    at.fromBufferAttribute(position!, vertex);
    sum.set(0, 0, 0);
    const rows: number[] = [];
    const weights: number[] = [];
    const all = skinned ? [0, 1, 2, 3].map((k) => skinWeight!.getComponent(vertex, k)) : [1];
    const total = all.reduce((a, b) => a + b, 0);
    let loose = 0;
    all.forEach((value, k) => {
      const bone = skinned ? skinIndex!.getComponent(vertex, k) : 0;
      const weight = total > 0 ? value / total : k ? 0 : 1;
      if (!weight) return;
      sum.addScaledVector(part.copy(at).applyMatrix4(matrices[bone] as Matrix4), weight);
      if (!carried[bone]!.isSkin) loose += weight;
      rows.push(carried[bone]!.row ?? 0);
      weights.push(weight);
    });
    if (loose < 0.5) numbers.set(vertex, points.add(place(sum.clone()), rows, weights, kind));
  }
  return numbers;
}

/** Which bone carries what hangs on a node, and whether that is skin. */
class Carriers {
  private readonly json: Document;
  private readonly parents = new Map<number, number>();
  /** Node -> number of its bone. */
  private readonly rows = new Map<number, number>();
  private readonly springs: Set<number>;
  /** Words in the names of bones: of their rig. */
  private readonly common: ReadonlySet<string>;

  constructor(private readonly file: GLTF, avatar: VRM, names: readonly string[]) {
    this.json = file.parser.json as Document;
    this.json.nodes.forEach(({ children }, node) => children?.forEach((child) => this.parents.set(child, node)));
    names.forEach((name, row) => {
      const bone = avatar.humanoid.getRawBoneNode(name as 'hips');
      const node = bone && this.numberOf(bone);
      if (typeof node === 'number') this.rows.set(node, row);
    });
    this.common = new Set([...this.rows.keys()].flatMap((node) => [...words(this.json.nodes[node]!.name ?? '')]));
    const { VRMC_springBone, VRM } = this.json.extensions ?? {};
    this.springs = new Set([
      ...(VRMC_springBone?.springs ?? []).flatMap(({ joints }) => (joints ?? []).map(({ node }) => node)),
      ...(VRM?.secondaryAnimation?.boneGroups ?? []).flatMap(({ bones }) => bones ?? []),
    ]);
  }

  /** Number of the bone at or above a node, as ``SkinPoints.add`` has it; null where there is none. */
  of(object: Object3D): { row: number | null; isSkin: boolean } {
    let isSkin = true;
    for (let node = this.numberOf(object); node !== undefined; node = this.parents.get(node)) {
      const row = this.rows.get(node);
      if (row !== undefined) return { row, isSkin };
      const { mesh, name = '' } = this.json.nodes[node]!;
      const isNamed = [...words(name)].some((word) => SKIN_JOINTS.has(word)) || WORDS.SKIN_JOINTS_JAPANESE.some((word) => name.includes(word));
      isSkin &&= isNamed || !((mesh === undefined && isLoose(name, this.common)) || this.springs.has(node));
    }
    return { row: null, isSkin: false };
  }

  /** The number of the node in the file at or above an object of the scene. */
  private numberOf(object: Object3D): number | undefined {
    for (let each: Object3D | null = object; each; each = each.parent) {
      const { nodes } = (this.file.parser.associations.get(each) ?? {}) as { nodes?: number };
      if (nodes !== undefined) return nodes;
    }
    return undefined;
  }
}

/** The words of a name in lower case: "J_Sec_HairBack1" has j, sec, hair and back. */
function words(name: string): Set<string> {
  return new Set((name.match(/[A-Z]?[a-z]+|[A-Z]+/g) ?? []).map((word) => word.toLowerCase()));
}

/** Whether a name, without ``ignored`` words, is that of hair, clothing that hangs, or an accessory. */
function isLoose(name: string, ignored: ReadonlySet<string> = new Set()): boolean {
  return [...words(name)].some((word) => LOOSE.has(word) && !ignored.has(word)) || WORDS.LOOSE_JAPANESE.some((word) => name.includes(word));
}
