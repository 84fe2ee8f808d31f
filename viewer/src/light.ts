/** A lighter figure, for machines that draw slowly: vertices near one another become one, most of all far from hands and face. */

import { type Bone, BufferAttribute, type BufferGeometry, type Object3D, type SkinnedMesh, Vector3 } from 'three';

/** Sides of the cells whose vertices become one, as fractions of stature. Fingers carry meaning, so theirs are small; a face's lids and lips are smaller. */
const CELLS = { hand: 0.003, head: 0.0015, rest: 0.015 };
const ACROSS = 16; // cells across a small mesh, such as the lips, whatever its part
const UV_CELLS = 24; // across a texture, since one triangle must not reach over its seams

/** What a bone carries; parts that none of the given nodes hold are the rest. */
export type Part = keyof typeof CELLS;

/** The part of each bone that these nodes hold. */
export function partsOf(hands: Object3D[], head: Object3D | null): Map<Object3D, Part> {
  const parts = new Map<Object3D, Part>();
  head?.traverse((node) => parts.set(node, 'head'));
  for (const hand of hands) hand.traverse((node) => parts.set(node, 'hand'));
  return parts;
}

/** The index of a lighter version of a skinned mesh, with the same vertices; null for a mesh without an index. */
export function lighter(mesh: SkinnedMesh, parts: Map<Object3D, Part>, stature: number): BufferAttribute | null {
  const { geometry } = mesh;
  if (!geometry.index) return null;
  const bones = carriers(geometry, mesh.skeleton.bones);
  const most = sizeOf(geometry) / ACROSS;
  const scale = stature / mesh.matrixWorld.getMaxScaleOnAxis();
  const sides = mesh.skeleton.bones.map((bone) => Math.min(most, CELLS[parts.get(bone) ?? 'rest'] * scale));
  const kept = oneInEachCell(geometry, bones.map((bone) => sides[bone]!), bones);
  const corners: number[] = [];
  for (let k = 0; k < geometry.index.count; k += 3) {
    const [a, b, c] = [0, 1, 2].map((n) => kept[geometry.index!.getX(k + n)]!) as [number, number, number];
    if (a !== b && b !== c && c !== a) corners.push(a, b, c);
  }
  return new BufferAttribute(new Uint32Array(corners), 1);
}

/** The second of the three sides of the box around a geometry. */
function sizeOf(geometry: BufferGeometry): number {
  geometry.computeBoundingBox();
  return geometry.boundingBox!.getSize(new Vector3()).toArray().sort((a, b) => a - b)[1]!;
}

/** The number of the bone that carries most of each vertex. */
function carriers(geometry: BufferGeometry, bones: Bone[]): number[] {
  const [joints, weights] = [geometry.attributes['skinIndex']!, geometry.attributes['skinWeight']!];
  return Array.from({ length: joints.count }, (_, k) => {
    const own = [0, 1, 2, 3].map((n) => weights.getComponent(k, n));
    return Math.min(joints.getComponent(k, own.indexOf(Math.max(...own))), bones.length - 1);
  });
}

/** For each vertex the one that stands for its cell: the nearest to the middle of the cell's vertices. */
function oneInEachCell(geometry: BufferGeometry, sides: number[], bones: number[]): number[] {
  const { position, uv } = geometry.attributes;
  const cells = new Map<string, number[]>();
  sides.forEach((side, k) => {
    const place = [position!.getX(k), position!.getY(k), position!.getZ(k)].map((x) => (side ? Math.floor(x / side) : k));
    const texture = uv ? [Math.floor(uv.getX(k) * UV_CELLS), Math.floor(uv.getY(k) * UV_CELLS)] : [];
    const key = [bones[k], ...place, ...texture].join();
    cells.get(key)?.push(k) ?? cells.set(key, [k]);
  });
  const kept = new Array<number>(sides.length);
  for (const cell of cells.values()) {
    const mean = [0, 1, 2].map((axis) => cell.reduce((sum, k) => sum + position!.getComponent(k, axis), 0) / cell.length);
    const away = cell.map((k) => mean.reduce((sum, x, axis) => sum + (position!.getComponent(k, axis) - x) ** 2, 0));
    const middle = cell[away.indexOf(Math.min(...away))]!;
    for (const k of cell) kept[k] = middle;
  }
  return kept;
}
