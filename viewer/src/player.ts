/** The playback state: time, speed, and the loop. It draws nothing. */

export interface Loop {
  from: number;
  to: number;
}

export class Player {
  time = 0;
  playing = false;
  speed = 1;
  /** Start and end of the loop in seconds; null: play the whole animation once. */
  loop: Loop | null = null;
  fps = 30;
  frames = 1;
  /** Whether more frames are to come, for which playing waits at the end. */
  isGrowing = false;

  constructor(private readonly changed: () => void) {}

  get duration(): number {
    return (this.frames - 1) / this.fps;
  }

  /** The frame that is shown. */
  get frame(): number {
    return Math.min(this.frames - 1, Math.floor(this.time * this.fps + 1e-6));
  }

  open(frames: number, fps: number): void {
    Object.assign(this, { frames, fps, time: 0, loop: null, playing: false, isGrowing: false });
    this.changed();
  }

  /** Go on to a later last frame; ``isGrowing``: more are to come. */
  grow(frames: number, isGrowing: boolean): void {
    Object.assign(this, { frames, isGrowing });
    this.changed();
  }

  play(): void {
    const end = this.loop ? this.loop.to : this.duration;
    if ((this.time >= end - 1e-6 && !this.isGrowing) || (this.loop && this.time < this.loop.from)) this.time = this.loop?.from ?? 0;
    this.playing = this.duration > 0 || this.isGrowing;
    this.changed();
  }

  pause(): void {
    this.playing = false;
    this.time = this.frame / this.fps;
    this.changed();
  }

  seek(frame: number): void {
    this.time = Math.max(0, Math.min(this.frames - 1, frame)) / this.fps;
    if (this.loop && (this.time < this.loop.from - 1e-6 || this.time > this.loop.to + 1e-6)) this.loop = null;
    this.changed();
  }

  step(frames: number): void {
    this.playing = false;
    this.seek(this.frame + frames);
  }

  setLoop(loop: Loop | null): void {
    this.loop = loop && { from: Math.max(0, loop.from), to: Math.min(this.duration, loop.to) };
    if (this.loop) this.time = this.loop.from;
    this.changed();
  }

  /** Advance by seconds of wall-clock time. */
  tick(seconds: number): void {
    if (!this.playing) return;
    const from = this.loop?.from ?? 0;
    const to = this.loop?.to ?? this.duration;
    this.time += seconds * this.speed;
    if (this.time >= to) {
      if (this.loop && to > from) this.time = from + ((this.time - from) % (to - from));
      else {
        this.time = to;
        this.playing = this.isGrowing;
      }
    }
    this.changed();
  }
}
