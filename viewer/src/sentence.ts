/** The sentence box: a combobox (ARIA 1.2) that completes the gloss at the caret. */

import { translate } from './languages.js';
import { replaced } from './scene.js';
import { own } from './service.js';

const MAX_SUGGESTIONS = 8;
const PAUSE_MS = 120;

export class SentenceBox {
  private readonly input: HTMLInputElement;
  private readonly list: HTMLUListElement;
  private readonly meant: HTMLParagraphElement;
  private chosen = -1;
  private timer = 0;
  private request: AbortController | null = null;

  constructor(form: HTMLFormElement, private readonly submitted: (glosses: string[]) => void) {
    this.input = form.querySelector('input')!;
    this.list = form.querySelector('ul')!;
    this.meant = document.querySelector('#meant')!;
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.sign();
    });
    this.input.addEventListener('input', () => {
      clearTimeout(this.timer);
      this.timer = window.setTimeout(() => void this.suggest(), PAUSE_MS);
    });
    this.input.addEventListener('keydown', (event) => this.key(event));
    this.input.addEventListener('blur', () => setTimeout(() => this.close(), 150));
    this.list.addEventListener('mousedown', (event) => {
      const item = (event.target as Element).closest('li');
      if (!item) return;
      event.preventDefault(); // the caret stays in the box
      this.complete(item.dataset['gloss']!);
    });
  }

  private sign(): void {
    this.close();
    if (this.glosses.length) this.submitted(this.glosses);
  }

  /** Offer glosses that may have been meant by words of the line, each as a button that signs it instead. */
  offer(words: [typed: string, glosses: string[]][]): void {
    const offered = words.filter(([, glosses]) => glosses.length);
    this.meant.hidden = !offered.length;
    this.meant.replaceChildren(
      ...offered.flatMap(([typed, glosses]) => [
        Object.assign(document.createElement('span'), { textContent: translate('meant', { typed }) }),
        ...glosses.map((gloss) => {
          const button = Object.assign(document.createElement('button'), { type: 'button', textContent: gloss });
          button.addEventListener('click', () => {
            this.input.value = replaced(this.input.value, typed, gloss);
            this.input.focus();
            this.sign();
          });
          return button;
        }),
      ]),
    );
  }

  get glosses(): string[] {
    return this.input.value.split(/\s+/).filter(Boolean);
  }

  set glosses(line: string[]) {
    this.input.value = line.join(' ');
  }

  /** Start and end of the gloss at the caret. */
  private glossRange(): [number, number] {
    const { value } = this.input;
    const caret = this.input.selectionStart ?? value.length;
    const from = value.slice(0, caret).search(/\S*$/);
    const rest = value.slice(caret).search(/\s|$/);
    return [from, caret + rest];
  }

  private async suggest(): Promise<void> {
    const [from, to] = this.glossRange();
    const prefix = this.input.value.slice(from, to);
    this.request?.abort();
    if (!prefix || document.activeElement !== this.input) return this.close();
    this.request = new AbortController();
    try {
      const { words } = await own.words(prefix, MAX_SUGGESTIONS, this.request.signal);
      this.list.replaceChildren(
        ...words.map((word, k) => {
          const item = document.createElement('li');
          item.id = `suggestion-${k}`;
          item.role = 'option';
          item.dataset['gloss'] = word.gloss;
          item.ariaSelected = 'false';
          const synonyms = document.createElement('small');
          synonyms.textContent = word.synonyms.join(', ');
          item.append(word.gloss, synonyms);
          return item;
        }),
      );
      this.chosen = -1;
      const only = words.length === 1 && words[0]!.gloss.toLowerCase() === prefix.toLowerCase();
      this.list.hidden = !words.length || only;
      this.input.ariaExpanded = String(!this.list.hidden);
    } catch {
      this.close(); // without suggestions the box still works
    }
  }

  private key(event: KeyboardEvent): void {
    const items = [...this.list.children];
    if (this.list.hidden || event.isComposing) return;
    if (event.key === 'ArrowDown' || event.key === 'ArrowUp') {
      const by = event.key === 'ArrowDown' ? 1 : -1;
      this.chosen = ((this.chosen + by + (this.chosen < 0 && by < 0 ? 1 : 0)) + items.length) % items.length;
      items.forEach((item, k) => (item.ariaSelected = String(k === this.chosen)));
      this.input.setAttribute('aria-activedescendant', items[this.chosen]!.id);
      items[this.chosen]!.scrollIntoView({ block: 'nearest' });
      event.preventDefault();
    } else if ((event.key === 'Enter' || event.key === 'Tab') && this.chosen >= 0) {
      this.complete((items[this.chosen] as HTMLElement).dataset['gloss']!);
      event.preventDefault();
    } else if (event.key === 'Escape') {
      this.close();
      event.preventDefault();
    }
  }

  private complete(gloss: string): void {
    const [from, to] = this.glossRange();
    const { value } = this.input;
    const after = value.slice(to).trimStart();
    this.input.value = `${value.slice(0, from)}${gloss} ${after}`;
    this.input.setSelectionRange(from + gloss.length + 1, from + gloss.length + 1);
    this.close();
    this.input.focus();
  }

  private close(): void {
    clearTimeout(this.timer);
    this.request?.abort();
    this.list.hidden = true;
    this.chosen = -1;
    this.input.ariaExpanded = 'false';
    this.input.removeAttribute('aria-activedescendant');
  }
}
