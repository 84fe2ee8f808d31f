/** What a player is told to show: files on a server, or a sentence of the service. */

import { decode } from './bytes.js';
import { documentOf, isGltf } from './gltf.js';
import { Person } from './person.js';
import { glbTake, vrmaTake } from './take.js';
import type { Report, Spliced } from './wire.js';

type Content = Uint8Array<ArrayBuffer>;

/** Motion, and what is known about it. */
export interface Source {
  name: string;
  /** Null: a file alone, of which no words are known. */
  scene: Spliced | null;
  glb: Content | null;
  vrma: Content | null;
}

/** The source that a spliced sentence is. */
export function sourceOf(scene: Spliced): Source {
  const [glb, vrma] = [scene.files.glb, scene.files.vrma].map((file) => (file ? decode(file) : null)) as [Content | null, Content | null];
  return { name: scene.name, scene, glb, vrma };
}

/** The source at an address: a .glb, a .vrma, or an answer of /v1/sentence. */
export async function readSource(address: string, signal: AbortSignal): Promise<Source> {
  const content = await bytesAt(address, signal);
  const name = decodeURIComponent(new URL(address).pathname.split('/').at(-1)!.replace(/\.\w+$/, ''));
  if (isGltf(content)) return fileSource(name, content);
  let json: Partial<Spliced>;
  try {
    json = JSON.parse(new TextDecoder().decode(content)) as Partial<Spliced>;
  } catch {
    throw new Error(`${name} is neither a .glb, a .vrma nor JSON`);
  }
  if (json.files && json.report) return sourceOf({ name, units: [], fit: null, ...json } as Spliced);
  throw new Error(`${name} is JSON, but no answer of /v1/sentence`);
}

/** The person who signs a source: its own figure, or an avatar. */
export async function personOf({ scene, glb, vrma, name }: Source, avatar: Content | null): Promise<Person> {
  if (avatar && vrma) return Person.avatar(avatar, await vrmaTake(vrma, scene?.fit ?? null));
  if (avatar && glb) return Person.avatar(avatar, await glbTake(glb));
  if (!glb) throw new Error(`${name} has no body of its own to show; set the attribute avatar`);
  return Person.mannequin(glb);
}

/** The scene of a source; one without words where a file comes alone. */
export function sceneOf({ scene, name, glb, vrma }: Source, seconds: number): Spliced {
  if (scene) return scene;
  const fps = documentOf((glb ?? vrma)!).animations?.[0]?.extras?.fps ?? 30;
  return bareScene(name, fps, Math.round(seconds * fps) + 1);
}

/** A scene of which no words are known. */
export function bareScene(name: string, fps: number, frames: number): Spliced {
  const tempo = { mode: 'citation', asked_seconds: null, seconds: null } as const;
  const report = { version: 1, fps, frames, cutter: '', transition: '', bundle: null, spans: [], seams: [], warnings: [], tempo, timing_ms: {} };
  const scene: Omit<Spliced, 'spelled'> = { name, report, files: { bvh: null, glb: null, vrma: null }, units: [], fit: null };
  return scene as Spliced;
}

/** The content of a file. Throws one line where it does not come. */
export async function bytesAt(address: string, signal: AbortSignal): Promise<Content> {
  const answer = await fetch(address, { signal }).catch((error: unknown) => {
    signal.throwIfAborted();
    throw new Error(`${address} does not answer: ${error instanceof Error ? error.message : String(error)}`);
  });
  if (!answer.ok) throw new Error(`${address}: ${answer.status} ${answer.statusText}`);
  return new Uint8Array(await answer.arrayBuffer());
}

/** Whether a .glb is an avatar rather than motion: it moves nothing. */
export function isStill(content: Content): boolean {
  return isGltf(content) && !documentOf(content).animations?.length;
}

function fileSource(name: string, content: Content): Source {
  const { extensions, extras } = documentOf(content);
  const isVrma = 'VRMC_vrm_animation' in (extensions ?? {});
  return { name, scene: sceneIn(name, extras?.signsplice_report), glb: isVrma ? null : content, vrma: isVrma ? content : null };
}

/** The scene that a file's own report tells of, as JSON text; null where it has none. */
function sceneIn(name: string, text: unknown): Spliced | null {
  if (typeof text !== 'string') return null;
  const { units = [], ...report } = JSON.parse(text) as Report & Partial<Pick<Spliced, 'units'>>;
  return report.spans && report.seams ? { ...bareScene(name, 30, 1), report, units } : null;
}
