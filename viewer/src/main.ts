/** The page: what was put into it or what the service makes is shown, played, compared and taken away. */

import { decode, download, fileName } from './bytes.js';
import * as dials from './dials.js';
import { find } from './dom.js';
import { onFiles } from './dropping.js';
import * as films from './film.js';
import * as keys from './keys.js';
import { type Language, say, speak, wanted } from './languages.js';
import * as panel from './panel.js';
import { Person } from './person.js';
import { Player } from './player.js';
import { caption, plain, seams } from './scene.js';
import { SentenceBox } from './sentence.js';
import * as service from './service.js';
import { Stage, type View } from './stage.js';
import { TimeLine } from './timeline.js';
import type { Format, Spliced } from './wire.js';

interface Given {
  scenes: Spliced[];
  live: boolean;
}

/** What is shown was made of glosses or of files; so can be made again with other dials. */
type Source = { glosses: string[] } | { files: File[] };

const AROUND_S = 0.5; // what a seam's loop shows before and after it
const FORMATS: Format[] = ['glb', 'bvh', 'vrma'];
const FIRST = ['HELLO', 'MY', 'NAME'];
const UNTOUCHED = document.documentElement.outerHTML; // what a saved page is made of

const given = JSON.parse(find('#signsplice').textContent) as Given | null;
const live = given?.live ?? false;

class App {
  private scenes: Spliced[] = given?.scenes ?? [];
  private source: Source | null = null;
  private avatar: { name: string; bytes: Uint8Array<ArrayBuffer> } | null = null;
  private people: Person[] = [];
  private asked: AbortController | null = null;
  private shows = 0; // of show(): one that is overtaken leaves nothing behind
  private last = performance.now();
  private dirty = true;
  private filming = false;

  private readonly stage = new Stage(find('#stage canvas'), () => (this.dirty = true));
  private readonly player = new Player(() => this.moved());
  private readonly line = new TimeLine(find('#time'), {
    frame: (frame) => this.player.seek(frame),
    seam: (seam) => this.loop(seam),
  });
  private readonly box = new SentenceBox(find('#sentence'), (glosses) => void this.make({ glosses }));

  async start(): Promise<void> {
    document.body.classList.toggle('is-live', live);
    this.wire();
    this.turn(wanted());
    new ResizeObserver(() => this.stage.resize()).observe(find('#stage'));
    requestAnimationFrame((now) => this.tick(now));
    if (live) await dials.offer();
    if (this.scenes.length) await this.show(this.scenes);
    else if (live) await this.greet();
  }

  // --- what is shown ---

  private async greet(): Promise<void> {
    const asked = new URLSearchParams(location.search).get('s')?.split(/\s+/).filter(Boolean);
    if (asked?.length) {
      this.box.glosses = asked;
      return this.make({ glosses: asked });
    }
    const known = await Promise.all(FIRST.map((gloss) => service.words(gloss, 1)));
    const mine = known.every(({ words }, k) => words[0]?.gloss === FIRST[k]);
    const first = mine ? FIRST : (await service.words('', 3)).words.map(({ gloss }) => gloss);
    this.box.glosses = first;
    await this.make({ glosses: first });
  }

  /** Ask the service for what the source and the dials say, and for the same by another method where one is beside. */
  private async make(source: Source): Promise<void> {
    if (this.filming) return;
    this.asked?.abort();
    const asked = (this.asked = new AbortController());
    this.busy(true);
    try {
      const made = await Promise.all(
        dials.wishes().map((wish) =>
          'glosses' in source
            ? service.sentence({ ...wish, glosses: source.glosses, formats: FORMATS }, asked.signal)
            : service.splice(source.files, { ...wish, formats: FORMATS }, asked.signal),
        ),
      );
      this.source = source;
      this.alert('');
      await this.show(made);
    } catch (error) {
      if (!asked.signal.aborted) this.alert(told(error));
    } finally {
      if (this.asked === asked) this.busy(false);
    }
  }

