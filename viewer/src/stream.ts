/**
 * A long sentence as the service streams it. Text is sent a phrase at a time, and only while little motion lies ahead of what plays:
 * a player that is paused holds the service back. Each part is fitted to the avatar with some frames of the part before, and blended into it.
 */

import { Quaternion, Vector3 } from 'three';
import { decode } from './bytes.js';
import { translate } from './languages.js';
import { Person } from './person.js';
import { replaced } from './scene.js';
import { Service } from './service.js';
import { bareScene } from './source.js';
import { Signer } from './take.js';
import type { EndMessage, FaceMessage, OpenMessage, SentenceRequest, SentenceToken, ServiceMessage, SkeletonMessage, Spliced, TextMessage } from './wire.js';

/** Words that are fetched as one sentence; more are streamed. */
export const MOST_AT_ONCE = 12;
const AHEAD_S = 5; // motion that is there before it is played
const IN_FLIGHT = 4; // words and letters that were read and are not signed yet
const SETTLE_MS = 100; // after the last of the units of a text, which come together
const PHRASE = 12; // words, up to a full stop, that are sent at once; fewer of a longer phrase
const PIECE = 8;
const KEEP_MS = 60_000; // the service ends a stream in which nothing comes for two minutes
const PART = 60; // frames that are shown together
const OVERLAP = 24; // frames that are fitted twice
const HEADER = 16; // bytes before the frames of a message

/** What has come of a sentence. */
export interface Part {
  scene: Spliced;
  person: Person;
  /** Lines about words that were left out. */
  errors: string[];
  isLast: boolean;
}

/** The bones of a frame in the world's axes, and where the hips are. */
interface Pose {
  worlds: Float64Array;
  hips: Vector3;
  /** ARKit's coefficients that are not 0. */
  face: ReadonlyMap<string, number>;
}

export class SentenceStream {
  private readonly scene: Spliced;
  private poses: Pose[] = []; // those that are not shown, and some before them
  private first = 0; // number of the first of them
  private fps = 30;
  private errors: string[] = [];
  private known = 0; // words and letters of units
  private seen = 0; // of these, signed
  private readAt: number | null = 0; // when that of what was sent last came; null: none yet
  private unread = ''; // text that was sent last
  private again = ''; // of which this is to be sent again, without words that are unknown
  private face: FaceMessage | null = null; // of the frames that follow
  private readonly channels = new Set<string>();
  private skeleton: Skeleton | null = null;

  constructor(
    private readonly address: string,
    private readonly line: string[],
    private readonly avatar: Uint8Array<ArrayBuffer> | null,
    private readonly signal: AbortSignal,
  ) {
    this.scene = bareScene(line.join(' '), 30, 1);
  }

