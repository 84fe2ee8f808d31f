/** The time line: a button for each span, above a slider of frames. */

import { translate } from './languages.js';
import { caption, label, plain, seams, spanAt } from './scene.js';
import type { Spliced } from './wire.js';

const PIXELS_A_SECOND = 104; // a transition of 0.25 s is a target of 24 pixels (WCAG 2.2) between its margins

export interface Handlers {
  /** The user chose a frame. */
  frame(frame: number): void;
  /** The user chose a seam by its number. */
  seam(seam: number): void;
}

export class TimeLine {
  private readonly spans: HTMLOListElement;
  private readonly slider: HTMLInputElement;
  private scene: Spliced | null = null;
  private now = -1;

  constructor(private readonly element: HTMLElement, private readonly handlers: Handlers) {
    this.spans = element.querySelector('ol')!;
    this.slider = element.querySelector('input')!;
    this.slider.addEventListener('input', () => this.handlers.frame(Number(this.slider.value)));
  }

  /** ``frames``: length of the slider; longer than the scene if a longer one is compared with it. */
  show(scene: Spliced, frames: number): void {
    this.scene = scene;
    this.now = -1;
    const { fps, spans } = scene.report;
    (this.element.querySelector('.track') as HTMLElement).style.width = `max(100%, ${(frames / fps) * PIXELS_A_SECOND}px)`;
    this.slider.max = String(frames - 1);
    const all = seams(scene.report);
    let seam = 0;
    this.spans.replaceChildren(
      ...spans.map((span) => {
        const item = document.createElement('li');
        const button = document.createElement('button');
        const [from, to] = span.output;
        item.className = span.kind;
        item.style.left = `${(100 * from) / frames}%`;
        item.style.width = `${(100 * (to - from)) / frames}%`;
        button.type = 'button';
        if (span.kind === 'sign') {
          const name = label(span.name ?? '');
          button.textContent = name;
          button.title = button.ariaLabel = translate('goTo', { name });
          button.addEventListener('click', () => this.handlers.frame(from));
        } else {
          const number = all.findIndex((one, k) => k >= seam && one.from === from);
          seam = number + 1;
          const at = all[number]; // none of a retraction
          const text = at ? translate('transitionTo', { before: at.before, after: at.after }) : translate('goTo', { name: plain(caption(scene, from)) });
          button.title = button.ariaLabel = text;
          button.addEventListener('click', () => (at ? this.handlers.seam(number) : this.handlers.frame(from)));
        }
        item.append(button);
        return item;
      }),
    );
  }

  at(frame: number, playing: boolean): void {
    if (!this.scene) return;
    const { report } = this.scene;
    this.slider.value = String(frame);
    const text = plain(caption(this.scene, frame));
    this.slider.setAttribute('aria-valuetext', translate('frameValue', { frame: frame + 1, frames: report.frames, caption: text }));
    const now = spanAt(report, frame);
    if (now !== this.now) {
      for (const item of this.spans.querySelectorAll('.now')) {
        item.classList.remove('now');
        item.removeAttribute('aria-current');
      }
      this.spans.children[now]?.classList.add('now');
      this.spans.children[now]?.setAttribute('aria-current', 'true');
      this.now = now;
    }
    const { scrollWidth, clientWidth, scrollLeft } = this.element;
    const x = (scrollWidth * frame) / report.frames;
    if (playing || x < scrollLeft || x > scrollLeft + clientWidth) this.element.scrollLeft = x - clientWidth / 2;
  }
}
