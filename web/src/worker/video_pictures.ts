/** Decodes luma with a <video> element if WebCodecs is unavailable: on insecure pages, and in browsers without it. The
 * element is on the page; this requests its images. */

import { StreamError } from "../stream/errors.ts";
import type { Sample } from "../stream/mp4.ts";
import type { Report, VideoTime } from "./messages.ts";
import { Closed, type Luma, type PictureSource } from "./pictures.ts";
import type { Pool } from "./pool.ts";

export class VideoElementPictures implements PictureSource {
  private readonly samples: readonly Sample[]; // in order of display
  private readonly port: MessagePort;
  private chain: Promise<unknown> = Promise.resolve();
  private ahead: { index: number; luma: Promise<Luma> } | null = null;
  /** Ends waiting for an element that will never answer, because its video was taken away. */
  private stop: (error: Closed) => void = () => undefined;
  private readonly stopped: Promise<never>;

  constructor(
    report: Report,
    file: Uint8Array<ArrayBuffer>,
    samples: readonly Sample[],
    [width, height]: readonly [number, number],
    private readonly pool: Pool,
  ) {
    this.stopped = new Promise<never>((_resolve, reject) => {
      this.stop = reject;
    });
    this.stopped.catch(() => undefined);
    this.samples = [...samples].sort((a, b) => a.picture - b.picture);
    const { port1, port2 } = new MessageChannel();
    this.port = port1;
    report("video", { file: new Blob([file], { type: "video/mp4" }), width, height, port: port2 }, [port2]);
  }

  async get(index: number): Promise<Luma> {
    const ahead = this.ahead;
    this.ahead = null;
    const luma = await (ahead?.index === index ? ahead.luma : this.read(index));
    if (index + 1 < this.samples.length) this.begin(index + 1);
    return luma;
  }

  warm(): void {
    if (this.ahead === null) this.begin(0);
  }

  private begin(index: number): void {
    const luma = this.read(index);
    luma.catch(() => undefined);
    this.ahead = { index, luma };
  }

  close(): void {
    this.stop(new Closed());
    this.port.postMessage(null);
    this.ahead?.luma.then((luma) => { this.pool.give(luma.data); }).catch(() => undefined);
  }

  private read(index: number): Promise<Luma> {
    const reading = Promise.race([this.stopped, this.chain]).then(async () => {
      const { timestamp, duration: own } = this.samples[index];
      const duration = own || 1 / 30;
      const began = performance.now();
      const luma = await Promise.race([this.ask({ time: timestamp + duration / 2, duration }), this.stopped]);
      return { data: new Uint8Array(luma), decode: performance.now() - began };
    });
    this.chain = reading.catch(() => undefined);
    return reading;
  }

  private ask(time: VideoTime): Promise<ArrayBuffer> {
    return new Promise((resolve, reject) => {
      this.port.onmessage = ({ data }: MessageEvent<ArrayBuffer | string>) => {
        if (typeof data === "string") reject(new StreamError(data));
        else resolve(data);
      };
      this.port.postMessage(time);
    });
  }
}
