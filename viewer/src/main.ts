/** The page: it shows, plays, compares and downloads the scenes that it holds or gets from the service. */

import * as address from './address.js';
import { decode, download, fileName } from './bytes.js';
import * as dials from './dials.js';
import { find } from './dom.js';
import { FORMATS, onFiles, SUFFIXES } from './dropping.js';
import * as films from './film.js';
import { FrameTiming } from './frame_timing.js';
import * as keys from './keys.js';
import { type Language, preferred, setLanguage, translate } from './languages.js';
import * as panel from './panel.js';
import { Person } from './person.js';
import { Player } from './player.js';
import { caption, plain, seams, titleOf } from './scene.js';
import { SentenceBox } from './sentence.js';
import * as service from './service.js';
import { Stage, type View } from './stage.js';
import { TimeLine } from './timeline.js';
import { type Format, MEDIA_TYPES, type Spliced } from './wire.js';

/** The content of the page's JSON element. */
interface PageContent {
  scenes: Spliced[];
  live: boolean;
}

/** Where the scene came from, to request it again with other dials. */
type Source = { glosses: string[] } | { files: File[] };

const LOOP_MARGIN_S = 0.5; // shown before and after a looped seam
const FIRST_GLOSSES = ['HELLO', 'MY', 'NAME'];
const ORIGINAL_PAGE = document.documentElement.outerHTML; // a saved page is made of it

const content = JSON.parse(find('#signsplice').textContent) as PageContent | null;
const live = content?.live ?? false;

class App {
  private scenes: Spliced[] = content?.scenes ?? [];
  private sources: Source[] = []; // what was shown, for the history's entries
  private source: Source | null = null;
  private avatar: { name: string; bytes: Uint8Array<ArrayBuffer> } | null = null;
  private people: Person[] = [];
  private request: AbortController | null = null;
  private nShown = 0; // calls of show(); one that a later one overtakes has no effect
  private last = performance.now();
  private dirty = true;
  private filming = false;

  private readonly timing = new FrameTiming(() => this.stage.lighten());
  private readonly stage = new Stage(find('#stage canvas'), () => (this.dirty = true));
  private readonly player = new Player(() => this.showTime());
  private readonly line = new TimeLine(find('#time'), {
    frame: (frame) => this.player.seek(frame),
    seam: (seam) => this.loop(seam),
  });
  private readonly box = new SentenceBox(find('#sentence'), (glosses) => void this.load({ glosses }, 'new'));

  async start(): Promise<void> {
    document.body.classList.toggle('is-live', live);
    this.addListeners();
    this.setLanguage(preferred());
    new ResizeObserver(() => this.stage.resize()).observe(find('#stage'));
    requestAnimationFrame((now) => this.tick(now));
    if (live) await dials.listMethods();
    await this.loadAddressed();
  }

  // --- scenes ---

  /** Show what the page's address holds, else the scenes that the page holds, else the first glosses. */
  private async loadAddressed(): Promise<void> {
    if (!live) return content?.scenes.length ? this.show(content.scenes) : undefined;
    const { glosses, ...shown } = address.read();
    dials.showValues();
    this.player.speed = Number(find<HTMLSelectElement>('#speed').value);
    this.look(shown.view);
    if (shown.isMirrored !== isMirrored()) this.mirror();
    if (shown.hasCaptions !== hasCaptions()) this.toggleCaptions();
    this.searched = location.search;
    const source = this.sources[address.current() ?? -1] ?? (glosses.length ? { glosses } : null);
    if (source) {
      this.box.glosses = 'glosses' in source ? source.glosses : [];
      return this.load(source);
    }
    if (content?.scenes.length) {
      this.source = null;
      this.box.glosses = [];
      return this.show(content.scenes);
    }
    const found = await Promise.all(FIRST_GLOSSES.map((gloss) => service.words(gloss, 1)));
    const hasAll = found.every(({ words }, k) => words[0]?.gloss === FIRST_GLOSSES[k]);
    const first = hasAll ? FIRST_GLOSSES : (await service.words('', 3)).words.map(({ gloss }) => gloss);
    this.box.glosses = first;
    await this.load({ glosses: first });
  }

