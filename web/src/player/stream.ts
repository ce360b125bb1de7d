/** A stream without a page: a worker fetches, verifies and decodes it. A player requests sorted images, which the GPU
 * dequantizes; other engines ask for splats (`frame`). */

import workerSource from "worker-source";
import { messageOf, StreamError } from "../stream/errors.ts";
import { groupOfFrame } from "../stream/manifest.ts";
import type {
  DecodePath, FromWorker, Splats, StreamEvents, StreamInfo, StreamOptions, StreamSource, ToWorker, Video,
} from "../worker/messages.ts";
import { takeEarlyFiles } from "./early_files.ts";
import { Emitter } from "./emitter.ts";
import type { VideoReader } from "./video_reader.ts";

export type { StreamOptions };

/** The worker of the next player: it starts while the page prepares the rest. */
let spare: Worker | null = null;
let address: string | null = null;

const FORBIDDEN = "This page does not allow the player's worker: its Content-Security-Policy must have worker-src blob:.";

export function startWorker(): void {
  address ??= URL.createObjectURL(new Blob([workerSource], { type: "text/javascript" }));
  try {
    spare ??= new Worker(address);
  } catch {
    throw new StreamError(FORBIDDEN);
  }
}

function takeWorker(): Worker {
  startWorker();
  const worker = spare!;
  spare = null;
  return worker;
}

const NOTHING: StreamEvents["fetched"] = { groups: [], bytes: 0, bandwidth: 0 };

interface Asked {
  readonly frame: number;
  readonly resolve: (splats: Splats | null) => void;
  readonly reject: (error: StreamError) => void;
}

export class V3Stream extends Emitter<StreamEvents> {
  info: StreamInfo | null = null;
  /** How images are decoded. */
  path: DecodePath | null = null;
  /** Groups in memory, and what has come over the network. */
  fetched: StreamEvents["fetched"] = NOTHING;
  /** Groups that cannot be played, and why. */
  readonly leftOut = new Map<number, string>();
  /** Largest side of a texture that the device can render from, in pixels, for players. Set before opening. */
  maxTexture = Infinity;
  private readonly worker = takeWorker();
  private videos: Promise<VideoReader> | null = null;
  private asked: Asked[] = [];
  private failure: string | null = null;
  private number = 0; // how many streams were opened
  private readonly options: Required<StreamOptions>;

  constructor(options: StreamOptions = {}) {
    super();
    this.options = { path: "auto", loop: true, rendition: null, ...options };
    this.worker.onmessage = (event: MessageEvent<FromWorker>): void => this.receive(event.data);
    // Without a message, it has not even begun.
    this.worker.onerror = ({ message }: Partial<ErrorEvent>): void =>
      this.fail(message ? `The player's worker failed: ${message}.` : FORBIDDEN);
  }

  /** Opens a stream by the URL of its folder, its manifest or its one file (`.v3s`), from files that the page itself holds,
   * or from a file on this computer; closes the one before. StreamError: there is no stream, or it cannot be decoded here. */
  open(source: StreamSource): Promise<StreamInfo> {
    this.rejectAll("Another stream was opened.");
    this.info = this.failure = null;
    this.leftOut.clear();
    this.fetched = NOTHING;
    const inPage = "document" in globalThis;
    const url = typeof source === "string" ? new URL(source, inPage ? document.baseURI : location.href).href : null;
    const early = inPage && url !== null ? takeEarlyFiles(url) : {};
    const { options, maxTexture } = this;
    this.request({ type: "open", number: ++this.number, source: url ?? source, early, maxTexture, ...options }, Object.values(early));
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
      this.request({ type: "present", frame, axis: null, seek });
    });
  }

  /** Sends a message to the worker. */
  request(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  /** Returns memory that is no longer needed, such as `splats.means.buffer`; its arrays are empty afterwards. */
  recycle(...buffers: ArrayBuffer[]): void {
    this.request({ type: "recycle", buffers }, buffers);
  }

  close(): void {
    this.worker.terminate();
    void this.videos?.then((videos) => videos.dispose());
    this.rejectAll("The stream was closed.");
    this.removeAll();
  }

  private fail(message: string): void {
    this.failure = message;
    this.rejectAll(message);
    this.emit("failed", message);
  }

  private async openVideo(video: Video): Promise<void> {
    this.videos ??= import("./video_reader.ts").then(({ VideoReader: Reader }) => new Reader());
    try {
      (await this.videos).open(video);
    } catch (error) {
      this.fail(messageOf(error));
    }
  }

  private rejectAll(message: string): void {
    const error = new StreamError(message);
    this.opening?.reject(error);
    this.opening = null;
    for (const { reject } of this.asked) reject(error);
    this.asked = [];
  }

  private receive(message: FromWorker): void {
    if (message.number !== this.number) return; // of a stream before
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
        const { groups } = this.info!;
        const { group, message: why } = message.value;
        if (this.leftOut.has(group)) return;
        this.leftOut.set(group, why);
        const lost = this.asked.filter(({ frame }) => groupOfFrame(groups, frame) === group);
        this.asked = this.asked.filter((one) => !lost.includes(one));
        for (const { reject } of lost) reject(new StreamError(why));
        if (this.leftOut.size < groups.length) break;
        this.fail(why);
        return;
      }
      case "fetched":
        this.fetched = message.value;
        break;
      case "failed":
        this.fail(message.value);
        return;
      case "path":
        this.path = message.value;
        break;
      case "video":
        if ("document" in globalThis) void this.openVideo(message.value);
        else this.fail("The decoder video needs a page, not a worker; webcodecs needs a secure (HTTPS) page.");
        return;
    }
    this.emit(message.type, message.value);
  }
}
