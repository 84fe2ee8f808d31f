/** The dials: what the service is asked to do with the words, and with which method beside it. */

import { find, option } from './dom.js';
import { say } from './languages.js';
import * as service from './service.js';
import type { Dials, Part } from './wire.js';

const auto = () => find<HTMLInputElement>('#transition-auto');
const value = (query: string) => find<HTMLInputElement | HTMLSelectElement>(query).value;

/** What the dials say; and the same by another method, where one is to be shown beside. */
export function wishes(): Dials[] {
  const first: Dials = {
    cutter: value('#cutter') || null,
    transition: value('#transition') || null,
    transition_time: auto().checked ? 'auto' : Number(value('#transition-time')),
    sign_speed: Number(value('#sign-speed')),
  };
  const [kind, name] = value('#beside').split(':');
  return kind && name ? [first, { ...first, [kind]: name }] : [first];
}

/** Call when a dial is turned and let go. */
export function onChange(changed: () => void): void {
  for (const dial of document.querySelectorAll<HTMLElement>('#dials input, #dials select')) {
    dial.addEventListener('input', tell);
    dial.addEventListener('change', () => {
      if (dial.id === 'transition-time') auto().checked = false;
      tell();
      changed();
    });
  }
}

/** Write beside each dial what it says. */
export function tell(): void {
  find('#transition-time-told').textContent = auto().checked ? '' : `${Number(value('#transition-time')).toFixed(2)} s`;
  find('#sign-speed-told').textContent = `${Number(value('#sign-speed')).toFixed(2)}×`;
}

/** Offer the service's methods; what was chosen stays. */
export async function offer(): Promise<void> {
  const parts = await service.methods().catch(() => [] as Part[]);
  const fill = (query: string, options: Node[]) => {
    const kept = value(query);
    find(query).replaceChildren(...options);
    find<HTMLSelectElement>(query).value = kept;
  };
  const of = (kind: Part['kind']) => parts.filter((part) => part.kind === kind);
  for (const kind of ['cutter', 'transition'] as const) {
    const usual = of(kind).find((part) => part.default)?.name ?? '';
    const others = of(kind).filter((part) => !part.default);
    fill(`#${kind}`, [
      option('', `${usual} (${say('standard')})`),
      ...others.map((part) => option(part.name, part.name, part.summary)),
    ]);
  }
  const groups = (['transition', 'cutter'] as const).map((kind) => {
    const group = Object.assign(document.createElement('optgroup'), { label: say(kind) });
    group.append(...of(kind).map((part) => option(`${kind}:${part.name}`, part.name, part.summary)));
    return group;
  });
  fill('#beside', [option('', say('nothing')), ...groups]);
}
