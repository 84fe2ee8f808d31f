/** What a player is told to show: files on a server, or a sentence of the service. */

import { decode } from './bytes.js';
import { documentOf, isGltf } from './gltf.js';
import { Person } from './person.js';
import { glbTake, vrmaTake } from './take.js';
import type { Avatar, Service } from './service.js';
import type { Format, Report, Spliced } from './wire.js';

type Content = Uint8Array<ArrayBuffer>;

/** Motion, and what is known about it. */
export interface Source {
  name: string;
  /** Null: a file alone, of which no words are known. */
  scene: Spliced | null;
  glb: Content | null;
  vrma: Content | null;
}

/** A report of motion that is fitted to an avatar. */
export type OnAvatar = Report & { avatar?: { name: string } };

/** The source that a spliced sentence is. */
export function sourceOf(scene: Spliced): Source {
  const [glb, vrma] = [scene.files.glb, scene.files.vrma].map((file) => (file ? decode(file) : null)) as [Content | null, Content | null];
  return { name: scene.name, scene, glb, vrma };
}

/** The source at an address: a .glb, a .vrma, or an answer of /v1/sentence. */
export async function readSource(address: string, signal: AbortSignal): Promise<Source> {
  const content = await bytesAt(address, signal);
  const name = nameAt(address).replace(/\.\w+$/, '');
  if (isGltf(content)) return fileSource(name, content);
  let json: Partial<Spliced>;
  try {
    json = JSON.parse(new TextDecoder().decode(content)) as Partial<Spliced>;
  } catch {
    throw new Error(`${name} is neither a .glb, a .vrma nor JSON`);
  }
  if (json.files && json.report) return sourceOf({ name, units: [], ...json } as Spliced);
  throw new Error(`${name} is JSON, but no answer of /v1/sentence`);
}

/** A source on an avatar, as a service fits it to its body. */
export async function onAvatar(source: Source, avatar: Avatar, service: Service, signal: AbortSignal): Promise<Source> {
  const { glb, vrma, name, scene } = source;
  const clip = new File([(glb ?? vrma)!], `${name}.${glb ? 'glb' : 'vrma'}`);
  const held = Object.entries(scene?.files ?? {}).filter(([, content]) => content);
  const formats = [...new Set(['glb', ...held.map(([format]) => format)])] as Format[];
  const options = { formats, fps: scene?.report.fps ?? null };
  const { files, report } = await service.withAvatar(avatar, signal, (id) => service.splice([clip], { ...options, avatar: id }, signal));
  if (!scene) return { ...source, glb: decode(files.glb!), vrma: null };
  const warnings = [...scene.report.warnings, ...report.warnings];
  return sourceOf({ ...scene, files, report: { ...scene.report, warnings, avatar: (report as OnAvatar).avatar } as OnAvatar });
}

/** The person who signs a source: its own figure, or an avatar, to whose body nothing is fitted. */
export async function personOf({ glb, vrma, name }: Source, avatar: Content | null): Promise<Person> {
  if (avatar && vrma) return Person.avatar(avatar, await vrmaTake(vrma));
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
  const scene: Omit<Spliced, 'spelled'> = { name, report, files: { bvh: null, glb: null, vrma: null, pose: null }, units: [] };
  return scene as Spliced;
}

/** The name of the file at an address. */
export function nameAt(address: string): string {
  return decodeURIComponent(new URL(address).pathname.split('/').at(-1)!);
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