  /**
   * Request the source's scene with the dials' options; and with a second method, if one is chosen to compare.
   * ``entry``: whether the address of what is shown becomes a new entry of the history, or replaces the present one.
   */
  private async load(source: Source, entry: 'new' | 'same' = 'same'): Promise<void> {
    if (this.filming) return;
    this.request?.abort();
    const request = (this.request = new AbortController());
    this.busy(true);
    try {
      const scenes = await Promise.all(
        dials.requested().map((options) =>
          'glosses' in source
            ? service.sentence({ ...options, glosses: source.glosses, formats: FORMATS }, request.signal)
            : service.splice(source.files, { ...options, formats: FORMATS }, request.signal),
        ),
      );
      this.source = source;
      this.alert('');
      this.box.offer(scenes[0]!.units.map(({ token, suggestions }) => [token, suggestions]));
      this.writeAddress(entry === 'new');
      await this.show(scenes);
    } catch (error) {
      if (request.signal.aborted) return;
      this.alert(messageOf(error));
      this.box.offer(error instanceof service.ServiceError ? Object.entries(error.failure.unknown) : []);
    } finally {
      if (this.request === request) this.busy(false);
    }
  }

  private searched = ''; // the address's part that was read or written last

  private writeAddress(isNew = false): void {
    if (!live || !this.source) return;
    const known = this.sources.indexOf(this.source);
    const number = known < 0 ? this.sources.push(this.source) - 1 : known;
    const glosses = 'glosses' in this.source ? this.source.glosses : [];
    const view = find<HTMLElement>('[data-view][aria-pressed=true]').dataset['view'] as View;
    address.write({ glosses, view, isMirrored: isMirrored(), hasCaptions: hasCaptions() }, number, isNew);
    this.searched = location.search;
  }

  private async show(scenes: Spliced[]): Promise<void> {
    const number = ++this.nShown;
    const people = await Promise.all(scenes.map((scene) => this.person(scene)));
    if (number !== this.nShown || this.filming) {
      for (const person of people) person.dispose();
      return;
    }
    this.scenes = scenes;
    this.people = people;
    this.looped = null;
    this.stage.show(people);
    const { frames, fps } = scenes[0]!.report;
    const seconds = Math.max(...scenes.map(({ report }) => (report.frames - 1) / report.fps));
    this.player.open(Math.round(seconds * fps) + 1, fps);
    this.fillPage();
    const fitted = people[0]!.fitted?.isMoved && this.avatar ? translate('fitted', { avatar: this.avatar.name }) : '';
    this.status(translate('shown', { name: titleOf(scenes[0]!), frames, seconds: (frames / fps).toFixed(2) }) + fitted);
    document.title = `${titleOf(scenes[0]!)} – signsplice`;
    find('#stage').dataset['ready'] = String(Number(find('#stage').dataset['ready'] ?? 0) + 1);
    if (!matchMedia('(prefers-reduced-motion: reduce)').matches) this.player.play();
  }

  private async person(scene: Spliced): Promise<Person> {
    const { glb, vrma } = scene.files;
    if (this.avatar && vrma) return Person.avatar(this.avatar.bytes, decode(vrma), scene.fit);
    if (!glb) throw new Error(translate('noFile', { file: 'GLB' }));
    return Person.mannequin(decode(glb));
  }

