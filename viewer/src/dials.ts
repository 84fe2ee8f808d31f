/** The dials: options of a splice, and a second method to compare with. */

import { find, option } from './dom.js';
import { translate } from './languages.js';
import { own } from './service.js';
import type { Dials, MethodInfo } from './wire.js';

const auto = () => find<HTMLInputElement>('#transition-auto');
const value = (query: string) => find<HTMLInputElement | HTMLSelectElement>(query).value;

/** The options that the dials show; and the same with another method, where one is chosen to compare. */
export function requested(): Dials[] {
  const system = value('#system') || null;
  const sign_speed = Number(value('#sign-speed'));
  const dials: Dials = {
    cutter: value('#cutter') || null,
    transition: value('#transition') || null,
    transition_time: auto().checked ? 'auto' : Number(value('#transition-time')),
    sign_speed,
    tempo: value('#tempo') as 'citation' | 'natural',
    free_hand: value('#free-hand') as 'natural' | 'transition',
    person: Number(value('#person')),
  };
  const joined = (by: string): Dials => ({ system: by as Dials['system'], sign_speed }); // a system chooses all else
  const first = system ? joined(system) : dials;
  const [kind, name] = value('#compare').split(':');
  if (!kind || !name) return [first];
  return [first, kind === 'system' ? joined(name) : { ...dials, [kind]: name }];
}

/** Call ``changed`` when the user has changed a dial. */
export function onChange(changed: () => void): void {
  for (const dial of document.querySelectorAll<HTMLElement>('#dials input, #dials select')) {
    dial.addEventListener('input', showValues);
    dial.addEventListener('change', () => {
      if (dial.id === 'transition-time') auto().checked = false;
      showValues();
      changed();
    });
  }
}

/** Write the value of each dial next to it. */
export function showValues(): void {
  find('#transition-time-value').textContent = auto().checked ? '' : `${Number(value('#transition-time')).toFixed(2)} s`;
  find('#sign-speed-value').textContent = `${Number(value('#sign-speed')).toFixed(2)}×`;
  find('#person-value').textContent = Number(value('#person')).toFixed(1);
}

/** Fill the lists with the service's methods; the choices stay. */
export async function listMethods(): Promise<void> {
  const methods = await own.methods().catch(() => [] as MethodInfo[]);
  const fill = (query: string, options: Node[]) => {
    const kept = value(query);
    find(query).replaceChildren(...options);
    find<HTMLSelectElement>(query).value = kept;
  };
  const of = (kind: MethodInfo['kind']) => methods.filter((method) => method.kind === kind);
  for (const kind of ['cutter', 'transition'] as const) {
    const standard = of(kind).find((method) => method.default)?.name ?? '';
    const others = of(kind).filter((method) => !method.default);
    fill(`#${kind}`, [
      option('', `${standard} (${translate('standard')})`),
      ...others.map((method) => option(method.name, method.name, method.summary)),
    ]);
  }
  const systems = () => of('system').map((method) => option(method.name, method.name, method.summary));
  fill('#system', [option('', translate('nothing')), ...systems()]);
  const groups = (['transition', 'cutter', 'system'] as const).map((kind) => {
    const group = Object.assign(document.createElement('optgroup'), { label: translate(kind) });
    group.append(...of(kind).map((method) => option(`${kind}:${method.name}`, method.name, method.summary)));
    return group;
  });
  fill('#compare', [option('', translate('nothing')), ...groups]);
}
