/** Requests to the service. */

import type { Failure, MethodInfo, SentenceRequest, Spliced, SpliceRequest, WordList } from './wire.js';
import { translate } from './languages.js';

/** A request that failed, at the service or before it reached it. */
export class ServiceError extends Error {
  constructor(readonly failure: Failure) {
    super(failure.error);
  }
}

/** The service at an address. */
export class Service {
  private readonly base: string;

  constructor(address: string) {
    this.base = address.replace(/\/?$/, '/');
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