  private async openFiles(files: File[]): Promise<void> {
    if (this.filming) return;
    const suffix = (file: File) => file.name.toLowerCase().replace(/^.*(?=\.)/, '');
    const unreadable = files.find((file) => !SUFFIXES.includes(suffix(file)));
    if (unreadable) return this.alert(translate('notRead', { name: unreadable.name }));
    const avatar = files.find((file) => suffix(file) === '.vrm');
    const clips = files.filter((file) => file !== avatar);
    if (avatar) await this.loadAvatar(avatar);
    if (!clips.length) return;
    if (!live) return this.alert(translate('needsService'));
    this.box.glosses = [];
    await this.load({ files: clips }, 'new');
  }

  private async loadAvatar(file: File): Promise<void> {
    const previous = this.avatar;
    if (this.scenes.some((scene) => !scene.files.vrma)) return this.alert(translate('noVrma'));
    try {
      const bytes = new Uint8Array(await file.arrayBuffer());
      await Person.checkAvatar(bytes);
      this.avatar = { name: file.name, bytes };
      if (this.scenes.length) await this.show(this.scenes);
      this.alert('');
    } catch (error) {
      this.avatar = previous;
      this.alert(translate('noAvatar', { name: file.name, why: messageOf(error) }));
    }
  }

  // --- time ---

  private tick(now: number): void {
    const elapsed = (now - this.last) / 1000;
    const seconds = Math.min(0.25, elapsed);
    this.last = now;
    if (!this.filming) {
      if (this.player.playing) this.timing.frame(elapsed, this.stage.late);
      else this.timing.forget();
      this.player.tick(seconds);
      if (this.dirty) this.draw(this.player.playing ? seconds : 0);
    }
    requestAnimationFrame((next) => this.tick(next));
  }

  /** The time to show on a side, seconds. In a loop the second side shows the same seam at its own time. */
  private timeOf(side: number): number {
    const { loop, time } = this.player;
    if (!side || !loop || this.looped === null) return time;
    const [first, second] = [0, side].map((k) => {
      const { report } = this.scenes[k]!;
      const seam = seams(report)[this.looped!];
      return seam && seam.from / report.fps;
    });
    return first === undefined || second === undefined ? time : time + second - first;
  }

  private draw(seconds: number): void {
    if (!this.people.length) return;
    this.people.forEach((person, side) => person.at(this.timeOf(side)));
    this.stage.follow(seconds);
    this.stage.draw();
    this.dirty = false;
  }

  private looped: number | null = null;

  /** Loop a seam; null: stop looping. */
  private loop(seam: number | null): void {
    const at = seam === null ? undefined : seams(this.scenes[0]!.report)[seam];
    this.looped = at ? seam : null;
    const { fps } = this.player;
    this.player.setLoop(at ? { from: at.from / fps - LOOP_MARGIN_S, to: at.to / fps + LOOP_MARGIN_S } : null);
    if (at) this.player.play();
  }

  private loopNext(by: number): void {
    const all = this.scenes[0] ? seams(this.scenes[0].report) : [];
    if (!all.length) return;
    const { frame } = this.player;
    const after = all.findIndex((seam) => seam.to > frame);
    const current = this.looped ?? (after < 0 ? all.length : after) - (by > 0 ? 1 : 0);
    this.loop((current + by + all.length) % all.length);
  }

  /** Show the player's state in the time line, the controls and the captions. */
  private showTime(): void {
    this.dirty = true;
    const { frame, playing, loop } = this.player;
    if (!loop) this.looped = null;
    this.line.at(frame, playing);
    const button = find<HTMLButtonElement>('#play');
    button.textContent = playing ? '❚❚' : '▶';
    button.ariaLabel = button.title = translate(playing ? 'pause' : 'play');
    find<HTMLSelectElement>('#loop').value = this.looped !== null ? String(this.looped) : loop ? 'all' : '';
    document.querySelectorAll<HTMLElement>('.side').forEach((side, k) => {
      const scene = this.scenes[k];
      if (!scene) return;
      const at = Math.min(scene.report.frames - 1, Math.max(0, Math.floor(this.timeOf(k) * scene.report.fps + 1e-6)));
      const { parts, inTransition } = caption(scene, at);
      const element = side.querySelector<HTMLElement>('.caption')!;
      element.classList.toggle('in-transition', inTransition);
      const middle = document.createElement(parts[0] || parts[2] ? 'b' : 'span');
      middle.textContent = parts[1];
      element.replaceChildren(parts[0], middle, parts[2]);
    });
  }

