/**
 * `<sign-player>`: a person on the user's page who signs a file or a sentence of the service. See docs/player.md.
 */

import type { SignPlayerEventMap, Word } from './api.js';
import { Attributes, OTHERS, PROPERTIES, SOURCES } from './attributes.js';
import { Controls } from './controls.js';
import { filmButton } from './flat.js';
import { isLanguage, type Language, translateTo } from './languages.js';
import { Person } from './person.js';
import { titleOf, words } from './scene.js';
import { type Avatar, Service } from './service.js';
import { Show } from './show.js';
import STYLE from './sign_player.css';
import { bareScene, bytesAt, nameAt, onAvatar, personOf, readSource, sceneOf, type Source, sourceOf } from './source.js';
import { MOST_AT_ONCE, SentenceStream } from './stream.js';
import type { Spliced } from './wire.js';

export type { Ready, SignPlayerEventMap, View, Word } from './api.js';

export class SignPlayer extends Attributes {
  static readonly observedAttributes: readonly string[] = [...SOURCES, ...OTHERS];

  /** The parts that the page of the service works with; null before the element is on a page, or without WebGL.
   * @internal */
  show: Show | null = null;
  /** @internal */
  changed: () => void = () => {};
  #canvas: HTMLCanvasElement;
  readonly #stage: HTMLElement;
  readonly #sides: HTMLElement[];
  readonly #note: HTMLParagraphElement;
  readonly #controls: Controls;
  #isQueued = false;
  #task: AbortController | null = null;
  #kept: { address: string; content: Promise<Uint8Array<ArrayBuffer>> } | null = null; // of the avatar
  #isShown = false;
  #wasPlaying = false;
  #word = -1; // number of the last that has begun
  #known: readonly Word[] = [];

