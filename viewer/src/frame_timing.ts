/** Whether frames come late, while the animation plays. */

const WINDOW_S = 1; // judged together
const MIN_FRAMES = 3; // one late frame alone says nothing
const SETTLING = 5; // frames after less is drawn that are not judged: shaders without shadows take time too

export class FrameTiming {
  private intervals: number[] = [];
  private settling = 0;

  /** ``late`` is called when half of the last second's frames came late. */
  constructor(private readonly late: () => void) {}

  /** A frame came this many seconds after the one before; more than ``limit`` is late. */
  frame(seconds: number, limit: number): void {
    if (this.settling-- > 0) return;
    this.intervals.push(seconds);
    if (this.intervals.length < MIN_FRAMES || this.intervals.reduce((sum, one) => sum + one) < WINDOW_S) return;
    const middle = this.intervals.sort((a, b) => a - b)[this.intervals.length >> 1]!;
    this.forget();
    if (middle <= limit) return;
    this.settling = SETTLING;
    this.late();
  }

  /** Playing stopped, or something else took the time: what came before does not count. */
  forget(): void {
    this.intervals = [];
  }
}
