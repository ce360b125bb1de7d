/** Decoded luma of one group, frame by frame. */

import { crc32 } from "../stream/crc32.ts";
import { messageOf, StreamError } from "../stream/errors.ts";
import type { LumaCheck } from "../stream/manifest.ts";
import { type Sample, samplesNeeded } from "../stream/mp4.ts";
import type { Pool } from "./pool.ts";

/** A decoded image: luma, and the wall-clock decoding time in milliseconds. */
export interface Luma {
  readonly data: Uint8Array<ArrayBuffer>;
  readonly decode: number;
}

export interface PictureSource {
  /** Image `index` of the group; the caller owns it. Going forward is cheap; going back restarts decoding. */
  get(index: number): Promise<Luma>;
  /** Decodes the first images ahead. */
  warm(): void;
  close(): void;
}

/** Thrown if a group is closed while it is being read; not reported. */
export class Closed extends Error {}

/** WebCodecs returns frames without planes (w3c/webcodecs#920) or rejects the video; another decode path may work. */
export class PathFailed extends StreamError {}

const AHEAD = 4; // number of images decoded ahead of the last requested one
const TICK = 33_333; // microseconds per image, used to identify decoder output; the true frame rate is in the manifest
const PATIENCE = 20_000; // milliseconds without an image after which the decoder is considered stuck

/** Decodes one video with WebCodecs. */
export class WebCodecsPictures implements PictureSource {
  private decoder: VideoDecoder | null = null;
  private readonly needed: readonly number[]; // samples that the decoder needs for each image and all before it
  /** Next sample to feed to the decoder, next image that it will output, first image that is needed. */
  private fed = 0;
  private out = 0;
  private wanted = 0;
  private readonly ready = new Map<number, Luma>();
  private waiting: { index: number; resolve: (luma: Luma) => void; reject: (error: unknown) => void } | null = null;
  private error: Error | null = null;
  private copying: Promise<void> = Promise.resolve();
  private readonly submitted: number[] = [];
  private lastOut = 0;
  private run = 0;
  private watchdog = 0;

  /** `data`: the video file, or its beginning with these samples. */
  constructor(
    private readonly config: VideoDecoderConfig,
    private readonly data: Uint8Array,
    private readonly samples: readonly Sample[],
    private readonly size: readonly [number, number],
    private readonly name: string,
    private readonly pool: Pool,
  ) {
    this.needed = samplesNeeded(samples);
  }

  get(index: number): Promise<Luma> {
    if (this.error !== null) return Promise.reject(this.error);
    this.waiting?.reject(new Closed());
    this.waiting = null;
    const ready = this.ready.get(index);
    this.drop(index);
    if (ready === undefined && index < this.out) this.restart();
    this.wanted = ready === undefined ? index : index + 1;
    const result =
      ready === undefined
        ? new Promise<Luma>((resolve, reject) => {
            this.waiting = { index, resolve, reject };
          })
        : Promise.resolve(ready);
    this.feed();
    return result;
  }

  warm(): void {
    if (this.fed === 0) this.feed();
  }

  close(): void {
    this.fail(new Closed());
  }

  /** Drops images before `index`, and `index` itself, which now belongs to the caller. */
  private drop(index: number): void {
    for (const [at, luma] of this.ready) {
      if (at < index) this.pool.give(luma.data);
      if (at <= index) this.ready.delete(at);
    }
  }

  private restart(): void {
    this.stopDecoder();
    this.fed = this.out = 0;
  }

  private stopDecoder(): void {
    this.run++;
    this.submitted.length = 0;
    if (this.decoder !== null && this.decoder.state !== "closed") this.decoder.close();
    this.decoder = null;
    for (const luma of this.ready.values()) this.pool.give(luma.data);
    this.ready.clear();
  }

  private start(): VideoDecoder {
    const run = this.run;
    const decoder = new VideoDecoder({
      output: (frame) => {
        if (run !== this.run) {
          frame.close();
          return;
        }
        const index = Math.round(frame.timestamp / TICK);
        if (index !== this.out) {
          frame.close();
          this.fail(new StreamError(`${this.name}: frame ${this.out} is damaged.`));
          return;
        }
        this.out++;
        const now = performance.now();
        const decode = now - Math.max(this.submitted.shift() ?? now, this.lastOut);
        this.lastOut = now;
        this.copying = this.copying.then(() => this.take(frame, index, decode, run));
      },
      error: (error) => {
        if (run !== this.run) return;
        const { codec } = this.config;
        const why = `This browser cannot decode this video (${codec}, ${this.size.join("x")}).`;
        this.fail(new PathFailed(error.name === "NotSupportedError" ? why : `${this.name} cannot be decoded: ${error.message}.`));
      },
    });
    decoder.configure(this.config);
    this.decoder = decoder;
    return decoder;
  }

