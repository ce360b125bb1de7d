/** A stream without a page: a worker fetches, verifies and decodes it. A player requests sorted images, which the GPU
 * dequantizes; other engines ask for splats (`frame`). */

import workerSource from "worker-source";
import { StreamError } from "../stream/errors.ts";
import { groupOfFrame } from "../stream/manifest.ts";
import type { EmbeddedFiles } from "../worker/source.ts";
import type { DecodePath, FromWorker, SessionRequest, Splats, StreamEvents, StreamInfo, ToWorker } from "../worker/messages.ts";
import { takeEarlyFiles } from "./early_files.ts";
import { Emitter } from "./emitter.ts";
import { VideoReader } from "./video_reader.ts";

export interface StreamOptions {
  /** How to decode; by default, the first one that works. `video` needs a page. */
  readonly path?: DecodePath | "auto";
  /** Whether the first group follows the last one, when groups are fetched ahead. */
  readonly loop?: boolean;
  /** The id of the rendition to fetch; by default, each group in the one that the connection and the device sustain. */
  readonly rendition?: string | null;
}

/** The worker of the next player: it starts while the page prepares the rest. */
let spare: Worker | null = null;
let address: string | null = null;

export function startWorker(): void {
  address ??= URL.createObjectURL(new Blob([workerSource], { type: "text/javascript" }));
  spare ??= new Worker(address);
}

function takeWorker(): Worker {
  startWorker();
  const worker = spare!;
  spare = null;
  return worker;
}

interface Asked {
  readonly frame: number;
  readonly resolve: (splats: Splats | null) => void;
  readonly reject: (error: StreamError) => void;
}

export class V3Stream extends Emitter<StreamEvents> {
  info: StreamInfo | null = null;
  /** How images are decoded. */
  path: DecodePath | null = null;
  /** Of the connection, in Mbit/s; 0 while it is not known. */
  bandwidth = 0;
  receivedBytes = 0;
  /** Groups in memory. */
  fetchedGroups: readonly number[] = [];
  /** Groups that cannot be played, and why. */
  readonly leftOut = new Map<number, string>();
  /** Largest side of a texture that the device can render from, in pixels, for players. Set before opening. */
  maxTexture = Infinity;
  private readonly worker = takeWorker();
  private readonly videos = new VideoReader((message, transfer) => this.post(message, transfer));
  private asked: Asked[] = [];
  private failure: string | null = null;
  private readonly options: Required<StreamOptions>;

  constructor(options: StreamOptions = {}) {
    super();
    this.options = { path: "auto", loop: true, rendition: null, ...options };
    this.worker.onmessage = (event: MessageEvent<FromWorker>): void => this.receive(event.data);
    this.worker.onerror = (event): void => this.fail(`The player's worker failed: ${event.message}.`);
  }

  /** Opens a stream by the URL of its folder, its manifest or its one file (`.v3s`), from files that the page itself holds,
   * or from a file on this computer; closes the one before. StreamError: there is no stream, or it cannot be decoded here. */
  open(address: string, files: EmbeddedFiles | null = null, archive: File | null = null): Promise<StreamInfo> {
    this.rejectAll("Another stream was opened.");
    this.info = this.failure = null;
    this.leftOut.clear();
    this.fetchedGroups = [];
    const inPage = "document" in globalThis;
    const url = new URL(address, inPage ? document.baseURI : location.href).href;
    const early = inPage && files === null && archive === null ? takeEarlyFiles(url) : null;
    const { options, maxTexture } = this;
    const request: ToWorker = { type: "open", url, files, archive, early, maxTexture, ...options };
    this.post(request, early === null ? [] : [early.port]);
    const opened = new Promise<StreamInfo>((resolve, reject) => {
      this.opening = { resolve, reject };
    });
    opened.catch(() => undefined); // `failed` reports it, too
    return opened;
  }

  private opening: { readonly resolve: (info: StreamInfo) => void; readonly reject: (error: StreamError) => void } | null = null;

  /** A frame's splats. While one is decoded, only the newest call is kept: those before it get null. `seek`: interrupt what
   * is in progress. StreamError: the frame's group cannot be played, or nothing can. RangeError: there is no such frame. */
  frame(frame: number, seek = false): Promise<Splats | null> {
    const { info, failure } = this;
    if (info === null) return Promise.reject(new StreamError(failure ?? "The stream is not open yet."));
    if (!Number.isInteger(frame) || frame < 0 || frame >= info.frameCount)
      return Promise.reject(new RangeError(`There is no frame ${frame}; the stream has ${info.frameCount}.`));
    const why = failure ?? this.leftOut.get(groupOfFrame(info.groups, frame));
    if (why !== undefined) return Promise.reject(new StreamError(why));
    return new Promise((resolve, reject) => {
      this.asked.push({ frame, resolve, reject });
      this.post({ type: "present", frame, axis: null, seek });
    });
  }

  /** Sends a request of a player to the worker. */
  request(message: SessionRequest): void {
    this.post(message);
  }

  /** Returns memory that is no longer needed, such as `splats.means.buffer`; its arrays are empty afterwards. */
  recycle(...buffers: ArrayBuffer[]): void {
    this.post({ type: "recycle", buffers }, buffers);
  }

  close(): void {
    this.worker.terminate();
    this.videos.dispose();
    this.rejectAll("The stream was closed.");
    this.removeAll();
  }

  private post(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  private fail(message: string): void {
    this.failure = message;
    this.rejectAll(message);
    this.emit("failed", message);
  }

  private rejectAll(message: string): void {
    const error = new StreamError(message);
    this.opening?.reject(error);
    this.opening = null;
    for (const { reject } of this.asked) reject(error);
    this.asked = [];
  }

  private receive(message: FromWorker): void {
    switch (message.type) {
      case "opened":
      case "grown":
        this.info = message.value;
        this.opening?.resolve(message.value);
        this.opening = null;
        break;
      case "splats": {
        // Ends what was asked up to the call that the splats answer.
        const splats = message.value;
        const at = this.asked.findIndex(({ frame }) => frame === splats.frame);
        this.asked.splice(0, at + 1).forEach(({ resolve }, i) => resolve(i === at ? splats : null));
        break;
      }
      case "leftOut": {
        const { group, message: why } = message.value;
        this.leftOut.set(group, why);
        const { groups } = this.info!;
        const lost = this.asked.filter(({ frame }) => groupOfFrame(groups, frame) === group);
        this.asked = this.asked.filter((one) => !lost.includes(one));
        for (const { reject } of lost) reject(new StreamError(why));
        if (this.leftOut.size < groups.length) break;
        this.fail(why);
        return;
      }
      case "fetched":
        ({ groups: this.fetchedGroups, bytes: this.receivedBytes, bandwidth: this.bandwidth } = message.value);
        break;
      case "failed":
        this.fail(message.value);
        return;
      case "path":
        this.path = message.value;
        break;
      case "video-open":
      case "video-read":
      case "video-close":
        this.videos.receive(message);
        return;
    }
    this.emit(message.type, message.value);
  }
}
