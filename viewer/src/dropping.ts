/** Files that the user drops onto the page or chooses. */

import { find } from './dom.js';
import { type Format, MEDIA_TYPES } from './wire.js';

export const FORMATS = Object.keys(MEDIA_TYPES) as Format[];
/** Suffixes of the files that can be opened: clips of every format, and avatars. */
export const SUFFIXES = [...FORMATS.map((format) => `.${format}`), '.vrm'];

export function onFiles(receive: (files: File[]) => void): void {
  let depth = 0; // dragenter and dragleave come for every element under the pointer
  const mark = () => document.body.classList.toggle('dropping', depth > 0);
  addEventListener('dragenter', (event) => (event.preventDefault(), depth++, mark()));
  addEventListener('dragover', (event) => event.preventDefault());
  addEventListener('dragleave', () => (depth--, mark()));
  addEventListener('drop', (event) => {
    event.preventDefault();
    depth = 0;
    mark();
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length) receive(files);
  });
  const input = find<HTMLInputElement>('#files');
  input.accept = SUFFIXES.join(',');
  find('#open').addEventListener('click', () => input.click());
  input.addEventListener('change', () => {
    receive([...(input.files ?? [])]);
    input.value = '';
  });
}
