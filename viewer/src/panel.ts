/** What is said of the animation beside it: its seams, its warnings, what of it can be taken away. */

import { find, option } from './dom.js';
import * as films from './film.js';
import { say } from './languages.js';
import { seams } from './scene.js';
import type { Format, Spliced } from './wire.js';

export type Taken = Format | 'film' | 'report' | 'page';

/** Fill the panel; ``loop`` is called with the seam that a user wants to see again and again. */
export function show(scenes: Spliced[], loop: (seam: number) => void): void {
  const scene = scenes[0]!;
  const all = seams(scene.report);
  document.querySelectorAll<HTMLElement>('.side').forEach((side, k) => {
    side.hidden = k >= scenes.length;
    side.querySelector('.method')!.textContent = scenes.length > 1 && scenes[k] ? named(scenes, k) : '';
  });
  const names = all.map(({ before, after }) => `${before} → ${after}`);
  find('#loop').replaceChildren(
    option('', say('noLoop')),
    option('all', say('everything')),
    ...names.map((name, k) => option(String(k), name)),
  );
  find('#seams').replaceChildren(
    ...all.map((seam, k) => {
      const row = document.createElement('tr');
      const button = Object.assign(document.createElement('button'), { type: 'button', textContent: names[k]! });
      button.ariaLabel = `${names[k]}: ${say('loop')}`;
      button.addEventListener('click', () => loop(k));
      const name = document.createElement('td');
      name.append(button);
      row.append(name, ...[seam.seconds, seam.peak, seam.jump].map(cell));
      return row;
    }),
  );
  const warnings = new Set([
    ...scene.units.map((unit) => unit.warning).filter(Boolean),
    ...scene.report.warnings,
    ...all.flatMap((seam, k) => seam.warnings.map((warning) => `${names[k]}: ${warning}`)),
  ]);
  find('#warnings').replaceChildren(
    ...[...warnings].map((text) => Object.assign(document.createElement('li'), { textContent: text })),
  );
  find('#told').hidden = !all.length && !warnings.size;
  for (const button of document.querySelectorAll<HTMLButtonElement>('[data-file]')) {
    const file = button.dataset['file'] as Taken;
    const there = file === 'film' ? films.possible() : file === 'report' || file === 'page' || scene.files[file] !== null;
    button.disabled = !there;
    if (!there) button.title = file === 'film' ? say('noFilm') : say('noFile', { file: file.toUpperCase() });
  }
}

/** What tells two sides apart. */
function named(scenes: Spliced[], side: number): string {
  const { cutter, transition } = scenes[side]!.report;
  const other = scenes[1 - side]!.report;
  if (transition && transition !== other.transition) return transition;
  if (cutter && cutter !== other.cutter) return cutter;
  return scenes[side]!.name;
}

function cell(value: number | null): HTMLTableCellElement {
  return Object.assign(document.createElement('td'), { textContent: value === null ? '–' : value.toFixed(2) });
}
