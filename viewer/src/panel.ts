/** The panel of the animation: its seams, its warnings and its downloads. */

import { find, option } from './dom.js';
import * as films from './film.js';
import { translate } from './languages.js';
import { label, seams } from './scene.js';
import type { Format, Report, Spliced } from './wire.js';

export type Download = Format | 'film' | 'report' | 'page';

/** Fill the panel; ``loop`` is called with the number of a seam that the user chooses. */
export function show(scenes: Spliced[], loop: (seam: number) => void): void {
  const scene = scenes[0]!;
  const all = seams(scene.report);
  const names = all.map(({ before, after }) => `${before} → ${after}`);
  find('#loop').replaceChildren(
    option('', translate('noLoop')),
    option('all', translate('everything')),
    ...names.map((name, k) => option(String(k), name)),
  );
  find('#seams').replaceChildren(
    ...all.map((seam, k) => {
      const row = document.createElement('tr');
      const button = Object.assign(document.createElement('button'), { type: 'button', textContent: names[k]! });
      button.ariaLabel = `${names[k]}: ${translate('loop')}`;
      button.addEventListener('click', () => loop(k));
      const name = document.createElement('td');
      name.append(button);
      row.append(name, ...[seam.seconds, seam.peak, seam.jump].map(cell));
      return row;
    }),
  );
  const warnings = new Set([
    ...scene.units.flatMap(({ note, warning }) => [note, warning]).filter(Boolean),
    ...scene.report.warnings,
    ...all.flatMap((seam, k) => seam.warnings.map((warning) => `${names[k]}: ${warning}`)),
  ]);
  find('#warnings').replaceChildren(
    ...[...warnings].map((text) => Object.assign(document.createElement('li'), { textContent: text })),
  );
  find('#by-rule').hidden = !hasFaceByRule(scene.report);
  find('#report').hidden = !all.length && !warnings.size;
  for (const button of document.querySelectorAll<HTMLButtonElement>('[data-file]')) {
    const file = button.dataset['file'] as Download;
    const available = file === 'film' ? films.possible() : file === 'report' || file === 'page' || scene.files[file] !== null;
    button.disabled = !available;
    if (!available) button.title = file === 'film' ? translate('noFilm') : translate('noFile', { file: file.toUpperCase() });
  }
}

/** Whether rules move the face of a sign that has none of its own. */
function hasFaceByRule({ face, spans }: Report & { face?: { recorded: number[]; rules: string[] } }): boolean {
  return !!face?.rules.length && spans.some(({ kind, clip }) => kind === 'sign' && clip !== null && !face.recorded.includes(clip));
}

/** The names of two sides, by what differs between them; none for one. */
export function sideNames(scenes: Spliced[]): string[] {
  return scenes.length > 1 ? scenes.map((_, side) => sideName(scenes, side)) : [];
}

function sideName(scenes: Spliced[], side: number): string {
  const { cutter, transition } = scenes[side]!.report;
  const other = scenes[1 - side]!.report;
  if (transition && transition !== other.transition) return transition;
  if (cutter && cutter !== other.cutter) return cutter;
  return label(scenes[side]!.name);
}

function cell(value: number | null): HTMLTableCellElement {
  return Object.assign(document.createElement('td'), { textContent: value === null ? '–' : value.toFixed(2) });
}