  private async take(frame: VideoFrame, index: number, decode: number, run: number): Promise<void> {
    try {
      if (run !== this.run || index < this.wanted) return;
      const data = await this.copy(frame);
      if (run !== this.run) {
        this.pool.give(data);
        return;
      }
      if (this.waiting?.index === index) {
        this.waiting.resolve({ data, decode });
        this.waiting = null;
        this.wanted = index + 1;
      } else this.ready.set(index, { data, decode });
    } catch (error) {
      if (run === this.run) this.fail(error instanceof Error ? error : new Error(messageOf(error)));
    } finally {
      frame.close();
      if (run === this.run) this.feed();
    }
  }

  /** The visible luma of a frame, without row padding. */
  private async copy(frame: VideoFrame): Promise<Uint8Array<ArrayBuffer>> {
    const [width, height] = this.size;
    const rect = frame.visibleRect;
    if (rect === null || rect.width !== width || rect.height !== height)
      throw new StreamError(
        `${this.name}: a frame is ${rect?.width ?? 0}x${rect?.height ?? 0}, expected ${width}x${height}.`,
      );
    if (frame.format === null || !/^(I4|NV12|NV21)/.test(frame.format))
      throw new PathFailed(`${this.name}: the decoder does not output luma (format ${frame.format ?? "unknown"}).`);
    const all = this.pool.take(frame.allocationSize());
    // Many decoders add no row padding; the copy then starts with the luma.
    const planes = await frame.copyTo(all);
    const { offset, stride } = planes[0];
    if (offset === 0 && stride === width) return all.subarray(0, width * height);
    const luma = this.pool.take(width * height);
    for (let row = 0; row < height; row++)
      luma.set(all.subarray(offset + row * stride, offset + row * stride + width), row * width);
    this.pool.give(all);
    return luma;
  }

  private feed(): void {
    if (this.error !== null) return;
    const { samples } = this;
    try {
      const decoder = this.decoder ?? this.start();
      const until = Math.min(samples.length, this.after(this.wanted) + AHEAD - 1);
      // Decode up to the requested image immediately, and beyond it slowly.
      while (this.fed < until && (this.fed < this.after(this.wanted) || this.fed < this.after(this.out) + AHEAD - 1)) {
        const { offset, bytes, key, picture } = samples[this.fed];
        this.submitted.push(performance.now());
        decoder.decode(
          new EncodedVideoChunk({
            type: key ? "key" : "delta",
            timestamp: picture * TICK,
            data: this.data.subarray(offset, offset + bytes),
          }),
        );
        this.fed++;
        // Decoders may withhold images until they are flushed.
        if (this.fed === samples.length) void this.flush(decoder, this.run);
      }
    } catch (error) {
      this.fail(new PathFailed(`${this.name} cannot be decoded: ${messageOf(error)}.`));
    }
    clearTimeout(this.watchdog);
    if (this.waiting !== null)
      this.watchdog = setTimeout(() => {
        this.fail(new PathFailed(`${this.name}: the decoder does not output any frames.`));
      }, PATIENCE);
  }

  /** Samples that are needed for an image; all for one past the end. */
  private after(picture: number): number {
    return picture < this.needed.length ? this.needed[picture] : this.samples.length;
  }

  private async flush(decoder: VideoDecoder, run: number): Promise<void> {
    try {
      await decoder.flush();
      await this.copying;
      if (run === this.run && this.out < this.samples.length)
        this.fail(new StreamError(`${this.name}: the video ends after ${this.out} of ${this.samples.length} frames.`));
    } catch {
      // Closed or failed; already reported through `error`.
    }
  }

  private fail(error: Error): void {
    if (this.error !== null) return;
    this.error = error;
    clearTimeout(this.watchdog);
    this.stopDecoder();
    this.waiting?.reject(error);
    this.waiting = null;
  }
}

/** Compares decoded images with their CRC-32 in the manifest: a decoder is exact, or it cannot be used. */
export function checkedPictures(pictures: PictureSource, checks: readonly LumaCheck[], name: string, pool: Pool): PictureSource {
  let begun = false;
  const checked = async (index: number): Promise<Luma> => {
    const luma = await pictures.get(index);
    for (const check of checks)
      if (check.picture === index && crc32(luma.data) !== check.crc32)
        throw new PathFailed(`This browser decodes the video inexactly, so that it cannot be shown; another one may play it (${name}, picture ${index}).`);
    begun = true;
    return luma;
  };
  return {
    async get(index) {
      // Nothing is drawn before the first image was compared, also where playing or seeking begins after it.
      if (!begun && index > 0) pool.give((await checked(0)).data);
      return checked(index);
    },
    warm: () => pictures.warm(),
    close: () => pictures.close(),
  };
}

/** Pictures of a video that is still arriving: the first one is decoded from its own sample, before the others are there.
 * `first`: has the first picture only. `open`: called once, when another one is needed; has all pictures. */
export function arrivingPictures(first: PictureSource, open: () => Promise<PictureSource>): PictureSource {
  let all: Promise<PictureSource> | null = null;
  let closed = false;
  return {
    async get(index) {
      if (closed) throw new Closed();
      if (index === 0 && all === null) return first.get(0);
      all ??= open();
      const pictures = await all;
      first.close();
      return pictures.get(index);
    },
    warm: () => first.warm(),
    close() {
      closed = true;
      first.close();
      all?.then((pictures) => pictures.close(), () => undefined);
    },
  };
}
