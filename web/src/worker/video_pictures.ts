/** Decodes luma with a <video> element if WebCodecs is unavailable: on insecure pages, and in browsers without it. The
 * element is on the page; this requests its images. */

import { StreamError } from "../stream/errors.ts";
import type { Packet } from "./demux.ts";
import type { VideoReply, VideoRequest } from "./messages.ts";
import { Closed, type Luma, type PictureSource } from "./pictures.ts";
import type { Pool } from "./pool.ts";

/** Matches the page's replies to requests. */
export class VideoChannel {
  private readonly open = new Map<number, { resolve: (luma: ArrayBuffer) => void; reject: (error: unknown) => void }>();
  private last = 0;

  constructor(readonly post: (request: VideoRequest) => void) {}

  ask(make: (request: number) => VideoRequest): Promise<ArrayBuffer> {
    const request = ++this.last;
    const answer = new Promise<ArrayBuffer>((resolve, reject) => this.open.set(request, { resolve, reject }));
    this.post(make(request));
    return answer;
  }

  receive(reply: VideoReply): void {
    const pending = this.open.get(reply.request);
    this.open.delete(reply.request);
    if (reply.type === "video-frame") pending?.resolve(reply.luma);
    else pending?.reject(new StreamError(reply.message));
  }

  newSource(): number {
    return ++this.last;
  }
}

export class VideoElementPictures implements PictureSource {
  private readonly packets: readonly Packet[]; // in order of display
  private readonly source: number;
  private chain: Promise<unknown>;
  private ahead: { index: number; luma: Promise<Luma> } | null = null;
  private closed = false;
  /** Ends waiting for an element that will never answer, because its video was taken away. */
  private stop: (error: Closed) => void = () => undefined;
  private readonly stopped: Promise<never>;

  constructor(
    private readonly channel: VideoChannel,
    file: Uint8Array<ArrayBuffer>,
    packets: readonly Packet[],
    size: readonly [number, number],
    private readonly pool: Pool,
  ) {
    this.stopped = new Promise<never>((_resolve, reject) => {
      this.stop = reject;
    });
    this.stopped.catch(() => undefined);
    this.packets = [...packets].sort((a, b) => a.picture - b.picture);
    const source = (this.source = channel.newSource());
    const [width, height] = size;
    this.chain = channel.ask((request) => ({
      type: "video-open",
      request,
      source,
      file: new Blob([file], { type: "video/mp4" }),
      width,
      height,
    }));
    this.chain.catch(() => undefined);
  }

  async get(index: number): Promise<Luma> {
    const ahead = this.ahead;
    this.ahead = null;
    const luma = await (ahead?.index === index ? ahead.luma : this.read(index));
    if (index + 1 < this.packets.length && !this.closed) this.begin(index + 1);
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
    this.closed = true;
    this.stop(new Closed());
    this.channel.post({ type: "video-close", source: this.source });
    this.ahead?.luma.then((luma) => { this.pool.give(luma.data); }).catch(() => undefined);
  }

  private read(index: number): Promise<Luma> {
    const reading = Promise.race([this.chain, this.stopped]).then(async () => {
      if (this.closed) throw new Closed();
      const packet = this.packets[index];
      const duration = packet.duration || 1 / 30;
      const began = performance.now();
      const asked = this.channel.ask((request) => ({
        type: "video-read",
        request,
        source: this.source,
        time: packet.timestamp + duration / 2,
        duration,
      }));
      const luma = await Promise.race([asked, this.stopped]);
      return { data: new Uint8Array(luma), decode: performance.now() - began };
    });
    this.chain = reading.catch(() => undefined);
    return reading;
  }
}
