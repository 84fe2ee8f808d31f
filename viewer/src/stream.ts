/**
 * A long sentence as the service streams it. Text is sent a phrase at a time, and only while little motion lies ahead of what plays:
 * a player that is paused holds the service back.
 */

import { type KeyframeTrack, Mesh, NumberKeyframeTrack, type Object3D, Quaternion, QuaternionKeyframeTrack, Vector3, VectorKeyframeTrack } from 'three';
import { decode } from './bytes.js';
import { translate } from './languages.js';
import { Person } from './person.js';
import { replaced } from './scene.js';
import type { Avatar, Service } from './service.js';
import { bareScene } from './source.js';
import type { EndMessage, FaceMessage, OpenMessage, SentenceToken, ServiceMessage, SkeletonMessage, Spliced, TextMessage } from './wire.js';

/** Words that are fetched as one sentence; more are streamed. */
export const MOST_AT_ONCE = 12;
const AHEAD_S = 5; // motion that is there before it is played
const IN_FLIGHT = 4; // words and letters that were read and are not signed yet
const SETTLE_MS = 100; // after the last of the units of a text, which come together
const PHRASE = 12; // words, up to a full stop, that are sent at once; fewer of a longer phrase
const PIECE = 8;
const KEEP_MS = 60_000; // the service ends a stream in which nothing comes for two minutes
const PART = 60; // frames that are shown together
const HEADER = 16; // bytes before the frames of a message

/** What has come of a sentence. */
export interface Part {
  scene: Spliced;
  person: Person;
  /** Lines about words that were left out. */
  errors: string[];
  isLast: boolean;
}

/** A frame as the service sends it, and the channels of its face that are not 0. */
interface Frame {
  row: Float32Array;
  face: ReadonlyMap<string, number>;
}

export class SentenceStream {
  private readonly scene: Spliced;
  private frames: Frame[] = []; // that are not shown yet
  private shown = 0; // number of those before
  private fps = 30;
  private errors: string[] = [];
  private known = 0; // words and letters of units
  private seen = 0; // of these, signed
  private readAt: number | null = 0; // when that of what was sent last came; null: none yet
  private unread = ''; // text that was sent last
  private again = ''; // of which this is to be sent again, without words that are unknown
  private face: FaceMessage | null = null; // of the frames that follow
  private skeleton: SkeletonMessage | null = null;

  constructor(
    private readonly service: Service,
    private readonly line: string[],
    private readonly avatar: Avatar | null,
    private readonly signal: AbortSignal,
  ) {
    this.scene = bareScene(line.join(' '), 30, 1);
  }

