/** Keys, and what the page says of them. */

import { find } from './dom.js';
import { say } from './languages.js';

export interface Acts {
  toggle(): void;
  step(frames: number): void;
  seam(by: number): void;
  unloop(): void;
  mirror(): void;
  look(view: 'front' | 'side' | 'hands'): void;
  faster(by: number): void;
}

const TOLD = [
  ['␣', 'key_space'],
  ['← →', 'key_arrows'],
  ['⇧← ⇧→', 'key_shift'],
  ['L', 'key_l'],
  ['1 2 3', 'key_views'],
  ['M', 'key_m'],
  ['[ ]', 'key_speed'],
] as const;

/** Listen on the whole page; fields that are written into keep their keys. */
export function listen(acts: Acts): void {
  document.addEventListener('keydown', (event) => {
    const target = event.target as HTMLElement;
    if (event.ctrlKey || event.metaKey || event.altKey || !find<HTMLInputElement>('#keys-on').checked) return;
    if (target.matches('select, input:not([type=range]), textarea')) return;
    if (event.key === ' ' && target.matches('button, summary')) return;
    // Elsewhere arrows move what they always move: a dial, a list that scrolls.
    if (event.key.startsWith('Arrow') && target !== document.body && !target.closest('#stage, #time, #controls')) return;
    const known: Record<string, () => void> = {
      ' ': () => acts.toggle(),
      ArrowLeft: () => (event.shiftKey ? acts.seam(-1) : acts.step(-1)),
      ArrowRight: () => (event.shiftKey ? acts.seam(1) : acts.step(1)),
      l: () => acts.unloop(),
      m: () => acts.mirror(),
      '1': () => acts.look('front'),
      '2': () => acts.look('side'),
      '3': () => acts.look('hands'),
      '[': () => acts.faster(-1),
      ']': () => acts.faster(1),
    };
    const act = known[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

/** Write the list of keys. */
export function tell(): void {
  find('#keys').replaceChildren(
    ...TOLD.flatMap(([key, text]) => {
      const term = document.createElement('dt');
      term.append(Object.assign(document.createElement('kbd'), { textContent: key }));
      return [term, Object.assign(document.createElement('dd'), { textContent: say(text) })];
    }),
  );
}
