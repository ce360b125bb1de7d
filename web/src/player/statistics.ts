/** Recent measurements, for the statistics panel. */

const KEPT = 600;

/** The last values of a measurement. */
export class Series {
  private readonly values: number[] = [];

  add(value: number): void {
    this.values.push(value);
    if (this.values.length > KEPT) this.values.shift();
  }

  /** The mean of the last `n` values; 0 if there are none. */
  mean(n = 30): number {
    const last = this.values.slice(-n);
    return last.length === 0 ? 0 : last.reduce((sum, value) => sum + value, 0) / last.length;
  }
}

export class Statistics {
  readonly decode = new Series();
  readonly dequantize = new Series();
  readonly sort = new Series();
  /** Once per group. */
  readonly prepare = new Series();
  readonly upload = new Series();
  readonly draw = new Series();
  readonly gpu = new Series();
  /** Main thread time per frame. */
  readonly main = new Series();
  /** Interval between displayed frames. */
  readonly interval = new Series();
  shown = 0;
  dropped = 0;
  stalls = 0;
}
