/** Keyboard shortcuts, and their list on the page. */

import { find } from './dom.js';
import { translate } from './languages.js';

export interface Actions {
  toggle(): void;
  step(frames: number): void;
  seam(by: number): void;
  unloop(): void;
  mirror(): void;
  look(view: 'front' | 'side' | 'hands'): void;
  faster(by: number): void;
}

const HELP = [
  ['␣', 'key_space'],
  ['← →', 'key_arrows'],
  ['⇧← ⇧→', 'key_shift'],
  ['L', 'key_l'],
  ['1 2 3', 'key_views'],
  ['M', 'key_m'],
  ['[ ]', 'key_speed'],
] as const;

/** Listen on the whole page, except in fields for text. */
export function listen(actions: Actions): void {
  document.addEventListener('keydown', (event) => {
    const target = event.target as HTMLElement;
    if (event.ctrlKey || event.metaKey || event.altKey || !find<HTMLInputElement>('#keys-on').checked) return;
    if (target.matches('select, input:not([type=range]), textarea')) return;
    if (event.key === ' ' && target.matches('button, summary')) return;
    // Elsewhere arrows keep their usual function: they move a dial or scroll a list.
    if (event.key.startsWith('Arrow') && target !== document.body && !target.closest('#stage, #time, #controls')) return;
    const shortcuts: Record<string, () => void> = {
      ' ': () => actions.toggle(),
      ArrowLeft: () => (event.shiftKey ? actions.seam(-1) : actions.step(-1)),
      ArrowRight: () => (event.shiftKey ? actions.seam(1) : actions.step(1)),
      l: () => actions.unloop(),
      m: () => actions.mirror(),
      '1': () => actions.look('front'),
      '2': () => actions.look('side'),
      '3': () => actions.look('hands'),
      '[': () => actions.faster(-1),
      ']': () => actions.faster(1),
    };
    const act = shortcuts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

/** Write the list of shortcuts. */
export function showHelp(): void {
  find('#keys').replaceChildren(
    ...HELP.flatMap(([key, text]) => {
      const term = document.createElement('dt');
      term.append(Object.assign(document.createElement('kbd'), { textContent: key }));
      return [term, Object.assign(document.createElement('dd'), { textContent: translate(text) })];
    }),
  );
}
