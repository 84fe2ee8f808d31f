/** Requests to the service. */

import type { Failure, MethodInfo, SentenceRequest, Spliced, SpliceRequest, UploadedAvatar, WordList } from './wire.js';
import { translate } from './languages.js';

/** A request that failed, at the service or before it reached it. */
export class ServiceError extends Error {
  constructor(readonly failure: Failure) {
    super(failure.error);
  }
}

/** An avatar that signs: the name of a service's, or a file. */
export type Avatar = string | { name: string; bytes: Uint8Array<ArrayBuffer> };

/** The ids of files that were uploaded as avatars, and where. */
const uploads = new WeakMap<Uint8Array, { base: string; id: string }>();

/** The service at an address. */
export class Service {
  private readonly base: string;

  constructor(address: string) {
    this.base = address.replace(/\/?$/, '/');
  }

  /** Address of its streams. */
  get streams(): string {
    return new URL(`${this.base}v1/stream`, location.href).href.replace(/^http/, 'ws');
  }

  sentence(body: SentenceRequest, signal: AbortSignal): Promise<Spliced> {
    return this.request('v1/sentence', this.json(body, signal));
  }

  /** A contact sheet of a sentence, or a film. */
  async picture(glosses: string[], form: 'png' | 'gif', signal: AbortSignal): Promise<Blob> {
    return (await this.answer(`v1/sentence?file=${form}`, this.json({ glosses, face_rules: true }, signal))).blob();
  }

  splice(files: File[], options: SpliceRequest, signal: AbortSignal): Promise<Spliced> {
    const form = new FormData();
    for (const file of files) form.append('files', file, file.name);
    form.append('options', JSON.stringify(options));
    return this.request('v1/splice', { method: 'POST', body: form, signal });
  }

  /** Ask for something on an avatar by its id; a file is uploaded if the service does not keep it. */
  async withAvatar<Answer>(avatar: Avatar | null, signal: AbortSignal, ask: (id: string | null) => Promise<Answer>): Promise<Answer> {
    if (avatar === null || typeof avatar === 'string') return ask(avatar);
    const { name, bytes } = avatar;
    const upload = uploads.get(bytes);
    try {
      if (upload?.base === this.base) return await ask(upload.id);
    } catch (error) {
      if (!(error instanceof ServiceError && error.message.startsWith('avatar '))) throw error;
    }
    const body = new FormData();
    body.append('avatar', new File([bytes], /\.(vrm|glb)$/i.test(name) ? name : `${name}.glb`));
    const { avatar: id } = await this.request<UploadedAvatar>('v1/avatar', { method: 'POST', body, signal });
    uploads.set(bytes, { base: this.base, id });
    return ask(id);
  }

  words(search: string, limit: number, signal?: AbortSignal): Promise<WordList> {
    return this.request(`v1/lexicon?limit=${limit}&search=${encodeURIComponent(search)}`, signal ? { signal } : undefined);
  }

  methods(): Promise<MethodInfo[]> {
    return this.request('v1/methods');
  }

  private json(body: SentenceRequest, signal: AbortSignal): RequestInit {
    return { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body), signal };
  }

  private async request<Answer>(path: string, init?: RequestInit): Promise<Answer> {
    return (await (await this.answer(path, init)).json()) as Answer;
  }

  private async answer(path: string, init?: RequestInit): Promise<Response> {
    const answer = await fetch(this.base + path, init).catch((error: unknown) => {
      if (error instanceof DOMException && error.name === 'AbortError') throw error;
      const { origin } = new URL(this.base, location.href);
      const message = origin === location.origin ? translate('lost') : translate('refused', { address: origin, page: location.origin });
      throw new ServiceError({ error: message, unknown: {} });
    });
    if (answer.ok) return answer;
    const failure = (await answer.json().catch(() => null)) as Failure | null;
    throw new ServiceError(failure ?? { error: `${answer.status} ${answer.statusText}`, unknown: {} });
  }
}

/** The service that the page came from. */
export const own = new Service('.');
