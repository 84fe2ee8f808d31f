/** The page's address: it holds the sentence and what is set, so that it can be shared. Only what is not standard is in it. */

import { find } from './dom.js';
import type { View } from './api.js';

/** Controls whose values are in the address, by their names there: those of the service's dials. */
const CONTROLS = {
  cutter: '#cutter',
  transition: '#transition',
  transition_time: '#transition-time',
  sign_speed: '#sign-speed',
  tempo: '#tempo',
  free_hand: '#free-hand',
  person: '#person',
  system: '#system',
  compare: '#compare',
  speed: '#speed',
} as const;
const PAGE = performance.timeOrigin; // entries of the history that an earlier load of the page wrote have other numbers
const VIEWS: readonly View[] = ['front', 'side', 'hands'];

/** How the scene is shown. */
export interface Looks {
  view: View;
  isMirrored: boolean;
  hasCaptions: boolean;
}

/** What the address holds besides the controls' values. */
export interface Shown extends Looks {
  glosses: string[];
}

/** What the address holds; the controls get its values, or their standard ones where it has none that they can have. */
export function read(): Shown {
  const given = new URLSearchParams(location.search);
  for (const [name, query] of Object.entries(CONTROLS)) {
    const control = find<HTMLInputElement | HTMLSelectElement>(query);
    const value = given.get(name) ?? '';
    const isUsable = value.trim() !== '' && (control instanceof HTMLSelectElement || Number.isFinite(Number(value)));
    control.value = isUsable ? value : standard(control); // a number out of a range becomes the nearest in it
    if (!control.value) control.value = standard(control); // no such option
    if (name === 'transition_time') find<HTMLInputElement>('#transition-auto').checked = !isUsable;
  }
  const view = given.get('view') as View;
  return {
    glosses: (given.get('s') ?? '').slice(0, find<HTMLInputElement>('#glosses').maxLength).split(/\s+/).filter(Boolean),
    view: VIEWS.includes(view) ? view : 'front',
    isMirrored: given.get('mirror') === '1',
    hasCaptions: given.get('captions') !== '0',
  };
}

/** Write the address, as a new entry of the history or in place of the one there is. ``source``: number of what is shown. */
export function write(shown: Shown, source: number, isNew: boolean): void {
  const held = new URLSearchParams();
  if (shown.glosses.length) held.set('s', shown.glosses.join(' '));
  for (const [name, query] of Object.entries(CONTROLS)) {
    const control = find<HTMLInputElement | HTMLSelectElement>(query);
    const isOwn = name === 'transition_time' ? !find<HTMLInputElement>('#transition-auto').checked : control.value !== standard(control);
    if (isOwn) held.set(name, control.value);
  }
  if (shown.view !== 'front') held.set('view', shown.view);
  if (shown.isMirrored) held.set('mirror', '1');
  if (!shown.hasCaptions) held.set('captions', '0');
  const search = held.size ? `?${held}` : '';
  const url = location.pathname + search;
  if (isNew && (search !== location.search || source !== current())) history.pushState({ page: PAGE, source }, '', url);
  else history.replaceState({ page: PAGE, source }, '', url);
}

/** The number of what the present entry of the history shows; null for an entry that was not written since the page was loaded. */
export function current(): number | null {
  const state = history.state as { page: number; source: number } | null;
  return state?.page === PAGE ? state.source : null;
}

function standard(control: HTMLInputElement | HTMLSelectElement): string {
  if (control instanceof HTMLInputElement) return control.defaultValue;
  const options = [...control.options];
  return (options.find((option) => option.defaultSelected) ?? options[0])?.value ?? '';
}
