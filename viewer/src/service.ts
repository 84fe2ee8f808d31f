/** The service, as the page asks it. */

import type { Failure, Part, SentenceRequest, Spliced, SpliceRequest, WordList } from './wire.js';
import { say } from './languages.js';

/** What the service, or the way to it, said in place of an answer. */
export class Refused extends Error {
  constructor(readonly failure: Failure) {
    super(failure.error);
  }
}

async function ask<Answer>(path: string, init?: RequestInit): Promise<Answer> {
  const answer = await fetch(path, init).catch((error: unknown) => {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    throw new Refused({ error: say('lost'), unknown: {} });
  });
  if (answer.ok) return (await answer.json()) as Answer;
  const failure = (await answer.json().catch(() => null)) as Failure | null;
  throw new Refused(failure ?? { error: `${answer.status} ${answer.statusText}`, unknown: {} });
}

export function sentence(request: SentenceRequest, signal: AbortSignal): Promise<Spliced> {
  return ask('v1/sentence', {
    method: 'POST',
    headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify(request),
    signal,
  });
}

export function splice(files: File[], request: SpliceRequest, signal: AbortSignal): Promise<Spliced> {
  const form = new FormData();
  for (const file of files) form.append('files', file, file.name);
  form.append('options', JSON.stringify(request));
  return ask('v1/splice', { method: 'POST', body: form, signal });
}

export function words(search: string, limit: number, signal?: AbortSignal): Promise<WordList> {
  return ask(`v1/lexicon?limit=${limit}&search=${encodeURIComponent(search)}`, signal ? { signal } : undefined);
}

export function methods(): Promise<Part[]> {
  return ask('v1/methods');
}