  private async show(scenes: Spliced[]): Promise<void> {
    const turn = ++this.shows;
    const people = await Promise.all(scenes.map((scene) => this.person(scene)));
    if (turn !== this.shows || this.filming) {
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
    this.fill();
    this.status(say('shown', { name: scenes[0]!.name, frames, seconds: (frames / fps).toFixed(2) }));
    find('#stage').dataset['ready'] = String(Number(find('#stage').dataset['ready'] ?? 0) + 1);
    if (!matchMedia('(prefers-reduced-motion: reduce)').matches) this.player.play();
  }

  private async person(scene: Spliced): Promise<Person> {
    const { glb, vrma } = scene.files;
    if (this.avatar && vrma) return Person.avatar(this.avatar.bytes, decode(vrma));
    if (!glb) throw new Error(say('noFile', { file: 'GLB' }));
    return Person.mannequin(decode(glb));
  }

  private async take(files: File[]): Promise<void> {
    if (this.filming) return;
    const suffix = (file: File) => file.name.toLowerCase().replace(/^.*(?=\.)/, '');
    const stranger = files.find((file) => !['.bvh', '.glb', '.vrma', '.vrm'].includes(suffix(file)));
    if (stranger) return this.alert(say('notRead', { name: stranger.name }));
    const avatar = files.find((file) => suffix(file) === '.vrm');
    const clips = files.filter((file) => file !== avatar);
    if (avatar) await this.wear(avatar);
    if (!clips.length) return;
    if (!live) return this.alert(say('needsService'));
    this.box.glosses = [];
    await this.make({ files: clips });
  }

  private async wear(file: File): Promise<void> {
    const before = this.avatar;
    if (this.scenes.some((scene) => !scene.files.vrma)) return this.alert(say('noVrma'));
    try {
      const bytes = new Uint8Array(await file.arrayBuffer());
      await Person.checkAvatar(bytes);
      this.avatar = { name: file.name, bytes };
      if (this.scenes.length) await this.show(this.scenes);
      this.alert('');
    } catch (error) {
      this.avatar = before;
      this.alert(say('noAvatar', { name: file.name, why: told(error) }));
    }
  }

  // --- time ---

  private tick(now: number): void {
    const seconds = Math.min(0.25, (now - this.last) / 1000);
    this.last = now;
    if (!this.filming) {
      this.player.tick(seconds);
      if (this.dirty) this.draw(this.player.playing ? seconds : 0);
    }
    requestAnimationFrame((next) => this.tick(next));
  }

  /** A second side whose seams lie elsewhere is led to the same seam, at the same speed. */
  private timeOf(side: number): number {
    const { loop, time } = this.player;
    if (!side || !loop || this.looped === null) return time;
    const [own, other] = [0, side].map((k) => {
      const { report } = this.scenes[k]!;
      const seam = seams(report)[this.looped!];
      return seam && seam.from / report.fps;
    });
    return own === undefined || other === undefined ? time : time + other - own;
  }

  private draw(seconds: number): void {
    if (!this.people.length) return;
    this.people.forEach((person, side) => person.at(this.timeOf(side)));
    this.stage.follow(seconds);
    this.stage.draw();
    this.dirty = false;
  }

  private looped: number | null = null;

  /** Go over a seam again and again; null: over nothing. */
  private loop(seam: number | null): void {
    const at = seam === null ? undefined : seams(this.scenes[0]!.report)[seam];
    this.looped = at ? seam : null;
    const { fps } = this.player;
    this.player.over(at ? { from: at.from / fps - AROUND_S, to: at.to / fps + AROUND_S } : null);
    if (at) this.player.play();
  }

  private seamBy(by: number): void {
    const all = this.scenes[0] ? seams(this.scenes[0].report) : [];
    if (!all.length) return;
    const { frame } = this.player;
    const after = all.findIndex((seam) => seam.to > frame);
    const here = this.looped ?? (after < 0 ? all.length : after) - (by > 0 ? 1 : 0);
    this.loop((here + by + all.length) % all.length);
  }

  private moved(): void {
    this.dirty = true;
    const { frame, playing, loop } = this.player;
    if (!loop) this.looped = null;
    this.line.at(frame, playing);
    const button = find<HTMLButtonElement>('#play');
    button.textContent = playing ? '❚❚' : '▶';
    button.ariaLabel = button.title = say(playing ? 'pause' : 'play');
    find<HTMLSelectElement>('#loop').value = this.looped !== null ? String(this.looped) : loop ? 'all' : '';
    document.querySelectorAll<HTMLElement>('.side').forEach((side, k) => {
      const scene = this.scenes[k];
      if (!scene) return;
      const at = Math.min(scene.report.frames - 1, Math.max(0, Math.floor(this.timeOf(k) * scene.report.fps + 1e-6)));
      const { parts, between } = caption(scene, at);
      const place = side.querySelector<HTMLElement>('.caption')!;
      place.classList.toggle('between', between);
      const middle = document.createElement(parts[0] || parts[2] ? 'b' : 'span');
      middle.textContent = parts[1];
      place.replaceChildren(parts[0], middle, parts[2]);
    });
  }

  // --- what is taken away ---

  private fill(): void {
    const [scene] = this.scenes;
    if (!scene) return;
    this.line.show(scene, this.player.frames);
    panel.show(this.scenes, (seam) => this.loop(seam));
    this.moved();
  }

  private async save(file: string): Promise<void> {
    const [scene] = this.scenes;
    if (!scene) return;
    const name = fileName(scene.name);
    if (file === 'report') return download(`${name}.json`, JSON.stringify(scene.report, null, 2), 'application/json');
    if (file === 'page') return download(`${name}.html`, saved(this.scenes), 'text/html');
    if (file === 'film') return this.film(name);
    const content = scene.files[file as Format];
    if (content) download(`${name}.${file}`, decode(content), file === 'bvh' ? 'text/plain' : 'model/gltf-binary');
  }

  private async film(name: string): Promise<void> {
    const { frames, fps } = this.player;
    const { width, height } = films.SIZE;
    const mirrored = find('#stage').classList.contains('mirrored');
    const captioned = !document.body.classList.contains('no-captions');
    const [people, scenes] = [this.people, this.scenes];
    const held = ['header', '#time', '#controls', 'aside'].map((query) => find(query));
    this.player.pause();
    this.filming = true;
    for (const part of held) part.inert = true; // what is filmed must not change meanwhile
    this.busy(true);
    try {
      await this.stage.sized(width, height, async () => {
        const made = await films.film(
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
              const said = caption(scene, Math.min(report.frames - 1, Math.floor((frame / fps) * report.fps + 1e-6)));
              const place = mirrored ? scenes.length - 1 - k : k; // sides change places in the mirror
              films.write(pen, plain(said), said.between, ((place + 0.5) * width) / scenes.length);
            });
          },
          // Not every frame: what is written here is read aloud.
          (done) => done % Math.ceil(frames / 10) || this.status(say('filming', { done, total: frames })),
        );
        if (made) download(`${name}.${made.suffix}`, made.bytes, `video/${made.suffix}`);
        else this.alert(say('noFilm'));
      });
    } catch (error) {
      this.alert(told(error));
    } finally {
      this.filming = false;
      for (const part of held) part.inert = false;
      this.busy(false);
      this.status('');
      this.dirty = true;
    }
  }

  // --- the page ---

  private turn(chosen: Language): void {
    speak(chosen);
    find<HTMLSelectElement>('#language').value = chosen;
    keys.tell();
    dials.tell();
    this.fill();
  }

  private wire(): void {
    const on = (query: string, event: string, act: (target: HTMLInputElement) => void) =>
      document.querySelectorAll<HTMLInputElement>(query).forEach((one) => one.addEventListener(event, () => act(one)));
    on('#play', 'click', () => this.toggle());
    on('#back', 'click', () => this.player.step(-1));
    on('#on', 'click', () => this.player.step(1));
    on('#speed', 'change', ({ value }) => (this.player.speed = Number(value)));
    on('#loop', 'change', ({ value }) => {
      this.loop(value === '' || value === 'all' ? null : Number(value));
      if (value === 'all') this.player.over({ from: 0, to: this.player.duration });
    });
    on('[data-view]', 'click', (button) => this.look(button.dataset['view'] as View));
    on('#mirror', 'click', () => this.mirror());
    on('#captions', 'click', (button) => {
      button.ariaPressed = String(!document.body.classList.toggle('no-captions'));
    });
    on('#language', 'change', ({ value }) => {
      this.turn(value as Language);
      if (live) void dials.offer();
    });
    on('[data-file]', 'click', (button) => void this.save(button.dataset['file']!));
    onFiles((files) => void this.take(files));
    dials.onChange(() => this.source && void this.make(this.source));
    keys.listen({
      toggle: () => this.toggle(),
      step: (frames) => this.player.step(frames),
      seam: (by) => this.seamBy(by),
      unloop: () => this.loop(null),
      mirror: () => this.mirror(),
      look: (view) => this.look(view),
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
  }

  private mirror(): void {
    find('#mirror').ariaPressed = String(find('#stage').classList.toggle('mirrored'));
    // Sides change places in the mirror; their names must too.
    find('.sides').style.flexDirection = find('#stage').classList.contains('mirrored') ? 'row-reverse' : '';
  }

  private look(view: View): void {
    this.stage.look(view);
    document.querySelectorAll<HTMLElement>('[data-view]').forEach((one) => (one.ariaPressed = String(one.dataset['view'] === view)));
  }

  private busy(on: boolean): void {
    find('#stage').classList.toggle('busy', on && !this.filming);
    find('#stage').ariaBusy = String(on);
    if (on && !this.filming) this.status(say('loading'));
  }

  private status(text: string): void {
    find('#status').textContent = text;
  }

  private alert(text: string): void {
    const place = find('#alert');
    place.textContent = text;
    place.hidden = !text;
    if (text) this.status('');
  }
}

/** A saved page: this one as it came, with what is shown in it, and no service. */
function saved(scenes: Spliced[]): string {
  const told = JSON.stringify({ scenes, live: false } satisfies Given).replaceAll('<', '\\u003c');
  const mark = /(<script type="application\/json" id="signsplice">)[^<]*/;
  return '<!doctype html>\n' + UNTOUCHED.replace(mark, (_, open: string) => open + told);
}

function told(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** What goes wrong before the page can say so itself. */
function lost(error: unknown): void {
  const place = find('#alert');
  place.textContent = `${say('broken')} ${told(error)}`;
  place.hidden = false;
}

try {
  new App().start().catch(lost);
} catch (error) {
  speak(wanted()); // no WebGL, as a rule: the page at least speaks
  lost(error);
}
