/** The time line: spans of words and transitions, each a button, over a slider of frames. */

import { say } from './languages.js';
import { caption, plain, seams, spanAt } from './scene.js';
import type { Spliced } from './wire.js';

const PIXELS_A_SECOND = 70;

export interface Told {
  frame(frame: number): void;
  seam(seam: number): void;
}

export class TimeLine {
  private readonly spans: HTMLOListElement;
  private readonly slider: HTMLInputElement;
  private scene: Spliced | null = null;
  private now = -1;

  constructor(private readonly place: HTMLElement, private readonly told: Told) {
    this.spans = place.querySelector('ol')!;
    this.slider = place.querySelector('input')!;
    this.slider.addEventListener('input', () => this.told.frame(Number(this.slider.value)));
  }

  /** ``frames``: how many there are to play, more than the scene's own where a longer one is beside it. */
  show(scene: Spliced, frames: number): void {
    this.scene = scene;
    this.now = -1;
    const { fps, spans } = scene.report;
    (this.place.querySelector('.track') as HTMLElement).style.width = `max(100%, ${(frames / fps) * PIXELS_A_SECOND}px)`;
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
          const name = span.name ?? '';
          button.textContent = name;
          button.title = button.ariaLabel = say('goTo', { name });
          button.addEventListener('click', () => this.told.frame(from));
        } else {
          const number = all.findIndex((one, k) => k >= seam && one.from === from);
          seam = number + 1;
          const { before, after } = all[number] ?? { before: '', after: '' };
          button.title = button.ariaLabel = say('transitionTo', { before, after });
          button.addEventListener('click', () => this.told.seam(number));
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
    const told = plain(caption(this.scene, frame));
    this.slider.setAttribute('aria-valuetext', say('frameTold', { frame: frame + 1, frames: report.frames, caption: told }));
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
    const track = this.place.scrollWidth;
    if (playing && track > this.place.clientWidth) {
      this.place.scrollLeft = (track * frame) / report.frames - this.place.clientWidth / 2;
    }
  }
}
