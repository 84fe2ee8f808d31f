/** What a player shows: scenes, the people who sign them, their time, and the captions. */

import { FrameTiming } from './frame_timing.js';
import type { Person } from './person.js';
import { Player } from './player.js';
import { caption, seams } from './scene.js';
import { Stage } from './stage.js';
import type { Spliced } from './wire.js';

const LOOP_MARGIN_S = 0.5; // shown before and after a looped seam

export class Show {
  scenes: Spliced[] = [];
  people: Person[] = [];
  /** The number of the seam that is looped. */
  looped: number | null = null;
  readonly stage: Stage;
  readonly player = new Player(() => this.change());
  private readonly timing = new FrameTiming(() => this.stage.lighten());
  private readonly observer = new ResizeObserver(() => this.stage.resize());
  private last: number | null = null; // time of the frame before, while it plays
  private isDue = false; // a frame is asked for
  private isDirty = true;
  private isHeld = false;

  /** ``captions``: one element for each side; ``changed`` is called when the time or the state of playing has changed. */
  constructor(canvas: HTMLCanvasElement, private readonly captions: HTMLElement[], private readonly changed: () => void) {
    this.stage = new Stage(canvas, () => this.wake());
    this.observer.observe(canvas);
  }

  open(scenes: Spliced[], people: Person[]): void {
    this.scenes = scenes;
    this.people = people;
    this.looped = null;
    this.stage.show(people);
    const { fps } = scenes[0]!.report;
    const seconds = Math.max(...scenes.map(({ report }) => (report.frames - 1) / report.fps));
    this.player.open(Math.round(seconds * fps) + 1, fps);
  }

  close(): void {
    this.player.pause();
    this.observer.disconnect();
    this.stage.dispose();
  }

  /** Loop a seam; null: stop looping. */
  loop(seam: number | null): void {
    const at = seam === null ? undefined : seams(this.scenes[0]!.report)[seam];
    this.looped = at ? seam : null;
    const { fps } = this.player;
    this.player.setLoop(at ? { from: at.from / fps - LOOP_MARGIN_S, to: at.to / fps + LOOP_MARGIN_S } : null);
    if (at) this.player.play();
  }

  toggle(): void {
    if (this.player.playing) this.player.pause();
    else this.player.play();
  }

  /** Draw frames in another order and size, for a film; nothing else is drawn meanwhile. */
  async hold(width: number, height: number, work: () => Promise<void>): Promise<void> {
    this.player.pause();
    this.isHeld = true;
    try {
      await this.stage.sized(width, height, work);
    } finally {
      this.isHeld = false;
      this.wake();
    }
  }

  /** Draw the next frame. */
  wake(): void {
    this.isDirty = true;
    if (this.isDue) return;
    this.isDue = true;
    requestAnimationFrame((now) => this.tick(now));
  }

  private tick(now: number): void {
    this.isDue = false;
    if (this.isHeld) return;
    const elapsed = this.last === null ? 0 : (now - this.last) / 1000;
    const seconds = Math.min(0.25, elapsed);
    if (this.player.playing && elapsed) this.timing.frame(elapsed, this.stage.late);
    else this.timing.forget();
    this.player.tick(seconds);
    if (this.isDirty) this.draw(this.player.playing ? seconds : 0);
    this.last = this.player.playing ? now : null;
  }

  private draw(seconds: number): void {
    if (!this.people.length) return;
    this.people.forEach((person, side) => person.at(this.timeOf(side)));
    this.stage.follow(seconds);
    this.stage.draw();
    this.isDirty = false;
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

  private change(): void {
    if (!this.player.loop) this.looped = null;
    this.captions.forEach((element, k) => {
      const scene = this.scenes[k];
      if (!scene) return;
      const at = Math.min(scene.report.frames - 1, Math.max(0, Math.floor(this.timeOf(k) * scene.report.fps + 1e-6)));
      const { parts, inTransition } = caption(scene, at);
      element.classList.toggle('in-transition', inTransition);
      const middle = document.createElement(parts[0] || parts[2] ? 'b' : 'span');
      middle.textContent = parts[1];
      element.replaceChildren(...(parts.some(Boolean) ? [parts[0], middle, parts[2]] : [])); // an empty one is hidden
    });
    this.wake();
    this.changed();
  }
}
