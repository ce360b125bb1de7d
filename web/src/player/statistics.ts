/** Recent measurements, for the info panel and the benchmark. */

const KEPT = 600;

/** The last values of a measurement. */
export class Series {
  private readonly values: number[] = [];

  add(value: number): void {
    this.values.push(value);
    if (this.values.length > KEPT) this.values.shift();
  }

  clear(): void {
    this.values.length = 0;
  }

  get count(): number {
    return this.values.length;
  }

  /** The mean of the last `n` values; 0 if there are none. */
  mean(n = 30): number {
    const last = this.values.slice(-n);
    return last.length === 0 ? 0 : last.reduce((sum, value) => sum + value, 0) / last.length;
  }

  /** The value below which a fraction of all values lies; 0 if there are none. */
  quantile(part: number): number {
    if (this.values.length === 0) return 0;
    const sorted = [...this.values].sort((a, b) => a - b);
    return sorted[Math.min(sorted.length - 1, Math.floor(part * sorted.length))];
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
  /** From drawing to the first display refresh at which the GPU had finished. */
  readonly done = new Series();
  /** Interval between displayed frames. */
  readonly interval = new Series();
  shown = 0;
  dropped = 0;
  stalls = 0;

  clear(): void {
    for (const series of [this.decode, this.dequantize, this.sort, this.prepare, this.upload, this.draw, this.gpu, this.main, this.interval, this.done])
      series.clear();
    this.shown = this.dropped = this.stalls = 0;
  }
}
