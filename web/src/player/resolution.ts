/** How finely to draw: as finely as the display can show, less where that takes too long. */

const STEPS = [1, 0.85, 0.7, 0.6, 0.5, 0.42, 0.35];
/** Drawing frames looked at before a change. */
const WINDOW = 12;
/** Milliseconds until a step that was too slow is tried again. */
const FORGIVE = 15_000;

export class Resolution {
  /** What a redraw may take, milliseconds. */
  budget = 1000 / 30;
  private step = 0;
  private readonly intervals: number[] = [];
  private tooSlow = -1;
  private tooSlowAt = 0;
  private easy = 0;

  /** Part of the canvas' size to draw at. */
  get scale(): number {
    return STEPS[this.step]!;
  }

  /** A redraw followed another after `milliseconds`. True where the scale has changed. */
  measured(milliseconds: number, now: number): boolean {
    // A pause of this length is no sign of slow drawing: a hidden tab, a stall.
    if (milliseconds > 500) return false;
    this.intervals.push(milliseconds);
    if (this.intervals.length < WINDOW) return false;
    const median = [...this.intervals].sort((a, b) => a - b)[WINDOW >> 1]!;
    this.intervals.length = 0;
    if (median > 1.35 * this.budget && this.step + 1 < STEPS.length) {
      this.tooSlow = this.step;
      this.tooSlowAt = now;
      this.easy = 0;
      this.step++;
      return true;
    }
    this.easy = median < 1.1 * this.budget ? this.easy + 1 : 0;
    const barred = this.tooSlow === this.step - 1 && now - this.tooSlowAt < FORGIVE;
    if (this.easy >= 4 && this.step > 0 && !barred) {
      this.step--;
      this.easy = 0;
      return true;
    }
    return false;
  }
}
