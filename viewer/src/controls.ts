/** The bar of controls below a player, and its keys. */

import type { View, Word } from './api.js';
import { type Language, translateTo } from './languages.js';
import type { Player } from './player.js';

export interface Handlers {
  toggle(): void;
  seek(frame: number): void;
  step(frames: number): void;
  rate(rate: number): void;
  captions(): void;
  mirror(): void;
  view(view: View): void;
}

const RATES = [0.25, 0.5, 0.75, 1, 1.5, 2];

export class Controls {
  readonly bar = document.createElement('div');
  private readonly play = document.createElement('button');
  private readonly slider = Object.assign(document.createElement('input'), { type: 'range', min: '0', max: '0', value: '0' });
  private readonly clock = document.createElement('output');
  private readonly speed = document.createElement('select');
  private readonly captions = document.createElement('button');
  private language: Language = 'en';

  constructor(private readonly handlers: Handlers) {
    this.bar.className = 'controls';
    this.bar.role = 'group';
    this.play.type = this.captions.type = 'button';
    this.play.textContent = '▶';
    this.captions.textContent = 'CC';
    this.clock.ariaHidden = 'true';
    this.bar.append(this.play, this.slider, this.clock, this.speed, this.captions);
    this.play.addEventListener('click', () => handlers.toggle());
    this.captions.addEventListener('click', () => handlers.captions());
    this.slider.addEventListener('input', () => handlers.seek(Number(this.slider.value)));
    this.speed.addEventListener('change', () => handlers.rate(Number(this.speed.value)));
  }

  /** Something else is shown, or more of it. */
  open({ frames }: Player): void {
    this.slider.max = String(frames - 1);
  }

  set(rate: number, hasCaptions: boolean): void {
    const rates = [...new Set([...RATES, rate])].sort((a, b) => a - b);
    this.speed.replaceChildren(...rates.map((one) => new Option(`${one}×`, String(one), one === 1, one === rate)));
    this.captions.ariaPressed = String(hasCaptions);
  }

  at({ frame, frames, fps, playing }: Player, words: readonly Word[]): void {
    this.slider.value = String(frame);
    const seconds = frame / fps;
    const word = words.find(({ start, end }) => seconds >= start - 1e-6 && seconds < end - 1e-6)?.gloss ?? '';
    this.slider.setAttribute('aria-valuetext', translateTo(this.language, 'frameValue', { frame: frame + 1, frames, caption: word }));
    this.clock.textContent = `${seconds.toFixed(1)} / ${((frames - 1) / fps).toFixed(1)} s`;
    this.play.textContent = playing ? '❚❚' : '▶';
    this.play.ariaLabel = this.play.title = translateTo(this.language, playing ? 'pause' : 'play');
  }

  label(language: Language): void {
    this.language = language;
    this.bar.ariaLabel = translateTo(language, 'controls');
    this.play.ariaLabel ??= translateTo(language, 'play');
    this.slider.ariaLabel = translateTo(language, 'frame');
    this.speed.ariaLabel = translateTo(language, 'speed');
    this.captions.title = translateTo(language, 'captions');
    this.captions.ariaLabel = `CC: ${this.captions.title}`;
  }

  /** Space or K plays, arrows step, M mirrors, C shows captions, 1 2 3 move the camera. */
  key(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    if (event.ctrlKey || event.metaKey || event.altKey || target.matches('select')) return;
    if (target.matches('button') && (event.key === ' ' || event.key === 'Enter')) return;
    if (target === this.slider && event.key.startsWith('Arrow')) return;
    const { toggle, step, mirror, captions, view } = this.handlers;
    const acts: Record<string, () => void> = {
      ' ': toggle, k: toggle, m: mirror, c: captions,
      ArrowLeft: () => step(-1), ArrowRight: () => step(1),
      '1': () => view('front'), '2': () => view('side'), '3': () => view('hands'),
    };
    const act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}
