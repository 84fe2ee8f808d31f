/** The page: it shows, plays, compares and downloads the scenes that it holds or gets from the service. */

import type { Looks } from './address.js';
import { decode, download, fileName } from './bytes.js';
import * as dials from './dials.js';
import { find } from './dom.js';
import { onFiles } from './dropping.js';
import * as films from './film.js';
import * as keys from './keys.js';
import { type Language, preferred, setLanguage, translate } from './languages.js';
import { Loader } from './loader.js';
import { alert, messageOf, status } from './messages.js';
import * as panel from './panel.js';
import type { Person } from './person.js';
import type { Player } from './player.js';
import { caption, leftOut, plain, seams, spelled, titleOf } from './scene.js';
import { SentenceBox } from './sentence.js';
import { own } from './service.js';
import type { Show } from './show.js';
import type { SignPlayer, View } from './sign_player.js';
import './sign_player.js';
import { TimeLine } from './timeline.js';
import { type Format, MEDIA_TYPES, type Spliced } from './wire.js';

/** The content of the page's JSON element. */
interface PageContent {
  scenes: Spliced[];
  live: boolean;
}

const ORIGINAL_PAGE = document.documentElement.outerHTML; // a saved page is made of it

const content = JSON.parse(find('#signsplice').textContent) as PageContent | null;
const live = content?.live ?? false;

