/** How finely to draw: as finely as the display can show, less where that takes the graphics too long. */

const STEPS = [1, 0.85, 0.7, 0.6, 0.5, 0.42, 0.35];
/** Drawings looked at before a change, fewer where they take long. */
const WINDOW = 12;
const PATIENCE = 500;
/** Part of the budget that a finer step may be expected to take. */
const HOPE = 0.8;
/** Pixels to begin with at most: what a slow device draws is not known yet. */
const FIRST_PIXELS = 2.1e6;

export class Resolution {
  /** What a drawing may take, milliseconds. */
  budget = 1000 / 30;
  private step = 0;
  private begun = false;
  private readonly times: number[] = [];
  private easy = 0;

  /** Part of the canvas' size to draw at. */
  scale(width: number, height: number): number {
    if (!this.begun) {
      this.begun = true;
      while (width * height * STEPS[this.step] ** 2 > FIRST_PIXELS && this.step + 1 < STEPS.length) this.step++;
    }
    return STEPS[this.step];
  }

  /** Forgets what was measured: the page was hidden, or something else than drawing took the time. */
  forget(): void {
    this.times.length = 0;
  }

  /** A drawing took this long, milliseconds, until the graphics were done. True where the scale has changed. */
  measured(milliseconds: number): boolean {
    this.times.push(milliseconds);
    const total = this.times.reduce((sum, time) => sum + time, 0);
    if (this.times.length < WINDOW && (total < PATIENCE || this.times.length < 3)) return false;
    const median = this.times.sort((a, b) => a - b)[this.times.length >> 1];
    this.times.length = 0;
    const before = this.step;
    if (median > 1.35 * this.budget) {
      this.easy = 0;
      // Drawing takes about as long as there are pixels.
      const wanted = STEPS[before] * Math.sqrt(this.budget / median);
      while (this.step + 1 < STEPS.length && STEPS[this.step] > wanted) this.step++;
    } else if (before > 0) {
      const expected = median * (STEPS[before - 1] / STEPS[before]) ** 2;
      this.easy = expected < HOPE * this.budget ? this.easy + 1 : 0;
      if (this.easy >= 3) {
        this.easy = 0;
        this.step--;
      }
    }
    return this.step !== before;
  }
}