  /** Fill the time line and the panel. */
  private fillPage(): void {
    const [scene] = this.scenes;
    if (!scene) return;
    this.line.show(scene, this.player.frames);
    const beyond = this.people.flatMap(({ fitted }) => (fitted ? panel.reachWarnings(fitted.beyond) : []));
    panel.show(this.scenes, beyond, (seam) => this.loop(seam));
    this.showTime();
  }

  // --- downloads ---

  private async save(file: string): Promise<void> {
    const [scene] = this.scenes;
    if (!scene) return;
    const name = fileName(scene.name);
    if (file === 'report') return download(`${name}.json`, JSON.stringify(scene.report, null, 2), 'application/json');
    if (file === 'page') return download(`${name}.html`, savedPage(this.scenes), 'text/html');
    if (file === 'film') return this.film(name);
    const content = scene.files[file as Format];
    if (content) download(`${name}.${file}`, decode(content), MEDIA_TYPES[file as Format]);
  }

  private async film(name: string): Promise<void> {
    const { frames, fps } = this.player;
    const { width, height } = films.SIZE;
    const mirrored = isMirrored();
    const captioned = hasCaptions();
    const [people, scenes] = [this.people, this.scenes];
    const disabled = ['header', '#time', '#controls', 'aside'].map((query) => find(query));
    this.player.pause();
    this.filming = true;
    for (const part of disabled) part.inert = true; // the scene must not change meanwhile
    this.busy(true);
    try {
      await this.stage.sized(width, height, async () => {
        const film = await films.film(
          frames,
          fps,
          (pen, frame) => {
            people.forEach((person) => person.at(frame / fps));
            this.stage.follow(1 / fps);
            this.stage.draw();
            pen.setTransform(mirrored ? -1 : 1, 0, 0, 1, mirrored ? width : 0, 0);
            pen.drawImage(this.stage.renderer.domElement, 0, 0, width, height);
            pen.setTransform(1, 0, 0, 1, 0, 0);
            if (!captioned) return;
            scenes.forEach((scene, k) => {
              const { report } = scene;
              const shown = caption(scene, Math.min(report.frames - 1, Math.floor((frame / fps) * report.fps + 1e-6)));
              const side = mirrored ? scenes.length - 1 - k : k; // mirroring swaps the sides
              films.drawCaption(pen, plain(shown), shown.inTransition, ((side + 0.5) * width) / scenes.length);
            });
          },
          // Not every frame, since screen readers read the status aloud.
          (done) => done % Math.ceil(frames / 10) || this.status(translate('filming', { done, total: frames })),
        );
        if (film) download(`${name}.${film.suffix}`, film.bytes, `video/${film.suffix}`);
        else this.alert(translate('noFilm'));
      });
    } catch (error) {
      this.alert(messageOf(error));
    } finally {
      this.filming = false;
      for (const part of disabled) part.inert = false;
      this.busy(false);
      this.status('');
      this.dirty = true;
    }
  }

  // --- the page ---

  private setLanguage(chosen: Language): void {
    setLanguage(chosen);
    find<HTMLSelectElement>('#language').value = chosen;
    keys.showHelp();
    dials.showValues();
    this.fillPage();
  }

