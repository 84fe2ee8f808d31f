/** The attributes of a `<sign-player>` as properties: what users set. See docs/player.md. */

import type { View } from './api.js';

/** Attributes that say what is shown: a change loads anew. */
export const SOURCES = ['src', 'gloss', 'text', 'service', 'avatar'] as const;
export const OTHERS = ['rate', 'controls', 'poster', 'view', 'mirrored', 'captions', 'camera-controls', 'loop'] as const;
export const PROPERTIES = [...SOURCES, 'rate', 'poster', 'view', 'controls', 'autoplay', 'loop', 'captions', 'mirrored', 'cameraControls'] as const;
const VIEWS: readonly string[] = ['front', 'side', 'hands'] satisfies View[];
const Base = globalThis.HTMLElement ?? (class {} as typeof HTMLElement); // a page that is rendered on a server has none

export class Attributes extends Base {
  /** Address of a .glb, a .vrma or an answer of /v1/sentence. */
  get src(): string { return this.getAttribute('src') ?? ''; }
  set src(address: string) { this.setAttribute('src', address); }
  /** Address of an avatar (.vrm or .glb) that signs, or name of one of the service's; else the file's own figure does. */
  get avatar(): string { return this.getAttribute('avatar') ?? ''; }
  set avatar(address: string) { this.setAttribute('avatar', address); }
  /** Glosses for the service to sign, in the order of signing. */
  get gloss(): string { return this.getAttribute('gloss') ?? ''; }
  set gloss(line: string) { this.setAttribute('gloss', line); }
  /** A typed line for the service to sign, word by word. */
  get text(): string { return this.getAttribute('text') ?? ''; }
  set text(line: string) { this.setAttribute('text', line); }
  /** Address of the service. */
  get service(): string { return this.getAttribute('service') ?? ''; }
  set service(address: string) { this.setAttribute('service', address); }
  /** Address of a picture that is shown until the figure is there, or in its place without WebGL. */
  get poster(): string { return this.getAttribute('poster') ?? ''; }
  set poster(address: string) { this.setAttribute('poster', address); }
  /** Speed of playing; 1 is as it was signed. */
  get rate(): number {
    const rate = Number(this.getAttribute('rate') ?? 1);
    return rate > 0 && rate <= 10 ? rate : 1;
  }
  set rate(rate: number) { this.setAttribute('rate', String(rate)); }
  /** Where the camera stands: in front, at the side, or near the hands, which it follows. */
  get view(): View {
    const view = this.getAttribute('view') ?? '';
    return VIEWS.includes(view) ? (view as View) : 'front';
  }
  set view(view: View) { this.setAttribute('view', view); }
  get controls(): boolean { return this.hasAttribute('controls'); }
  set controls(on: boolean) { this.toggleAttribute('controls', on); }
  /** Play as soon as it is there, unless the user wants little motion. */
  get autoplay(): boolean { return this.hasAttribute('autoplay'); }
  set autoplay(on: boolean) { this.toggleAttribute('autoplay', on); }
  get loop(): boolean { return this.hasAttribute('loop'); }
  set loop(on: boolean) { this.toggleAttribute('loop', on); }
  /** Whether glosses are shown; they are labels, not a translation. */
  get captions(): boolean { return this.hasAttribute('captions'); }
  set captions(on: boolean) { this.toggleAttribute('captions', on); }
  /** Whether the picture is a mirror's. */
  get mirrored(): boolean { return this.hasAttribute('mirrored'); }
  set mirrored(on: boolean) { this.toggleAttribute('mirrored', on); }
  /** Whether the user can turn and move the camera. */
  get cameraControls(): boolean { return this.hasAttribute('camera-controls'); }
  set cameraControls(on: boolean) { this.toggleAttribute('camera-controls', on); }
}
