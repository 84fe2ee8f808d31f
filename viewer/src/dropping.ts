/** Files that come: dropped onto the page, or chosen. */

import { find } from './dom.js';

export function onFiles(come: (files: File[]) => void): void {
  let depth = 0; // every element that is entered on the way is left again
  const mark = () => document.body.classList.toggle('dropping', depth > 0);
  addEventListener('dragenter', (event) => (event.preventDefault(), depth++, mark()));
  addEventListener('dragover', (event) => event.preventDefault());
  addEventListener('dragleave', () => (depth--, mark()));
  addEventListener('drop', (event) => {
    event.preventDefault();
    depth = 0;
    mark();
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length) come(files);
  });
  const input = find<HTMLInputElement>('#files');
  find('#open').addEventListener('click', () => input.click());
  input.addEventListener('change', () => {
    come([...(input.files ?? [])]);
    input.value = '';
  });
}