  private addListeners(): void {
    const on = (query: string, event: string, act: (target: HTMLInputElement) => void) =>
      document.querySelectorAll<HTMLInputElement>(query).forEach((one) => one.addEventListener(event, () => act(one)));
    on('#play', 'click', () => this.toggle());
    on('#back', 'click', () => this.player.step(-1));
    on('#on', 'click', () => this.player.step(1));
    on('#speed', 'change', () => this.faster(0));
    on('#loop', 'change', ({ value }) => {
      this.loop(value === '' || value === 'all' ? null : Number(value));
      if (value === 'all') this.player.setLoop({ from: 0, to: this.player.duration });
    });
    on('[data-view]', 'click', (button) => this.look(button.dataset['view'] as View));
    on('#mirror', 'click', () => this.mirror());
    on('[data-view], #mirror, #captions', 'click', () => this.writeAddress());
    addEventListener('popstate', () => {
      const isShown = this.source !== null && this.sources[address.current() ?? -1] === this.source;
      const isLink = address.current() === null; // within the page
      if (location.search !== this.searched || !(isShown || isLink)) void this.loadAddressed();
    });
    on('#captions', 'click', () => this.toggleCaptions());
    on('#language', 'change', ({ value }) => {
      this.setLanguage(value as Language);
      if (live) void dials.listMethods();
    });
    on('[data-file]', 'click', (button) => void this.save(button.dataset['file']!));
    onFiles((files) => void this.openFiles(files));
    dials.onChange(() => this.source && void this.load(this.source));
    keys.listen({
      toggle: () => this.toggle(),
      step: (frames) => this.player.step(frames),
      seam: (by) => this.loopNext(by),
      unloop: () => this.loop(null),
      mirror: () => find('#mirror').click(),
      look: (view) => find(`[data-view=${view}]`).click(),
      faster: (by) => this.faster(by),
    });
  }

  private toggle(): void {
    if (this.player.playing) this.player.pause();
    else this.player.play();
  }

  private faster(by: number): void {
    const select = find<HTMLSelectElement>('#speed');
    select.selectedIndex = Math.max(0, Math.min(select.options.length - 1, select.selectedIndex + by));
    this.player.speed = Number(select.value);
    this.writeAddress();
  }

  private toggleCaptions(): void {
    find('#captions').ariaPressed = String(!document.body.classList.toggle('no-captions'));
  }

  private mirror(): void {
    find('#mirror').ariaPressed = String(find('#stage').classList.toggle('mirrored'));
    // Mirroring swaps the sides, so their names are swapped too.
    find('.sides').style.flexDirection = isMirrored() ? 'row-reverse' : '';
  }

  private look(view: View): void {
    this.stage.look(view);
    document.querySelectorAll<HTMLElement>('[data-view]').forEach((one) => (one.ariaPressed = String(one.dataset['view'] === view)));
  }

  private busy(on: boolean): void {
    find('#stage').classList.toggle('busy', on && !this.filming);
    find('#stage').ariaBusy = String(on);
    if (on && !this.filming) this.status(translate('loading'));
  }

  private status(text: string): void {
    const element = find('#status');
    element.textContent = element.title = text; // the line may be too short for it
  }

  private alert(text: string): void {
    const element = find('#alert');
    element.textContent = text;
    element.hidden = !text;
    if (text) this.status('');
  }
}

const isMirrored = () => find('#stage').classList.contains('mirrored');
const hasCaptions = () => !document.body.classList.contains('no-captions');

/** This page as it was loaded, with the scenes in it and without a service. */
function savedPage(scenes: Spliced[]): string {
  const json = JSON.stringify({ scenes, live: false } satisfies PageContent).replaceAll('<', '\\u003c');
  const element = /(<script type="application\/json" id="signsplice">)[^<]*/;
  return '<!doctype html>\n' + ORIGINAL_PAGE.replace(element, (_, open: string) => open + json);
}

function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** Show an error of the start, before the page can show anything else. */
function showStartError(error: unknown): void {
  const element = find('#alert');
  element.textContent = `${translate('broken')} ${messageOf(error)}`;
  element.hidden = false;
}

try {
  new App().start().catch(showStartError);
} catch (error) {
  setLanguage(preferred()); // usually WebGL is missing; the texts at least are shown
  showStartError(error);
}
