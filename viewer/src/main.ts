/** The page: it shows, plays, compares and downloads the scenes that it holds or gets from the service. */

import type { Looks } from './address.js';
import { decode, download, fileName } from './bytes.js';
import * as dials from './dials.js';
import { find } from './dom.js';
import { onFiles } from './dropping.js';
import * as films from './film.js';
import { FrameTiming } from './frame_timing.js';
import * as keys from './keys.js';
import { type Language, preferred, setLanguage, translate } from './languages.js';
import { Loader } from './loader.js';
import { alert, messageOf, status } from './messages.js';
import * as panel from './panel.js';
import type { Person } from './person.js';
import { Player } from './player.js';
import { caption, plain, seams, titleOf } from './scene.js';
import { SentenceBox } from './sentence.js';
import { Stage, type View } from './stage.js';
import { TimeLine } from './timeline.js';
import { type Format, MEDIA_TYPES, type Spliced } from './wire.js';

/** The content of the page's JSON element. */
interface PageContent {
  scenes: Spliced[];
  live: boolean;
}

const LOOP_MARGIN_S = 0.5; // shown before and after a looped seam
const ORIGINAL_PAGE = document.documentElement.outerHTML; // a saved page is made of it

const content = JSON.parse(find('#signsplice').textContent) as PageContent | null;
const live = content?.live ?? false;

class App {
  private people: Person[] = [];
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
  private readonly box = new SentenceBox(find('#sentence'), (glosses) => void this.loader.load({ glosses }, 'new'));
  private readonly loader = new Loader(
    {
      show: (scenes, people) => this.show(scenes, people),
      setLooks: (looks) => this.setLooks(looks),
      looks: () => this.looks(),
    },
    this.box,
    content?.scenes ?? [],
    live,
  );

  async start(): Promise<void> {
    document.body.classList.toggle('is-live', live);
    this.addListeners();
    this.setLanguage(preferred());
    new ResizeObserver(() => this.stage.resize()).observe(find('#stage'));
    requestAnimationFrame((now) => this.tick(now));
    await this.loader.start();
  }

  // --- scenes ---

  private show(scenes: Spliced[], people: Person[]): void {
    this.people = people;
    this.looped = null;
    this.stage.show(people);
    const { frames, fps } = scenes[0]!.report;
    const seconds = Math.max(...scenes.map(({ report }) => (report.frames - 1) / report.fps));
    this.player.open(Math.round(seconds * fps) + 1, fps);
    this.fillPage();
    const { avatar } = this.loader;
    const fitted = people[0]!.fitted?.isMoved && avatar ? translate('fitted', { avatar: avatar.name }) : '';
    status(translate('shown', { name: titleOf(scenes[0]!), frames, seconds: (frames / fps).toFixed(2) }) + fitted);
    document.title = `${titleOf(scenes[0]!)} – signsplice`;
    find('#stage').dataset['ready'] = String(Number(find('#stage').dataset['ready'] ?? 0) + 1);
    if (!matchMedia('(prefers-reduced-motion: reduce)').matches) this.player.play();
  }

  private get scenes(): Spliced[] {
    return this.loader.scenes;
  }

  private looks(): Looks {
    const view = find<HTMLElement>('[data-view][aria-pressed=true]').dataset['view'] as View;
    return { view, isMirrored: isMirrored(), hasCaptions: hasCaptions() };
  }

  private setLooks(looks: Looks): void {
    this.player.speed = Number(find<HTMLSelectElement>('#speed').value);
    this.look(looks.view);
    if (looks.isMirrored !== isMirrored()) this.mirror();
    if (looks.hasCaptions !== hasCaptions()) this.toggleCaptions();
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
    this.loader.lock();
    for (const part of disabled) part.inert = true; // the scene must not change meanwhile
    find('#stage').ariaBusy = 'true';
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
          (done) => done % Math.ceil(frames / 10) || status(translate('filming', { done, total: frames })),
        );
        if (film) download(`${name}.${film.suffix}`, film.bytes, `video/${film.suffix}`);
        else alert(translate('noFilm'));
      });
    } catch (error) {
      alert(messageOf(error));
    } finally {
      this.filming = false;
      this.loader.unlock();
      for (const part of disabled) part.inert = false;
      find('#stage').ariaBusy = 'false';
      status('');
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
    on('[data-view], #mirror, #captions', 'click', () => this.loader.writeAddress());
    on('#captions', 'click', () => this.toggleCaptions());
    on('#language', 'change', ({ value }) => {
      this.setLanguage(value as Language);
      if (live) void dials.listMethods();
    });
    on('[data-file]', 'click', (button) => void this.save(button.dataset['file']!));
    onFiles((files) => void this.loader.openFiles(files));
    dials.onChange(() => this.loader.reload());
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
    this.loader.writeAddress();
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
}

const isMirrored = () => find('#stage').classList.contains('mirrored');
const hasCaptions = () => !document.body.classList.contains('no-captions');

/** This page as it was loaded, with the scenes in it and without a service. */
function savedPage(scenes: Spliced[]): string {
  const json = JSON.stringify({ scenes, live: false } satisfies PageContent).replaceAll('<', '\\u003c');
  const element = /(<script type="application\/json" id="signsplice">)[^<]*/;
  return '<!doctype html>\n' + ORIGINAL_PAGE.replace(element, (_, open: string) => open + json);
}

/** Show an error of the start, before the page can show anything else. */
function showStartError(error: unknown): void {
  alert(`${translate('broken')} ${messageOf(error)}`);
}

try {
  new App().start().catch(showStartError);
} catch (error) {
  setLanguage(preferred()); // usually WebGL is missing; the texts at least are shown
  showStartError(error);
}