  /** The sentence, part by part; ``played``: seconds of it that have been played. */
  async *parts(played: () => number): AsyncGenerator<Part> {
    const { glb, signer } = await this.figure();
    const socket = new WebSocket(new URL('v1/stream', this.address.replace(/\/?$/, '/')).href.replace(/^http/, 'ws'));
    socket.binaryType = 'arraybuffer';
    const inbox: (string | ArrayBuffer)[] = [];
    let [isOpen, isClosed, isDone] = [false, false, false];
    let wake = () => {};
    const send = (message: OpenMessage | TextMessage | EndMessage) => socket.send(JSON.stringify(message));
    socket.onopen = () => (send({ type: 'open', paced: false, face_rules: true }), (isOpen = true), wake());
    socket.onmessage = ({ data }) => (inbox.push(data as string | ArrayBuffer), wake());
    socket.onclose = () => ((isClosed = true), wake());
    this.signal.addEventListener('abort', () => socket.close());
    let person: Person | null = null;
    let [sent, sentAt, shown, hasEnded] = [0, performance.now(), 0, false];
    try {
      while (!isDone) {
        this.signal.throwIfAborted();
        const waited = performance.now() - sentAt;
        const isRead = this.readAt !== null && performance.now() - this.readAt > SETTLE_MS;
        const isNeeded = this.end / this.fps - played() < AHEAD_S && isRead && this.known < this.seen + IN_FLIGHT;
        if (isOpen && !isClosed && !hasEnded && (this.again || isNeeded || waited > KEEP_MS)) {
          const size = this.again ? 0 : await this.phrase(sent);
          const text = this.again || this.line.slice(sent, sent + size).join(' ');
          send((hasEnded = !text) ? { type: 'end' } : { type: 'text', text });
          [sent, sentAt, this.unread, this.again, this.readAt] = [sent + size, performance.now(), text, '', null];
          continue;
        }
        const message = inbox.shift();
        if (message === undefined) {
          if (isClosed) throw new Error(this.errors.at(-1) ?? translate('lost'));
          await new Promise<void>((done) => ((wake = done), setTimeout(done, 100)));
          continue;
        }
        isDone = this.read(message, signer);
        if (this.end - shown < PART && !isDone) continue;
        const overlap = Math.min(OVERLAP, shown);
        this.forget(shown - overlap);
        const take = this.take(signer);
        if (!person) person = await Person.avatar(this.avatar ?? glb, take, this.avatar ? null : signer.body);
        else if (this.end > shown) await person.extend(take, overlap);
        shown = this.scene.report.frames = this.end;
        yield { scene: this.scene, person, errors: this.errors.splice(0), isLast: isDone };
      }
    } finally {
      socket.close();
    }
  }

  /** The figure of the lexicon, by the first word. */
  private async figure(): Promise<{ glb: Uint8Array<ArrayBuffer>; signer: Signer }> {
    const request = { glosses: this.line.slice(0, 1), whole_face: true, formats: ['glb', 'vrma'] } satisfies SentenceRequest;
    const { files, fit } = await new Service(this.address).sentence(request, this.signal);
    const glb = decode(files.glb!);
    return { glb, signer: await Signer.read(glb, fit) };
  }

  /** The number of the frame after the last that has come. */
  private get end(): number {
    return this.first + this.poses.length;
  }

  /** How many words from a number on are sent at once: up to the end of a phrase, else up to a place within no compound. */
  private async phrase(from: number): Promise<number> {
    const words = this.line.slice(from, from + PHRASE + 1);
    const end = words.findLastIndex((word, k) => k < PHRASE && /[.!?]$/.test(word)) + 1;
    if (end || words.length <= PIECE) return end || words.length;
    const service = new Service(this.address);
    for (let size = PIECE; size > 1; size--) {
      const pair = `${words[size - 1]}-${words[size]}`;
      const mayBeOne = /^[\p{L}\p{N}'-]+$/u.test(pair) && (await service.words(pair, 1, this.signal)).total;
      if (!mayBeOne) return size;
    }
    return PIECE;
  }

  /** Read a message; whether it was the last. */
  private read(message: string | ArrayBuffer, signer: Signer): boolean {
    if (typeof message !== 'string') {
      const poses = this.skeleton!.poses(message);
      const { first = -1, channels = [], weights = [] } = this.face ?? {};
      if (first === this.end) weights.forEach((row, k) => (poses[k]!.face = new Map(channels.map((name, n) => [name, row[n]!]))));
      this.poses.push(...poses);
      return false;
    }
    const said = JSON.parse(message) as ServiceMessage | { type: 'unit'; unit: SentenceToken };
    const { report } = this.scene;
    if (said.type === 'skeleton') {
      this.fps = report.fps = said.fps;
      this.skeleton = new Skeleton(said, signer);
    } else if (said.type === 'span') {
      report.spans.push(said.span);
      if (said.span.kind === 'sign') this.seen++;
    } else if (said.type === 'unit') {
      if (said.unit.warning && !said.unit.glosses.length) this.errors.push(said.unit.warning);
      this.scene.units.push(said.unit);
      this.known += said.unit.glosses.length;
      this.readAt = performance.now();
    } else if (said.type === 'face') {
      this.face = said;
      for (const name of said.channels) this.channels.add(name);
    } else if (said.type === 'seam') report.seams.push(said.seam);
    else if (said.type === 'warning') report.warnings.push(said.warning);
    else if (said.type === 'error') {
      this.errors.push(said.error);
      this.readAt = performance.now();
      this.known = this.seen; // the rest of the text was left out
      const rest = Object.keys(said.unknown).reduce((text, word) => replaced(text, word, ''), this.unread).trim();
      this.again = rest === this.unread ? '' : rest;
    }
    return said.type === 'done';
  }

  private forget(before: number): void {
    this.poses.splice(0, before - this.first);
    this.first = before;
  }

  private take(signer: Signer) {
    const worlds = signer.bones.map((_, k) => Float64Array.from(this.poses.flatMap((pose) => [...pose.worlds.subarray(4 * k, 4 * k + 4)])));
    const hips = Float64Array.from(this.poses.flatMap((pose) => pose.hips.toArray()));
    const faces = new Map([...this.channels].map((name) => [name, Float32Array.from(this.poses, ({ face }) => face.get(name) ?? 0)]));
    return signer.take(worlds, hips, Float32Array.from(this.poses, (_, k) => (this.first + k) / this.fps), faces);
  }
}

/** The skeleton of a stream, placed as the figure stands. */
class Skeleton {
  private readonly joints: number[];
  private placed: { turn: Quaternion; from: Vector3; to: Vector3 } | null = null;

