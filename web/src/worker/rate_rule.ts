/** The choice of the rendition to fetch next: a buffer-based rule with throughput and dropped frames as further inputs.
 *
 * It is BOLA-BASIC (Spiteri, Urgaonkar and Sitaraman, "BOLA: Near-Optimal Bitrate Adaptation for Online Videos", INFOCOM 2016)
 * with the parameters that dash.js chooses (its BolaRule; seconds of buffer are fewer here, since groups are short), the paper's
 * BOLA-O against oscillation, and dash.js's DroppedFramesRule. Until the buffer has reached the level at which BOLA takes what the
 * throughput allows, throughput alone decides. */

const MINIMUM = 4; // seconds of buffer
const SAMPLES = 5;
const SAFETY = 0.9;
const PROBING = 0.9;
const FIRST_PAUSE = 4;
const LONGEST_PAUSE = 64;
const DROPPED_SHARE = 0.15;
const DROPPED_SAMPLE = 90;

export class RateRule {
  /** Seconds of buffer to fill. */
  readonly target: number;
  private readonly order: number[];
  private readonly rates: number[];
  private readonly utilities: number[];
  private readonly gp: number;
  private readonly throughput: [number, number][] = [];
  /** Frames shown and dropped, by rate. */
  private readonly frames: [number, number][];
  private filling = true;
  private last = 0;
  private patience = FIRST_PAUSE;
  private pause = 0;

  /** @param bandwidths - bits per second of each rendition, in the order of the manifest */
  constructor(bandwidths: readonly number[]) {
    this.order = bandwidths.map((_, i) => i).sort((a, b) => bandwidths[a] - bandwidths[b]);
    this.rates = this.order.map((i) => bandwidths[i]);
    this.frames = this.order.map(() => [0, 0]);
    this.target = MINIMUM + bandwidths.length;
    this.utilities = this.rates.map((rate) => Math.log(rate / this.rates[0]) + 1);
    this.gp = (this.utilities[this.utilities.length - 1] - 1) / (this.target / MINIMUM - 1);
  }

  /** A group of `bytes` bytes took `seconds` to arrive. */
  fetched(bytes: number, seconds: number): void {
    this.throughput.push([bytes, Math.max(seconds, 1e-6)]);
    if (this.throughput.length > SAMPLES) this.throughput.shift();
  }

  /** Frames of a rendition (its position in the manifest) were shown, or were dropped since decoding was late. */
  played(rendition: number, shown: number, dropped: number): void {
    const counts = this.frames[this.order.indexOf(rendition)];
    counts[0] += shown;
    counts[1] += dropped;
  }

  /** The best rendition that can be decoded in time, in which groups are fetched that need not arrive in time. */
  best(): number {
    return this.order[this.decodable()];
  }

  /** The best rendition that can be decoded in time and arrives in time. */
  affordable(): number {
    return this.order[Math.min(this.sustained(), this.decodable())];
  }

  /** The position in the manifest's order of the rendition to fetch next. `buffered`: seconds of frames that are fetched and
   * not yet shown. */
  choose(buffered: number): number {
    const byRate = this.sustained();
    const bola = this.bola(buffered);
    let choice = byRate;
    if (this.filling && (bola > byRate || (bola === byRate && byRate > 0))) this.filling = false;
    if (!this.filling) {
      choice = Math.max(Math.min(bola, byRate), Math.min(bola, this.last));
      if (bola > choice && buffered >= PROBING * this.target && this.pause <= 0) {
        choice++;
        this.pause = this.patience = Math.min(2 * this.patience, LONGEST_PAUSE);
      }
    }
    this.pause--;
    choice = Math.min(choice, this.decodable());
    this.last = choice;
    return this.order[choice];
  }

  private bola(buffered: number): number {
    if (this.gp === 0) return this.rates.length - 1;
    const weight = MINIMUM / this.gp;
    let best = 0;
    let most = -Infinity;
    this.rates.forEach((rate, i) => {
      const score = (weight * (this.utilities[i] + this.gp) - buffered) / rate;
      if (score >= most) [best, most] = [i, score];
    });
    return best;
  }

  /** The highest rate below the first one of which too many frames were dropped. */
  private decodable(): number {
    const bad = this.frames.findIndex(
      ([shown, dropped], i) => i > 0 && shown + dropped >= DROPPED_SAMPLE && dropped > DROPPED_SHARE * (shown + dropped),
    );
    return bad < 0 ? this.rates.length - 1 : bad - 1;
  }

  private sustained(): number {
    const bytes = this.throughput.reduce((sum, [size]) => sum + size, 0);
    const seconds = this.throughput.reduce((sum, [, time]) => sum + time, 0);
    const rate = seconds > 0 ? (SAFETY * 8 * bytes) / seconds : 0;
    let highest = 0;
    this.rates.forEach((each, i) => {
      if (each <= rate) highest = i;
    });
    return highest;
  }
}