  /** The sentence, part by part; ``played``: seconds of it that have been played. */
  async *parts(played: () => number): AsyncGenerator<Part> {
    const { person, avatar } = await this.figure();
    const socket = new WebSocket(this.service.streams);
    socket.binaryType = 'arraybuffer';
    const inbox: (string | ArrayBuffer)[] = [];
    let [isOpen, isClosed, isDone] = [false, false, false];
    let wake = () => {};
    const send = (message: OpenMessage | TextMessage | EndMessage) => socket.send(JSON.stringify(message));
    socket.onopen = () => (send({ type: 'open', paced: false, face_rules: true, avatar }), (isOpen = true), wake());
    socket.onmessage = ({ data }) => (inbox.push(data as string | ArrayBuffer), wake());
    socket.onclose = () => ((isClosed = true), wake());
    this.signal.addEventListener('abort', () => socket.close());
    let figure: Figure | null = null;
    let [sent, sentAt, hasEnded] = [0, performance.now(), false];
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
        isDone = this.read(message);
        if (this.frames.length < PART && !isDone) continue;
        if (this.frames.length) {
          figure ??= new Figure(person, this.skeleton!);
          person.play(figure.tracks(this.frames.splice(0), this.shown / this.fps, this.fps), this.shown > 0);
        }
        this.shown = this.scene.report.frames;
        yield { scene: this.scene, person, errors: this.errors.splice(0), isLast: isDone };
      }
    } finally {
      socket.close();
    }
  }

  /** The figure that signs, by the first word, and the id of its avatar. */
  private async figure(): Promise<{ person: Person; avatar: string | null }> {
    const request = { glosses: this.line.slice(0, 1), whole_face: true, formats: ['glb' as const] };
    return this.service.withAvatar(this.avatar, this.signal, async (avatar) => {
      const { files } = await this.service.sentence({ ...request, avatar }, this.signal);
      return { person: await Person.mannequin(decode(files.glb!)), avatar };
    });
  }

  /** The number of the frame after the last that has come. */
  private get end(): number {
    return this.shown + this.frames.length;
  }

  /** How many words from a number on are sent at once: up to the end of a phrase, else up to a place within no compound. */
  private async phrase(from: number): Promise<number> {
    const words = this.line.slice(from, from + PHRASE + 1);
    const end = words.findLastIndex((word, k) => k < PHRASE && /[.!?]$/.test(word)) + 1;
    if (end || words.length <= PIECE) return end || words.length;
    for (let size = PIECE; size > 1; size--) {
      const pair = `${words[size - 1]}-${words[size]}`;
      const mayBeOne = /^[\p{L}\p{N}'-]+$/u.test(pair) && (await this.service.words(pair, 1, this.signal)).total;
      if (!mayBeOne) return size;
    }
    return PIECE;
  }

  /** Read a message; whether it was the last. */
  private read(message: string | ArrayBuffer): boolean {
    const { report } = this.scene;
    if (typeof message !== 'string') {
      const [first, count] = [4, 8].map((at) => new DataView(message).getUint32(at, true)) as [number, number];
      const { channels = [], weights = [] } = this.face?.first === first ? this.face : {};
      const values = new Float32Array(message, HEADER);
      for (let k = 0; k < count; k++) {
        const row = values.subarray((k * values.length) / count, ((k + 1) * values.length) / count);
        this.frames.push({ row, face: new Map(channels.map((name, n) => [name, weights[k]![n]!])) });
      }
      report.frames = this.end;
      return false;
    }
    const said = JSON.parse(message) as ServiceMessage | { type: 'unit'; unit: SentenceToken };
    if (said.type === 'skeleton') {
      this.fps = report.fps = said.fps;
      this.skeleton = said;
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
}

/** A person as the skeleton of a stream: the nodes that its frames move. */
class Figure {
  private readonly objects = new Map<number, Object3D>(); // of the file's nodes
  private readonly nodes: Object3D[];
  private readonly targets = new Map<string, { mesh: Mesh; number: number }[]>(); // of the channels of a face so far
  private placement: { turn: Quaternion; from: Vector3; to: Vector3 } | null = null;

  constructor(private readonly person: Person, private readonly skeleton: SkeletonMessage) {
    const { scene, parser: { associations, json } } = person.file;
    scene.traverse((object) => {
      const number = associations.get(object)?.nodes;
      if (number !== undefined) this.objects.set(number, object);
    });
    const { nodes: listed } = json as { nodes: { name?: string }[] };
    const numbers = skeleton.nodes ?? skeleton.names.map((name) => listed.findIndex((node) => node.name === name));
    this.nodes = numbers.flatMap((number) => this.objects.get(number) ?? []);
    if (this.nodes.length < numbers.length) throw new Error('the stream has another skeleton than its first word');
  }

  /** The motion in frames, the first of them at a time in seconds. */
  tracks(frames: Frame[], start: number, fps: number): KeyframeTrack[] {
    const times = Float32Array.from(frames, (_, k) => start + k / fps);
    const places = new Float32Array(3 * frames.length);
    const turns = this.nodes.map((_, joint) => Float32Array.from(frames.flatMap(({ row }) => [...row.subarray(3 + 4 * joint, 7 + 4 * joint)])));
    frames.forEach(({ row }, k) => this.place(row, k, places, turns[0]!));
    for (const name of frames.flatMap(({ face }) => [...face.keys()])) if (!this.targets.has(name)) this.targets.set(name, this.targetsOf(name));
    const faces = [...this.targets].flatMap(([name, targets]) => {
      const weights = Float32Array.from(frames, ({ face }) => face.get(name) ?? 0);
      return targets.map(({ mesh, number }) => new NumberKeyframeTrack(`${mesh.uuid}.morphTargetInfluences[${number}]`, times, weights));
    });
    const rotations = turns.map((values, joint) => new QuaternionKeyframeTrack(`${this.nodes[joint]!.uuid}.quaternion`, times, values));
    return [new VectorKeyframeTrack(`${this.nodes[0]!.uuid}.position`, times, places), ...rotations, ...faces];
  }

  /** Place a frame's root: the stream begins where the person stands. */
  private place(row: Float32Array, frame: number, places: Float32Array, turns: Float32Array): void {
    const root = this.nodes[0]!;
    const at = new Vector3().fromArray(row).multiplyScalar(this.skeleton.metres);
    const own = new Quaternion().fromArray(row, 3);
    this.placement ??= {
      turn: root.getWorldQuaternion(new Quaternion()).multiply(own.clone().invert()),
      from: at.clone(),
      to: root.getWorldPosition(new Vector3()),
    };
    const { turn, from, to } = this.placement;
    const above = root.parent!.getWorldQuaternion(new Quaternion()).invert();
    own.premultiply(turn).premultiply(above).toArray(turns, 4 * frame);
    root.parent!.worldToLocal(at.sub(from).applyQuaternion(turn).add(to)).toArray(places, 3 * frame);
  }

  /** The morph targets of a channel: ARKit's by name, or those of a node by NODE/NUMBER. */
  private targetsOf(channel: string): { mesh: Mesh; number: number }[] {
    const [, node, target] = /^(\d+)\/(\d+)$/.exec(channel) ?? [];
    const found: { mesh: Mesh; number: number }[] = [];
    (node ? this.objects.get(Number(node)) : this.person.file.scene)?.traverse((mesh) => {
      if (!(mesh instanceof Mesh) || !mesh.morphTargetInfluences) return;
      const number = node ? Number(target) : mesh.morphTargetDictionary?.[channel];
      if (number !== undefined) found.push({ mesh, number });
    });
    return found;
  }
}
