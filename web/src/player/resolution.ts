/** Dynamic resolution: that of the display, or less if rendering would take too long. */

const STEPS = [1, 0.85, 0.7, 0.6, 0.5, 0.42, 0.35];
/** Number of drawings measured before a change; fewer if they are slow. */
const WINDOW = 12;
const PATIENCE = 500;
const HOPE = 0.8; // fraction of the budget that a finer step may be expected to take
const FIRST_PIXELS = 2.1e6; // maximum initial number of pixels, while the speed of the device is unknown
const FIRST_PIXELS_IN_SOFTWARE = 6e4; // the same without a GPU

export class Resolution {
  /** Time budget of a drawing in milliseconds. */
  budget = 1000 / 30;
  /** Whether the CPU draws. */
  software = false;
  private step = 0;
  private begun = false;
  private readonly times: number[] = [];
  private easy = 0;

  /** Render size as a fraction of the canvas size. */
  scale(width: number, height: number): number {
    if (!this.begun) {
      this.begun = true;
      const most = this.software ? FIRST_PIXELS_IN_SOFTWARE : FIRST_PIXELS;
      while (width * height * STEPS[this.step] ** 2 > most && this.step + 1 < STEPS.length) this.step++;
    }
    return STEPS[this.step];
  }

  /** Discards the measurements, because the page was hidden or something other than drawing took the time. */
  forget(): void {
    this.times.length = 0;
  }

  /** Records the time of a drawing in milliseconds until the GPU had finished. True if the scale has changed. */
  measured(milliseconds: number): boolean {
    this.times.push(milliseconds);
    const total = this.times.reduce((sum, time) => sum + time, 0);
    if (this.times.length < WINDOW && (total < PATIENCE || this.times.length < 3)) return false;
    const median = this.times.sort((a, b) => a - b)[this.times.length >> 1];
    this.times.length = 0;
    const before = this.step;
    if (median > 1.35 * this.budget) {
      this.easy = 0;
      // The time is roughly proportional to the number of pixels.
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
