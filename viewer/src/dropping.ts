/** Files that the user drops onto the page or chooses. */

import { find } from './dom.js';
import { type Format, MEDIA_TYPES } from './wire.js';

export const FORMATS = Object.keys(MEDIA_TYPES) as Format[];
/** Suffixes of the files that can be opened: clips of every format, signs written in SiGML or HamNoSys, and avatars. */
export const SUFFIXES = [...FORMATS.map((format) => `.${format}`), '.sigml', '.xml', '.csv', '.json', '.txt', '.tsv', '.vrm'];

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
    const files = filesIn(event.dataTransfer);
    if (files.length) receive(files);
  });
  addEventListener('paste', (event) => {
    const files = filesIn(event.clipboardData);
    if (!files.length) return;
    event.preventDefault();
    receive(files);
  });
  const input = find<HTMLInputElement>('#files');
  input.accept = SUFFIXES.join(',');
  find('#open').addEventListener('click', () => input.click());
  input.addEventListener('change', () => {
    receive([...(input.files ?? [])]);
    input.value = '';
  });
}

/** What is dropped or pasted: files, or one of the signs that a text writes in SiGML or HamNoSys; none for any other text. */
function filesIn(data: DataTransfer | null): File[] {
  const files = [...(data?.files ?? [])];
  const text = data?.getData('text/plain').trim() ?? '';
  if (files.length || !text) return files;
  if (/^<(\?xml|sigml|!--)/i.test(text)) return [new File([text], 'text.sigml')];
  if (!/[\uE000-\uF8FF]/.test(text)) return []; // HamNoSys's symbols are of the private use area
  const lines = text.split(/\r?\n/).filter((line) => line.trim());
  return [new File([lines.map((line, k) => (line.includes('\t') ? line : `SIGN-${k + 1}\t${line.trim()}`)).join('\n')], 'text.txt')];
}