class App {
  private readonly figure = find<SignPlayer>('sign-player');
  private readonly line = new TimeLine(find('#time'), {
    frame: (frame) => this.player.seek(frame),
    seam: (seam) => this.stage.loop(seam),
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
    this.figure.changed = () => this.showTime();
    this.addListeners();
    this.setLanguage(preferred());
    document.body.classList.toggle('is-flat', !this.figure.show);
    await this.loader.start();
  }

  // --- scenes ---

  private show(scenes: Spliced[], people: Person[]): void {
    if (this.figure.show) this.figure.present(scenes, people);
    this.fillPage();
    const [scene] = scenes as [Spliced];
    const { frames, fps } = scene.report;
    const { avatar } = this.loader;
    const words = spelled(scene).join(', ');
    const without = leftOut(scene).join(', ');
    const name = titleOf(scene);
    const parts = [
      words && translate('spelled', { words }),
      without && translate('leftOut', { words: without }),
      translate('shown', { name, frames, seconds: (frames / fps).toFixed(2) }),
      avatar && translate(people[0]!.isCopied ? 'copied' : 'fitted', { avatar: avatar.name }),
    ];
    status(parts.filter(Boolean).join(translate('and')));
    document.title = `${name} – signsplice`;
    find('#stage').dataset['ready'] = String(Number(find('#stage').dataset['ready'] ?? 0) + 1);
    if (!this.figure.show) void this.figure.flat(scene.units.map(({ token }) => token), live ? own : null);
    else if (!matchMedia('(prefers-reduced-motion: reduce)').matches) this.figure.play();
  }

  private get stage(): Show {
    return this.figure.show!;
  }

  private get player(): Player {
    return this.stage.player;
  }

  private get scenes(): Spliced[] {
    return this.loader.scenes;
  }

  private looks(): Looks {
    const view = find<HTMLElement>('[data-view][aria-pressed=true]').dataset['view'] as View;
    return { view, isMirrored: this.figure.mirrored, hasCaptions: this.figure.captions };
  }

  private setLooks(looks: Looks): void {
    this.figure.rate = Number(find<HTMLSelectElement>('#speed').value);
    this.look(looks.view);
    if (looks.isMirrored !== this.figure.mirrored) this.mirror();
    if (looks.hasCaptions !== this.figure.captions) this.toggleCaptions();
  }

  // --- time ---

  private loopNext(by: number): void {
    const all = this.scenes[0] ? seams(this.scenes[0].report) : [];
    if (!all.length) return;
    const { frame } = this.player;
    const after = all.findIndex((seam) => seam.to > frame);
    const current = this.stage.looped ?? (after < 0 ? all.length : after) - (by > 0 ? 1 : 0);
    this.stage.loop((current + by + all.length) % all.length);
  }

  /** Show the player's state in the time line and the controls. */
  private showTime(): void {
    if (!this.figure.show) return;
    const { frame, playing, loop } = this.player;
    const { looped } = this.stage;
    this.line.at(frame, playing);
    const button = find<HTMLButtonElement>('#play');
    button.textContent = playing ? '❚❚' : '▶';
    button.ariaLabel = button.title = translate(playing ? 'pause' : 'play');
    find<HTMLSelectElement>('#loop').value = looped !== null ? String(looped) : loop ? 'all' : '';
  }

  /** Fill the time line and the panel. */
  private fillPage(): void {
    const [scene] = this.scenes;
    if (!scene) return;
    const { show } = this.figure;
    this.line.show(scene, show?.player.frames ?? scene.report.frames);
    panel.show(this.scenes, (seam) => this.stage.loop(seam));
    this.figure.nameSides(panel.sideNames(this.scenes));
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
    const { mirrored, captions } = this.figure;
    const { people, scenes, stage } = this.stage;
    const disabled = ['header', '#time', '#controls', 'aside'].map((query) => find(query));
    this.loader.lock();
    for (const part of disabled) part.inert = true; // the scene must not change meanwhile
    find('#stage').ariaBusy = 'true';
    try {
      await this.stage.hold(width, height, async () => {
        const film = await films.film(
          frames,
          fps,
          (pen, frame) => {
            people.forEach((person) => person.at(frame / fps));
            stage.follow(1 / fps);
            stage.draw();
            pen.setTransform(mirrored ? -1 : 1, 0, 0, 1, mirrored ? width : 0, 0);
            pen.drawImage(stage.renderer.domElement, 0, 0, width, height);
            pen.setTransform(1, 0, 0, 1, 0, 0);
            if (!captions) return;
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
      this.loader.unlock();
      for (const part of disabled) part.inert = false;
      find('#stage').ariaBusy = 'false';
      status('');
    }
  }

  // --- the page ---

  private setLanguage(chosen: Language): void {
    setLanguage(chosen);
    find<HTMLSelectElement>('#language').value = chosen;
    this.figure.relabel();
    keys.showHelp();
    dials.showValues();
    this.fillPage();
  }

  private addListeners(): void {
    const on = (query: string, event: string, act: (target: HTMLInputElement) => void) =>
      document.querySelectorAll<HTMLInputElement>(query).forEach((one) => one.addEventListener(event, () => act(one)));
    on('#play', 'click', () => this.stage.toggle());
    on('#back', 'click', () => this.player.step(-1));
    on('#on', 'click', () => this.player.step(1));
    on('#speed', 'change', () => this.faster(0));
    on('#loop', 'change', ({ value }) => {
      this.stage.loop(value === '' || value === 'all' ? null : Number(value));
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
    if (!this.figure.show) return;
    keys.listen({
      toggle: () => this.stage.toggle(),
      step: (frames) => this.player.step(frames),
      seam: (by) => this.loopNext(by),
      unloop: () => this.stage.loop(null),
      mirror: () => find('#mirror').click(),
      look: (view) => find(`[data-view=${view}]`).click(),
      faster: (by) => this.faster(by),
    });
  }

  private faster(by: number): void {
    const select = find<HTMLSelectElement>('#speed');
    select.selectedIndex = Math.max(0, Math.min(select.options.length - 1, select.selectedIndex + by));
    this.figure.rate = Number(select.value);
    this.loader.writeAddress();
  }

  private toggleCaptions(): void {
    find('#captions').ariaPressed = String(this.figure.toggleAttribute('captions'));
  }

  private mirror(): void {
    find('#mirror').ariaPressed = String(this.figure.toggleAttribute('mirrored'));
  }

  private look(view: View): void {
    this.figure.view = view;
    this.figure.show?.stage.look(view); // also where the user has moved the camera since
    document.querySelectorAll<HTMLElement>('[data-view]').forEach((one) => (one.ariaPressed = String(one.dataset['view'] === view)));
  }
}

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

new App().start().catch(showStartError);