  constructor(private readonly message: SkeletonMessage, private readonly signer: Signer) {
    this.joints = signer.names.map((name) => message.names.indexOf(name));
    if (this.joints.includes(-1)) throw new Error('the stream has another skeleton than its first word');
  }

  /** The poses in a binary message of frames. */
  poses(message: ArrayBuffer): Pose[] {
    const n = this.message.names.length;
    const frames = new DataView(message).getUint32(8, true);
    const rows = new Float32Array(message, HEADER);
    return Array.from({ length: frames }, (_, frame) => this.pose(rows.subarray(frame * (3 + 4 * n), (frame + 1) * (3 + 4 * n))));
  }

  private pose(row: Float32Array): Pose {
    const { parents, offsets, metres } = this.message;
    const turns: Quaternion[] = [];
    const places: Vector3[] = [];
    parents.forEach((parent, joint) => {
      const turn = new Quaternion().fromArray(row, 3 + 4 * joint);
      turns.push(parent < 0 ? turn : turn.premultiply(turns[parent]!));
      const place = parent < 0 ? new Vector3().fromArray(row) : new Vector3(...offsets[joint]!).applyQuaternion(turns[parent]!).add(places[parent]!);
      places.push(place);
    });
    const hips = places[this.joints[0]!]!.multiplyScalar(metres);
    this.placed ??= this.place(turns[this.joints[0]!]!, hips);
    const { turn, from, to } = this.placed;
    const worlds = new Float64Array(4 * this.joints.length);
    this.joints.forEach((joint, k) => new Quaternion().multiplyQuaternions(turn, turns[joint]!).toArray(worlds, 4 * k));
    return { worlds, hips: hips.clone().sub(from).applyQuaternion(turn).add(to), face: new Map() };
  }

  /** The figure's first frame is the stream's: it stands at the origin and faces the camera. */
  private place(turn: Quaternion, from: Vector3) {
    const worlds = this.joints.map(() => new Float64Array(4));
    const to = new Float64Array(3);
    this.signer.pose(0, worlds, to, 0);
    return { turn: new Quaternion().fromArray(worlds[0]!).multiply(turn.clone().invert()), from: from.clone(), to: new Vector3().fromArray(to) };
  }
}
