/**
 * A long sentence as the service streams it. Words are sent only while little motion lies ahead of what plays: a player that is
 * paused holds the service back. Each part is fitted to the avatar with some frames of the part before, and blended into it.
 */

import { Quaternion, Vector3 } from 'three';
import { decode } from './bytes.js';
import { translate } from './languages.js';
import { Person } from './person.js';
import { Service } from './service.js';
import { bareScene } from './source.js';
import { Signer } from './take.js';
import type { SentenceToken, ServiceMessage, SkeletonMessage, Spliced } from './wire.js';

/** Words that are fetched as one sentence; more are streamed. */
export const MOST_AT_ONCE = 12;
const AHEAD_S = 5; // motion that is there before it is played
const IN_FLIGHT = 4; // words that were sent and are not signed yet
const PATIENCE_MS = 2000; // a word may have no sign, such as a mark alone
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
}

export class SentenceStream {
  private readonly scene: Spliced;
  private poses: Pose[] = []; // those that are not shown, and some before them
  private first = 0; // number of the first of them
  private fps = 30;
  private errors: string[] = [];
  private seen = 0; // words that are signed, or are none
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
    socket.onopen = () => (socket.send(JSON.stringify({ type: 'open', paced: false })), (isOpen = true), wake());
    socket.onmessage = ({ data }) => (inbox.push(data as string | ArrayBuffer), wake());
    socket.onclose = () => ((isClosed = true), wake());
    this.signal.addEventListener('abort', () => socket.close());
    let person: Person | null = null;
    let [sent, sentAt, shown] = [0, performance.now(), 0];
    try {
      while (!isDone) {
        this.signal.throwIfAborted();
        const waited = performance.now() - sentAt;
        const isNeeded = this.end / this.fps - played() < AHEAD_S && (sent < this.seen + IN_FLIGHT || waited > PATIENCE_MS);
        if (isOpen && !isClosed && sent <= this.line.length && (isNeeded || waited > KEEP_MS)) {
          const gloss = this.line[sent++];
          socket.send(JSON.stringify(gloss === undefined ? { type: 'end' } : { type: 'word', gloss }));
          sentAt = performance.now();
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
    const { files, fit } = await new Service(this.address).sentence({ glosses: this.line.slice(0, 1), formats: ['glb', 'vrma'] }, this.signal);
    const glb = decode(files.glb!);
    return { glb, signer: await Signer.read(glb, fit) };
  }

  /** The number of the frame after the last that has come. */
  private get end(): number {
    return this.first + this.poses.length;
  }

  /** Read a message; whether it was the last. */
  private read(message: string | ArrayBuffer, signer: Signer): boolean {
    if (typeof message !== 'string') {
      this.poses.push(...this.skeleton!.poses(message));
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
    } else if (said.type === 'unit') this.scene.units.push(said.unit);
    else if (said.type === 'seam') report.seams.push(said.seam);
    else if (said.type === 'warning') report.warnings.push(said.warning);
    else if (said.type === 'error') {
      this.errors.push(said.error);
      this.seen++;
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
    return signer.take(worlds, hips, Float32Array.from(this.poses, (_, k) => (this.first + k) / this.fps));
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
    return { worlds, hips: hips.clone().sub(from).applyQuaternion(turn).add(to) };
  }

  /** The figure's first frame is the stream's: it stands at the origin and faces the camera. */
  private place(turn: Quaternion, from: Vector3) {
    const worlds = this.joints.map(() => new Float64Array(4));
    const to = new Float64Array(3);
    this.signer.pose(0, worlds, to, 0);
    return { turn: new Quaternion().fromArray(worlds[0]!).multiply(turn.clone().invert()), from: from.clone(), to: new Vector3().fromArray(to) };
  }
}
