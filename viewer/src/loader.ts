/** What the page shows: scenes of the service or of the page itself, with the people who sign them. What was asked for last is
 * shown; what it overtakes is aborted and has no effect.
 */

import * as address from './address.js';
import * as dials from './dials.js';
import { FORMATS, SUFFIXES } from './dropping.js';
import { language, translate } from './languages.js';
import { alert, busy, messageOf } from './messages.js';
import { checkAvatar } from './humanoid.js';
import type { Person } from './person.js';
import type { SentenceBox } from './sentence.js';
import { own, ServiceError } from './service.js';
import { isStill, onAvatar, personOf, sourceOf } from './source.js';
import type { Spliced } from './wire.js';

/** Where the scene came from, to request it again with other dials. */
type Source = { glosses: string[] } | { files: File[] };

/** Whether the address of what is shown becomes a new entry of the history, or replaces the present one. */
type Entry = 'new' | 'same';

/** The page's other parts. */
interface Page {
  /** Show scenes that are loaded. */
  show(scenes: Spliced[], people: Person[]): void;
  /** Set what the address holds besides the sentence and the dials. */
  setLooks(looks: address.Looks): void;
  looks(): address.Looks;
}

const FIRST_GLOSSES = ['HELLO', 'MY', 'NAME'];
const MANY = 400; // words of a lexicon, from which examples are taken

export class Loader {
  avatar: { name: string; bytes: Uint8Array<ArrayBuffer> } | null = null;
  scenes: Spliced[]; // shown, or those that the page came with
  private readonly sources: Source[] = []; // what was shown, for the history's entries
  private source: Source | null = null; // of what is shown
  private wanted: { source: Source; entry: Entry } | null = null; // being loaded
  private searched = ''; // the address's part that was read or written last
  private ready = Promise.resolve(); // the dials have their lists and the address's values
  private task: AbortController | null = null;
  private running = Promise.resolve();
  private isLocked = false;

  constructor(
    private readonly page: Page,
    private readonly box: SentenceBox,
    private readonly embedded: Spliced[],
    private readonly isLive: boolean,
  ) {
    this.scenes = embedded;
  }

  start(): Promise<void> {
    if (this.isLive) this.ready = dials.listMethods().then(() => void this.read());
    addEventListener('popstate', () => {
      const isShown = !this.wanted && this.source !== null && this.sources[address.current() ?? -1] === this.source;
      const isLink = address.current() === null; // within the page
      if (location.search !== this.searched || !(isShown || isLink)) void this.open();
    });
    return this.open();
  }

  /** Show another sentence, or the splice of other files. */
  load(source: Source, entry: Entry): Promise<void> {
    return this.run((signal) => this.request(source, entry, signal));
  }

  /** Load what is shown, or about to be, with the present dials. */
  reload(): void {
    const { source, entry } = this.wanted ?? { source: this.source, entry: 'same' };
    if (source) void this.load(source, entry);
  }

  /** Splice clips; put an avatar in the mannequin's place. */
  async openFiles(files: File[]): Promise<void> {
    if (this.isLocked) return;
    const suffix = (file: File) => file.name.toLowerCase().replace(/^.*(?=\.)/, '');
    const unreadable = files.find((file) => !SUFFIXES.includes(suffix(file)));
    if (unreadable) return alert(translate('notRead', { name: unreadable.name }));
    const avatar = await avatarIn(files);
    const clips = files.filter((file) => file !== avatar);
    if (avatar) await this.loadAvatar(avatar);
    if (!clips.length) return;
    if (!this.isLive) return alert(translate('needsService'));
    await this.load({ files: clips }, 'new');
    if (this.source && 'files' in this.source && this.source.files === clips) this.box.glosses = []; // what was typed stays after an error
  }

  /** Keep what is shown until ``unlock``. */
  lock(): void {
    this.task?.abort();
    this.task = this.wanted = null;
    this.isLocked = true;
    busy(false);
  }

  unlock(): void {
    this.isLocked = false;
  }

  /** Write the address of what is shown; while something else is loaded, that will write its own. */
  writeAddress(entry: Entry = 'same'): void {
    if (!this.isLive || !this.source || this.wanted) return;
    const known = this.sources.indexOf(this.source);
    const number = known < 0 ? this.sources.push(this.source) - 1 : known;
    const glosses = 'glosses' in this.source ? this.source.glosses : [];
    address.write({ glosses, ...this.page.looks() }, number, entry === 'new');
    this.searched = location.search;
  }

  /** Run ``work``, which loads something, in place of what was loaded so far. */
  private run(work: (signal: AbortSignal) => Promise<void>): Promise<void> {
    if (this.isLocked) return Promise.resolve();
    this.task?.abort();
    this.wanted = null;
    return (this.running = this.attempt(work, (this.task = new AbortController())));
  }

  private async attempt(work: (signal: AbortSignal) => Promise<void>, task: AbortController): Promise<void> {
    busy(true);
    try {
      await work(task.signal);
    } catch (error) {
      if (task.signal.aborted) return;
      alert((await advice(error)) ?? messageOf(error));
      this.box.offer(error instanceof ServiceError ? Object.entries(error.failure.unknown) : []);
    } finally {
      if (this.task === task) {
        this.task = this.wanted = null;
        busy(false);
      }
    }
  }

  /** Set the controls as the address says; its glosses. */
  private read(): string[] {
    const { glosses, ...looks } = address.read();
    dials.showValues();
    this.page.setLooks(looks);
    this.searched = location.search;
    return glosses;
  }