  constructor() {
    super();
    const root = this.attachShadow({ mode: 'open' });
    const sheet = new CSSStyleSheet(); // a policy that forbids inline styles allows it
    sheet.replaceSync(STYLE);
    root.adoptedStyleSheets = [sheet];
    const make = <Name extends keyof HTMLElementTagNameMap>(name: Name, className: string, ...parts: Node[]): HTMLElementTagNameMap[Name] => {
      const element = Object.assign(document.createElement(name), { className });
      element.append(...parts);
      return element;
    };
    this.#canvas = make('canvas', '');
    this.#canvas.setAttribute('role', 'img');
    this.#sides = [0, 1].map(() => make('div', 'side', make('span', 'method'), make('span', 'caption')));
    this.#sides[1]!.hidden = true;
    this.#note = make('p', 'note');
    this.#note.role = 'alert';
    this.#note.hidden = true;
    const sides = make('div', 'sides', ...this.#sides);
    sides.ariaHidden = 'true';
    this.#stage = make('div', 'stage', this.#canvas, sides, this.#note);
    this.#controls = new Controls({
      toggle: () => this.#toggle(),
      seek: (frame) => this.show?.player.seek(frame),
      step: (frames) => this.show?.player.step(frames),
      rate: (rate) => (this.rate = rate),
      captions: () => this.toggleAttribute('captions'),
      mirror: () => this.toggleAttribute('mirrored'),
      view: (view) => (this.view = view),
    });
    root.append(this.#stage, this.#controls.bar);
    root.addEventListener('keydown', (event) => this.controls && this.#controls.key(event as KeyboardEvent));
  }

  connectedCallback(): void {
    for (const name of PROPERTIES) {
      // A property that was set before the element was defined hides the accessor.
      if (!Object.hasOwn(this, name)) continue;
      const value: unknown = this[name];
      delete (this as Record<string, unknown>)[name];
      Object.assign(this, { [name]: value });
    }
    if (!this.show) {
      try {
        this.show = new Show(this.#canvas, this.#sides.map((side) => side.querySelector<HTMLElement>('.caption')!), () => this.#change());
      } catch {
        this.#canvas.hidden = true;
      }
    }
    for (const name of OTHERS) this.#apply(name);
    this.relabel();
    if (!this.#isShown) this.#queue();
  }

  disconnectedCallback(): void {
    queueMicrotask(() => {
      if (this.isConnected) return; // it was only moved
      this.#task?.abort();
      this.show?.close();
      this.show = null;
      this.#isShown = false;
      // The renderer's context is gone with it, and a canvas has only one.
      const canvas = this.#canvas.cloneNode() as HTMLCanvasElement;
      this.#canvas.replaceWith(canvas);
      this.#canvas = canvas;
    });
  }

  attributeChangedCallback(name: string, before: string | null, after: string | null): void {
    if (!this.isConnected || before === after) return;
    if ((SOURCES as readonly string[]).includes(name)) this.#queue();
    else this.#apply(name as (typeof OTHERS)[number]);
  }

  // --- what users read ---

  /** Time that is shown, s. */
  get currentTime(): number { return this.show?.player.time ?? 0; }
  set currentTime(seconds: number) { this.show?.player.seek(Math.round(seconds * this.show.player.fps)); }
  get duration(): number { return this.#isShown ? this.show!.player.duration : 0; }
  get paused(): boolean { return !this.show?.player.playing; }
  /** The words of what is shown, with their times. */
  get words(): readonly Word[] { return this.#known; }

  play(): void { if (this.#isShown) this.show!.player.play(); }
  pause(): void { this.show?.player.pause(); }

  // --- loading ---

  #queue(): void {
    if (this.#isQueued) return;
    this.#isQueued = true; // attributes that are set together load once
    queueMicrotask(() => {
      this.#isQueued = false;
      if (this.isConnected) void this.#load();
    });
  }

  async #load(): Promise<void> {
    const line = (this.gloss || this.text).split(/\s+/).filter(Boolean);
    if (!this.src && !line.length && !this.avatar) return;
    const service = new Service(this.#absolute(this.service));
    if (!this.show) return this.flat(this.src ? [] : line, service);
    this.#task?.abort();
    const { signal } = (this.#task = new AbortController());
    this.#say('');
    this.#stage.ariaBusy = 'true';
    try {
      const asks = this.src ? this.hasAttribute('service') : line.length > 0;
      const avatar = await this.#avatarFile(asks, signal);
      const file = avatar && typeof avatar !== 'string' ? avatar.bytes : null;
      if (this.src) {
        const source = await readSource(this.#absolute(this.src), signal);
        if (avatar && asks) await this.#showSource(await onAvatar(source, avatar, service, signal), null, signal);
        else await this.#showSource(source, file, signal);
      } else if (line.length > MOST_AT_ONCE) await this.#showStream(service, line, avatar, signal);
      else if (line.length) {
        const request = { glosses: line, face_rules: true, formats: ['glb' as const] };
        const scene = await service.withAvatar(avatar, signal, (id) => service.sentence({ ...request, avatar: id }, signal));
        await this.#showSource(sourceOf(scene), null, signal);
      } else if (file) await this.#showAtRest(file, signal);
    } catch (error) {
      if (!signal.aborted) this.#fail(error instanceof Error ? error.message : String(error));
    } finally {
      if (this.#task?.signal === signal) this.#stage.ariaBusy = 'false';
    }
  }

  #absolute(address: string): string {
    return new URL(address, this.baseURI).href;
  }

  /** The avatar that signs: the file at an address, or, where a service is asked, what has neither suffix nor folder is its name. */
  async #avatarFile(asks: boolean, signal: AbortSignal): Promise<Avatar | null> {
    if (!this.avatar) return null;
    if (asks && /^[^./:]+$/.test(this.avatar)) return this.avatar;
    const address = this.#absolute(this.avatar);
    if (this.#kept?.address !== address) {
      const content = bytesAt(address, signal);
      this.#kept = { address, content };
      content.catch(() => (this.#kept = null));
    }
    return { name: nameAt(address), bytes: await this.#kept.content };
  }

  async #showSource(source: Source, avatar: Uint8Array<ArrayBuffer> | null, signal: AbortSignal): Promise<void> {
    const person = await personOf(source, avatar);
    if (signal.aborted || !this.show) return person.dispose();
    const scene = sceneOf(source, person.duration);
    this.present([scene], [person]);
    this.#begin(scene, person);
  }

  async #showAtRest(avatar: Uint8Array<ArrayBuffer>, signal: AbortSignal): Promise<void> {
    const person = await Person.atRest(avatar);
    if (signal.aborted || !this.show) return person.dispose();
    this.present([bareScene('', 30, 1)], [person]);
  }

  async #showStream(service: Service, line: string[], avatar: Avatar | null, signal: AbortSignal): Promise<void> {
    const { show } = this;
    const stream = new SentenceStream(service, line, avatar, signal);
    let person: Person | null = null;
    for await (const part of stream.parts(() => (person && show ? show.player.time : 0))) {
      if (signal.aborted) return;
      if (!person) {
        this.present([part.scene], [(person = part.person)]);
        show!.player.isGrowing = true;
        this.#begin(part.scene, person);
      }
      show!.player.grow(part.scene.report.frames, !part.isLast);
      this.#known = words(part.scene);
      this.#controls.open(show!.player);
      for (const error of part.errors) this.#fail(error);
    }
  }

  /** Show scenes that are loaded, one or two side by side.
   * @internal */
  present(scenes: Spliced[], people: Person[]): void {
    this.show!.open(scenes, people);
    this.#isShown = true;
    this.#known = []; // the event `ready` comes before the first word
    this.#sides.forEach((side, k) => (side.hidden = k >= scenes.length));
    this.#stage.querySelector('.poster')?.remove();
    this.#canvas.ariaLabel = `${this.#translate('stage')}: ${titleOf(scenes[0]!)}`;
    this.#controls.open(this.show!.player);
    this.#apply('loop');
  }

  /** Write what differs above two sides.
   * @internal */
  nameSides(names: string[]): void {
    this.#sides.forEach((side, k) => (side.querySelector('.method')!.textContent = names[k] ?? ''));
  }

  #begin(scene: Spliced, person: Person): void {
    this.#word = -1;
    this.#known = words(scene);
    const copied = person.isCopied ? [translateTo(this.#language, 'copied', { avatar: nameAt(this.#absolute(this.avatar)) })] : [];
    const notes = scene.units.flatMap(({ note, warning }) => [note, warning]).filter(Boolean);
    const detail = { duration: this.duration, words: this.#known, warnings: [...notes, ...scene.report.warnings, ...copied] };
    this.dispatchEvent(new CustomEvent('ready', { detail }));
    this.#change();
    if (this.hasAttribute('autoplay') && !matchMedia('(prefers-reduced-motion: reduce)').matches) this.play();
  }

  /** Without WebGL: what the service draws of a line, else the poster, and what to do.
   * @internal */
  async flat(line: string[], from: Service | null): Promise<void> {
    this.#task?.abort();
    const { signal } = (this.#task = new AbortController());
    this.#fail(this.#translate('flat'));
    const sheet = line.length && from ? await from.picture(line, 'png', signal).catch(() => null) : null; // the advice stands alone
    if (!sheet || signal.aborted) return;
    const show = (picture: Blob) => this.#picture(URL.createObjectURL(picture), line.join(' '));
    show(sheet);
    this.#stage.classList.add('is-flat');
    this.#stage.querySelector('.film')?.remove();
    const draw = () => from!.picture(line, 'gif', signal);
    const button = filmButton(draw, sheet, { stage: this.#stage, language: this.#language, show, say: (text) => this.#say(text), fail: (text) => this.#fail(text) });
    this.#stage.prepend(this.#note, button);
    Object.assign(this.#stage, { tabIndex: 0, role: 'group', ariaLabel: this.#translate('stage') });
  }

  #picture(address: string, text: string): void {
    const image = this.#stage.querySelector<HTMLImageElement>('.poster') ?? new Image();
    Object.assign(image, { className: 'poster', src: address, alt: text });
    this.#canvas.after(image);
  }

  #fail(message: string): void {
    this.#say(message);
    this.dispatchEvent(new CustomEvent('error', { detail: { message } }));
  }

  #say(message: string): void {
    this.#note.textContent = message;
    this.#note.hidden = !message;
  }

  // --- what changes while it plays ---

  #toggle(): void {
    if (this.#isShown) this.show!.toggle();
  }

  #apply(name: (typeof OTHERS)[number]): void {
    const { show } = this;
    if (name === 'poster' && this.poster && !this.#isShown) this.#picture(this.#absolute(this.poster), '');
    this.#controls.bar.hidden = !this.controls || !show;
    this.#controls.set(this.rate, this.hasAttribute('captions'));
    if (!show) return;
    if (name === 'rate') show.player.speed = this.rate;
    if (name === 'view') show.stage.look(this.view);
    if (name === 'camera-controls') show.stage.isMovable = this.hasAttribute('camera-controls');
    if (name === 'loop' && this.#isShown) show.player.setLoop(this.hasAttribute('loop') ? { from: 0, to: show.player.duration } : null);
  }

  #change(): void {
    const { player } = this.show!;
    const fire = (name: string, detail: unknown = null) => this.dispatchEvent(new CustomEvent(name, { detail }));
    this.#controls.at(player, this.#known);
    this.changed();
    if (player.playing !== this.#wasPlaying) {
      this.#wasPlaying = player.playing;
      if (player.playing) fire('play');
      else fire(player.frame === player.frames - 1 ? 'ended' : 'pause');
    }
    const begun = this.#known.findLastIndex(({ start }) => player.time >= start - 1e-6);
    const from = player.playing && begun > this.#word ? this.#word + 1 : begun; // slow frames pass over short words
    if (begun !== this.#word) for (const word of this.#known.slice(Math.max(from, 0), begun + 1)) fire('word', word);
    this.#word = begun;
  }

  /** Write the texts in the language of the page.
   * @internal */
  relabel(): void {
    this.#controls.label(this.#language);
    if (!this.#isShown) this.#canvas.ariaLabel = this.#translate('stage');
  }

  get #language(): Language {
    const code = (this.closest<HTMLElement>('[lang]')?.lang || navigator.language).slice(0, 2).toLowerCase();
    return isLanguage(code) ? code : 'en';
  }

  #translate(key: 'stage' | 'flat'): string {
    return translateTo(this.#language, key);
  }
}

/** The events of a player are typed. */
export interface SignPlayer {
  addEventListener<Name extends keyof SignPlayerEventMap>(
    type: Name, listener: (this: SignPlayer, event: SignPlayerEventMap[Name]) => unknown, options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(type: string, listener: EventListenerOrEventListenerObject, options?: boolean | AddEventListenerOptions): void;
}

declare global {
  interface HTMLElementTagNameMap {
    'sign-player': SignPlayer;
  }
}

if (globalThis.customElements && !customElements.get('sign-player')) customElements.define('sign-player', SignPlayer);
