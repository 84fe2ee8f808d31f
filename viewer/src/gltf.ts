/** Reads binary glTF files: what is packed with meshopt too. */

import { type GLTF, GLTFLoader, type GLTFLoaderPlugin, type GLTFParser } from 'three/addons/loaders/GLTFLoader.js';

const DRACO = 'KHR_draco_mesh_compression'; // its decoder would make the page a quarter larger

interface Document {
  extras?: { signsplice_report?: string };
  animations?: { extras?: { fps?: number } }[];
  nodes?: { children?: number[] }[];
  extensions?: object;
  extensionsUsed?: string[];
  extensionsRequired?: string[];
}

export function isGltf(content: Uint8Array): boolean {
  return new TextDecoder().decode(content.subarray(0, 4)) === 'glTF';
}

/** The JSON part of a .glb. */
export function documentOf(content: Uint8Array): Document {
  if (!isGltf(content)) throw new Error('it is no binary glTF file');
  const size = new DataView(content.buffer, content.byteOffset).getUint32(12, true);
  return JSON.parse(new TextDecoder().decode(content.subarray(20, 20 + size))) as Document;
}

/** What a .glb holds. Throws one line for a file whose nodes are no trees, or that is packed with Draco. */
export async function readGltf(content: Uint8Array<ArrayBuffer>, plugin?: (parser: GLTFParser) => GLTFLoaderPlugin): Promise<GLTF> {
  const document = documentOf(content);
  checkTrees(document); // a loop of nodes never loads
  const { extensionsUsed = [], extensionsRequired = [] } = document;
  if (extensionsRequired.includes(DRACO)) throw new Error(`it is packed with Draco, which is not read; \`npx @gltf-transform/cli copy IN.glb OUT.glb\` unpacks it`);
  const loader = new GLTFLoader();
  // Loaded by need, since it runs WebAssembly, which some pages forbid.
  if (extensionsUsed.some((name) => name.endsWith('_meshopt_compression'))) loader.setMeshoptDecoder((await import('meshoptimizer/decoder')).MeshoptDecoder);
  if (plugin) loader.register(plugin);
  return loader.parseAsync(content.slice().buffer, '');
}

/** Throws where the nodes of a file are no trees: one is a child of two, or below itself. */
function checkTrees({ nodes = [] }: Document): void {
  const below = new Set<number>();
  nodes.forEach(({ children = [] }, node) =>
    children.forEach((child) => {
      if (!nodes[child] || below.has(child)) throw new Error(`node ${child} is a child of node ${node} and of another, or does not exist`);
      below.add(child);
    }),
  );
  const reached = new Set([...nodes.keys()].filter((node) => !below.has(node)));
  for (const node of reached) for (const child of nodes[node]!.children ?? []) reached.add(child);
  const lost = nodes.findIndex((_, node) => !reached.has(node));
  if (lost >= 0) throw new Error(`node ${lost} is its own ancestor, or below such a node`);
}