  /** Show what the page's address holds, else the scenes that the page holds, else the first glosses. */
  private open(): Promise<void> {
    if (!this.isLive && !this.embedded.length) return Promise.resolve();
    return this.run(async (signal) => {
      await this.ready;
      signal.throwIfAborted();
      if (!this.isLive) return this.showEmbedded(signal);
      const glosses = this.read();
      const source = this.sources[address.current() ?? -1] ?? (glosses.length ? { glosses } : null);
      this.box.glosses = source && 'glosses' in source ? source.glosses : [];
      if (source) return this.request(source, 'same', signal);
      this.source = null;
      if (this.embedded.length) return this.showEmbedded(signal);
      const first = await firstGlosses(signal);
      if (!this.box.glosses.length) this.box.glosses = first; // else someone is typing
      await this.request({ glosses: first }, 'same', signal);
    });
  }

  /** Request the source's scene with the dials' options; and with a second method, if one is chosen to compare. */
  private async request(source: Source, entry: Entry, signal: AbortSignal): Promise<void> {
    this.wanted = { source, entry };
    await this.ready;
    signal.throwIfAborted();
    const scenes = await own.withAvatar(this.avatar, signal, (avatar) =>
      Promise.all(
        dials.requested().map((options) =>
          'glosses' in source
            ? own.sentence({ ...options, avatar, glosses: source.glosses, face_rules: true, formats: FORMATS }, signal)
            : own.splice(source.files, { ...options, avatar, formats: FORMATS }, signal),
        ),
      ),
    );
    await this.show(scenes, signal);
    this.source = source;
    this.wanted = null;
    alert('');
    this.box.offer(scenes[0]!.units.map(({ token, suggestions }) => [token, suggestions]));
    this.writeAddress(entry);
  }

  private async show(scenes: Spliced[], signal: AbortSignal): Promise<void> {
    const made = await Promise.allSettled(scenes.map(async (scene) => this.person(scene)));
    const people = made.flatMap((one) => (one.status === 'fulfilled' ? [one.value] : []));
    const failure = made.find((one) => one.status === 'rejected');
    if (signal.aborted || failure) {
      for (const person of people) person.dispose();
      signal.throwIfAborted();
      throw failure!.reason;
    }
    this.scenes = scenes;
    this.page.show(scenes, people);
  }

  /** Show the scenes that the page came with. */
  private async showEmbedded(signal: AbortSignal): Promise<void> {
    const { avatar, embedded, isLive } = this;
    const fitted = async (scene: Spliced) => (avatar && isLive ? (await onAvatar(sourceOf(scene), avatar, own, signal)).scene! : scene);
    await this.show(await Promise.all(embedded.map(fitted)), signal);
  }

  /** The person who signs a scene: a service has fitted it to an avatar, or nothing does. */
  private person(scene: Spliced): Promise<Person> {
    const avatar = this.isLive ? null : this.avatar;
    if (!avatar && !scene.files.glb) throw new Error(translate('noFile', { file: 'GLB' }));
    return personOf(sourceOf(scene), avatar?.bytes ?? null);
  }

  private async loadAvatar(file: File): Promise<void> {
    const rejected = (error: unknown) => translate('noAvatar', { name: file.name, why: messageOf(error) });
    let bytes: Uint8Array<ArrayBuffer>;
    try {
      bytes = new Uint8Array(await file.arrayBuffer());
      await checkAvatar(bytes);
    } catch (error) {
      return alert(rejected(error));
    }
    while (this.task) await this.running; // what is being loaded is shown first
    if (!this.isLive && this.scenes.some((scene) => !scene.files.vrma)) return alert(translate('noVrma'));
    await this.run(async (signal) => {
      const previous = this.avatar;
      const avatar = (this.avatar = { name: file.name, bytes });
      try {
        if (this.source) await this.request(this.source, 'same', signal);
        else if (this.scenes.length) await this.showEmbedded(signal);
        alert('');
      } catch (error) {
        signal.throwIfAborted();
        if (this.avatar === avatar) this.avatar = previous;
        throw new Error(rejected(error));
      }
    });
  }
}

/** On a page in Chinese: what can be typed, where words are Chinese. */
async function advice(error: unknown): Promise<string | null> {
  const words = error instanceof ServiceError ? Object.keys(error.failure.unknown).filter((word) => /\p{Script=Han}/u.test(word)) : [];
  if (language() !== 'zh' || !words.length) return null;
  const found = await own.words('', MANY).catch(() => null);
  const examples = found?.words.filter(({ kind }) => kind === 'sign').map(({ gloss }) => gloss) ?? FIRST_GLOSSES;
  const some = [0, 1, 2, 3, 4].map((k) => examples[Math.floor((k * examples.length) / 5)]!);
  return translate('typable', { words: words.join('、'), examples: some.join('、') });
}

/** The file that is an avatar: a .vrm, or a .glb that does not move. */
async function avatarIn(files: File[]): Promise<File | undefined> {
  for (const file of files) {
    const name = file.name.toLowerCase();
    if (name.endsWith('.vrm') || (name.endsWith('.glb') && isStill(new Uint8Array(await file.arrayBuffer())))) return file;
  }
  return undefined;
}

async function firstGlosses(signal: AbortSignal): Promise<string[]> {
  const found = await Promise.all(FIRST_GLOSSES.map((gloss) => own.words(gloss, 1, signal)));
  if (found.every(({ words }, k) => words[0]?.gloss === FIRST_GLOSSES[k])) return FIRST_GLOSSES;
  return (await own.words('', 3, signal)).words.map(({ gloss }) => gloss);
}
