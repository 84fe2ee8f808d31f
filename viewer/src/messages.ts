/** What the page says while it works, and what went wrong. */

import { find } from './dom.js';
import { translate } from './languages.js';

/** Whether something is being loaded. */
export function busy(on: boolean): void {
  find('#stage').classList.toggle('busy', on);
  find('#stage').ariaBusy = String(on);
  if (on) status(translate('loading'));
}

export function status(text: string): void {
  const element = find('#status');
  element.textContent = element.title = text; // the line may be too short for it
}

/** Show an error; none for an empty text. */
export function alert(text: string): void {
  const element = find('#alert');
  element.textContent = text;
  element.hidden = !text;
  if (text) status('');
}

export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
