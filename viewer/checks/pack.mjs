// Packs the mesh of a .glb as exporters do: with meshopt, or, in name only, with Draco.

import { MeshoptEncoder } from 'meshoptimizer/encoder';

const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT4: 16 };
const BYTES = { 5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4 };
const MESHOPT = 'EXT_meshopt_compression';

const padded = (bytes, fill) => Buffer.concat([bytes, Buffer.alloc(-bytes.length & 3, fill)]);
const chunk = (name, bytes) => Buffer.concat([Buffer.from(Uint32Array.of(bytes.length).buffer), Buffer.from(name), bytes]);

function unpacked(glb) {
  const size = glb.readUInt32LE(12);
  return [JSON.parse(glb.subarray(20, 20 + size)), glb.subarray(28 + size)];
}

function whole(json, blob) {
  const chunks = Buffer.concat([chunk('JSON', padded(Buffer.from(JSON.stringify(json)), ' ')), chunk('BIN\0', padded(blob, 0))]);
  return Buffer.concat([Buffer.from('glTF'), Buffer.from(Uint32Array.of(2, 12 + chunks.length).buffer), chunks]);
}

export async function packedWithMeshopt(glb) {
  await MeshoptEncoder.ready;
  const [json, blob] = unpacked(glb);
  const indices = new Set(json.meshes.flatMap(({ primitives }) => primitives.map(({ indices }) => indices)));
  const parts = [];
  let end = 0;
  json.bufferViews.forEach((view, k) => {
    const number = json.accessors.findIndex(({ bufferView }) => bufferView === k);
    const { byteOffset: start = 0, byteLength: size } = view;
    let bytes = blob.subarray(start, start + size);
    const { type, componentType } = json.accessors[number] ?? {};
    const stride = view.byteStride ?? WIDTHS[type] * BYTES[componentType];
    const mode = indices.has(number) ? 'INDICES' : 'ATTRIBUTES';
    const meshopt = { buffer: 0, byteOffset: end, byteStride: stride, count: size / stride, mode };
    if (number >= 0 && (mode === 'INDICES' || stride % 4 === 0)) {
      bytes = Buffer.from(MeshoptEncoder.encodeGltfBuffer(new Uint8Array(bytes), size / stride, stride, mode));
      Object.assign(view, { buffer: 1, byteOffset: 0, extensions: { [MESHOPT]: { ...meshopt, byteLength: bytes.length } } });
    } else view.byteOffset = end;
    parts.push(padded(bytes, 0));
    end += parts.at(-1).length;
  });
  const fallback = { byteLength: json.buffers[0].byteLength, extensions: { [MESHOPT]: { fallback: true } } };
  json.buffers = [{ byteLength: end }, fallback];
  for (const list of ['extensionsUsed', 'extensionsRequired']) json[list] = [...(json[list] ?? []), MESHOPT];
  return whole(json, Buffer.concat(parts));
}

export function saidToBeDraco(glb) {
  const [json, blob] = unpacked(glb);
  return whole({ ...json, extensionsRequired: ['KHR_draco_mesh_compression'] }, blob);
}
