/** An open stream: turns requests for frames into sorted images. */

import { messageOf, Rebaked, StreamError } from "../stream/errors.ts";
import { groupOfFrame, type Manifest, MANIFEST_NAME, onlyGrows } from "../stream/manifest.ts";
import { DepthSorter } from "../stream/sort.ts";
import { ArchiveSource, rangesOf } from "./archive.ts";
import { HttpSource } from "./http.ts";
import type { DepthAxis, EarlyPorts, OpenRequest, Picture, Report, SessionRequest, StreamInfo, StreamSource } from "./messages.ts";
import { Closed, type Luma, PathFailed } from "./pictures.ts";
import { Pool } from "./pool.ts";
import { type Prepared, PreparedGroups } from "./prepared_groups.ts";
import { RateRule } from "./rate_rule.ts";
import { EmbeddedSource, readChecked, type Source } from "./source.ts";
import { splatsOf } from "./splats.ts";
import { GroupStore } from "./store.ts";
import { SetOfStream } from "./set.ts";
import { StreamFiles } from "./stream_files.ts";

/** Seconds between two reads of a live stream's manifest; in between, about the duration of a group. */
const SHORTEST_PAUSE = 0.5;
const LONGEST_PAUSE = 5;

interface Decoded {
  readonly frame: number;
  readonly positions: Float32Array<ArrayBuffer>;
  readonly pixels: Uint32Array;
}

export class Session {
  private readonly pool = new Pool();
  private readonly sorter = new DepthSorter();
  private readonly store: GroupStore;
  private readonly groups: PreparedGroups;
  private readonly set: SetOfStream;
  private wanted: { readonly frame: number; readonly axis: DepthAxis | null } | null = null;
  private running = false;
  /** Cancels waiting for the frame in progress, because another one was requested. */
  private interrupt: (() => void) | null = null;
  /** The last two decoded frames, the newest first: their positions are kept for sorting again. The page requests a frame
   * ahead, so the one on the screen can be either. */
  private readonly decoded: Decoded[] = [];
  private setupSent = -1; // the group whose setup the page has; -1 for none
  /** Prepared groups that were fetched again in a better rendition while they were played. */
  private readonly outdated = new Set<number>();
  private soundWanted = true;
  private own = new Uint32Array(0); // the order of a frame's splats, before those of the set are merged into it

  /** Fetches and validates the manifest. `signal` closes the session. StreamError: the manifest is missing or damaged, or the
   * stream cannot be played here. */
  static async open(report: Report, request: OpenRequest, signal: AbortSignal): Promise<Session> {
    const received = new Received();
    const { source, name } = openSource(request.source, request.early, received, (message) => report("notice", message));
    const files = new StreamFiles(source, name, () => report("updated", undefined), signal);
    files.manifest = await files.read();
    signal.throwIfAborted();
    const session = new Session(report, request, files, received, signal);
    report("opened", streamInfo(files.manifest));
    report("path", session.groups.path);
    if (files.manifest.live) void session.watch();
    return session;
  }

  private constructor(
    private readonly report: Report,
    request: OpenRequest,
    private readonly files: StreamFiles,
    received: Received,
    private readonly signal: AbortSignal,
  ) {
    const { manifest } = files;
    const rates = manifest.renditions.map(({ bandwidth }) => bandwidth);
    const ids = manifest.renditions.map(({ id }) => id);
    const fixed = request.rendition === null ? 0 : ids.indexOf(request.rendition);
    if (fixed < 0) throw new StreamError(`The stream has no rendition "${request.rendition}"; it has ${ids.join(", ")}.`);
    // Files in the page or on this computer need no network: the best rendition, always.
    const remote = typeof request.source === "string";
    const rule = rates.length > 1 && remote && request.rendition === null ? new RateRule(rates) : null;
    const fetched = (): void => {
      this.report("fetched", { groups: [...this.store.files.keys()], bytes: received.bytes, bandwidth: received.bandwidth });
    };
    this.store = new GroupStore(files, rule, fixed, request.maxTexture, fetched, (group) => this.improved(group), signal);
    this.store.loop = request.loop;
    this.groups = new PreparedGroups(this.store, report, this.pool, request.path);
    this.set = new SetOfStream(files, this.groups, report, this.pool, signal);
    signal.addEventListener("abort", () => this.groups.dropAll());
  }

  /** Reads the manifest of a live stream again until it is complete. */
  private async watch(): Promise<void> {
    const { files } = this;
    for (;;) {
      const { fps, frame_count: frameCount, spans } = files.manifest;
      const pause = Math.min(Math.max(frameCount / fps / spans.length, SHORTEST_PAUSE), LONGEST_PAUSE);
      await new Promise((resolve) => setTimeout(resolve, 1000 * pause));
      if (this.signal.aborted) return;
      let manifest: Manifest;
      try {
        manifest = await files.read();
      } catch {
        continue; // the source has retried, and has notified the viewer
      }
      if (manifest.manifest_sha256 === files.manifest.manifest_sha256) continue;
      if (!onlyGrows(files.manifest, manifest)) {
        files.replace();
        return;
      }
      files.manifest = manifest;
      void this.set.bring();
      this.report("grown", streamInfo(manifest));
      void this.store.fetchAhead();
      this.prepareNext();
      if (!manifest.live) return;
    }
  }

  receive(message: SessionRequest): void {
    switch (message.type) {
      case "present":
        // Replaces a request that has not started.
        this.wanted = message;
        if (message.seek) this.interrupt?.();
        if (!this.running) void this.run();
        break;
      case "sort":
        this.sortAgain(message);
        break;
      case "loop":
        this.store.loop = message.loop;
        break;
      case "playing":
        this.store.playing = message.playing;
        void this.store.fetchAhead();
        break;
      case "played":
        this.store.played(message.group, message.shown, message.dropped);
        break;
      case "recycle":
        for (const buffer of message.buffers) this.pool.give(buffer);
        break;
      case "set":
        this.set.shown = message.shown;
        if (!this.soundWanted) void this.set.bring();
        break;
      case "look":
        void this.files.look();
        break;
      case "forget-setup":
        this.setupSent = -1;
    }
  }

  private async run(): Promise<void> {
    this.running = true;
    try {
      while (this.wanted !== null) {
        const { frame, axis } = this.wanted;
        this.wanted = null;
        if (frame >= 0 && frame < this.files.manifest.frame_count) await this.bring(frame, axis);
      }
    } finally {
      this.running = false;
    }
  }

  private async bring(frame: number, axis: DepthAxis | null): Promise<void> {
    const { store, groups } = this;
    const { spans } = this.files.manifest;
    const index = groupOfFrame(spans, frame);
    if (index !== store.playhead && this.outdated.delete(store.playhead)) this.drop(store.playhead);
    store.playhead = index;
    void store.fetchAhead();
    try {
      const within = frame - spans[index].firstFrame;
      const work = groups.get(index).then(async (prepared) => ({ prepared, luma: await prepared.pictures.get(within) }));
      const interrupted = new Promise<null>((resolve) => {
        this.interrupt = (): void => resolve(null);
      });
      const done = await Promise.race([work, interrupted]);
      if (done === null) {
        work.then(({ luma }) => this.pool.give(luma.data), () => undefined);
        return;
      }
      if (axis === null) this.deliverSplats(done.prepared, frame, within, done.luma.data);
      else this.deliverPicture(done.prepared, frame, within, done.luma, axis);
      store.beginAhead();
      this.prepareNext();
      void this.finish(done.prepared);
    } catch (error) {
      if (this.signal.aborted) return;
      if (error instanceof Closed) {
        if (store.files.has(index)) this.wanted ??= { frame, axis }; // it was replaced by a better rendition
        return;
      }
      groups.drop(index);
      if (error instanceof Rebaked) return;
      if (error instanceof PathFailed && groups.changePath()) {
        this.report("path", groups.path);
        this.wanted ??= { frame, axis };
        return;
      }
      this.leaveOut(index, error);
    }
  }

  /** Once a group is complete, of which a picture is shown already, the sound follows. */
  private async finish({ group, complete }: Prepared): Promise<void> {
    try {
      await complete;
    } catch (error) {
      if (this.signal.aborted) return;
      this.drop(group.index);
      if (!(error instanceof Rebaked)) this.leaveOut(group.index, error);
      return;
    }
    if (!this.soundWanted) return;
    void this.bringSound();
    await this.set.bring();
  }

  private deliverSplats({ group, tables }: Prepared, frame: number, within: number, luma: Uint8Array<ArrayBuffer>): void {
    const { splats: count, sh_degree: shDegree, id: rendition, dilation } = group;
    const arrays = splatsOf(tables, within, luma, this.pool);
    this.pool.give(luma);
    this.report("splats", { frame, group: group.index, rendition, count, shDegree, dilation, ...arrays }, [arrays.means.buffer]);
  }

  private deliverPicture(prepared: Prepared, frame: number, within: number, { data: luma, decode }: Luma, axis: DepthAxis): void {
    const { group, tables, milliseconds: prepare } = prepared;
    const began = performance.now();
    const blocks = tables.blocks(within);
    const oldest = this.decoded.length > 1 ? this.decoded.pop()!.positions : null;
    const positions = oldest?.length === 3 * group.splats ? oldest : new Float32Array(3 * group.splats);
    tables.positions(within, luma, blocks, positions);
    const dequantize = performance.now() - began;
    const decoded = { frame, positions, pixels: tables.pixels };
    this.decoded.unshift(decoded);
    const { order, count, sort } = this.sorted(decoded, axis);
    const setup = this.setupSent === group.index ? null : { group, prepare, statics: tables.statics() };
    this.setupSent = group.index;
    const escapes = tables.escapes(within);
    const picture: Picture = {
      frame,
      group: group.index,
      setup,
      luma,
      blocks,
      escapes: escapes.length > 0 ? escapes : null,
      order,
      count,
      timings: { decode, dequantize, sort },
    };
    const moved = [luma, order, blocks, picture.escapes, setup?.statics ?? null];
    this.report("picture", picture, moved.flatMap((array) => array?.buffer ?? []));
  }

  /** Sorts one of the last two decoded frames. */
  private sortAgain({ frame, axis }: Extract<SessionRequest, { type: "sort" }>): void {
    const found = this.decoded.find((one) => one.frame === frame);
    const sorted = found === undefined ? { order: new Uint32Array(0), count: 0, sort: 0 } : this.sorted(found, axis);
    this.report("order", { frame: found?.frame ?? -1, ...sorted }, [sorted.order.buffer]);
  }

  private sorted({ positions, pixels }: Decoded, axis: DepthAxis): { order: Uint32Array<ArrayBuffer>; count: number; sort: number } {
    const began = performance.now();
    const splats = positions.length / 3;
    const { visible: set } = this.set;
    const order = new Uint32Array(this.pool.take(4 * (splats + (set?.size ?? 0))).buffer);
    let count: number;
    if (set === null) count = this.sorter.sort(positions, pixels, axis, order);
    else {
      if (this.own.length !== splats) this.own = new Uint32Array(splats);
      const own = this.sorter.sort(positions, null, axis, this.own);
      count = set.merge(this.own, own, this.sorter.depths, pixels, axis, order);
    }
    return { order, count, sort: performance.now() - began };
  }

  /** Fetches the sound, once the first group is there. */
  private async bringSound(): Promise<void> {
    const { source, manifest: { audio } } = this.files;
    this.soundWanted = false;
    if (audio === null) return;
    try {
      const data = await readChecked(source, audio, this.signal);
      const file = new Blob([data], { type: "audio/mp4" });
      this.report("sound", { file, start: audio.start, length: audio.samples / audio.sample_rate });
    } catch (error) {
      if (!this.signal.aborted) this.report("notice", `The stream plays without sound: ${messageOf(error)}`);
    }
  }

  /** Prepares the group that plays next in advance. */
  private prepareNext(): void {
    const { groups, store } = this;
    const next = store.after(1);
    if (next === null || groups.has(next) || !store.isDecided(next)) return;
    groups.get(next).then(({ pictures }) => pictures.warm(), (error: unknown) => {
      groups.drop(next);
      if (error instanceof StreamError && !(error instanceof PathFailed || error instanceof Rebaked)) this.leaveOut(next, error);
    });
  }

  private improved(group: number): void {
    if (group === this.store.playhead && this.store.playing) {
      this.outdated.add(group); // in use; the next loop shows it
      return;
    }
    this.drop(group);
    this.report("improved", { group });
  }

  /** Prepares the group again when it is requested next, and sends its setup again. */
  private drop(index: number): void {
    this.groups.drop(index);
    if (this.setupSent === index) this.setupSent = -1;
  }

  private leaveOut(group: number, error: unknown): void {
    this.report("leftOut", { group, message: messageOf(error) });
  }
}

/** A count of what has come over the network. */
class Received {
  bytes = 0;
  bandwidth = 0; // Mbit/s; 0 while it is not known

  add(bytes: number, milliseconds: number): void {
    this.bytes += bytes;
    // Short responses measure the round-trip time rather than the bandwidth.
    if (bytes < 20_000) return;
    const rate = (8 * bytes) / Math.max(milliseconds, 1) / 1000;
    this.bandwidth = this.bandwidth === 0 ? rate : 0.7 * this.bandwidth + 0.3 * rate;
  }
}

/** The source of the files, and the manifest's name there. */
function openSource(
  source: StreamSource, early: EarlyPorts, received: Received, trouble: (message: string) => void,
): { source: Source; name: string } {
  if (source instanceof File) return { source: new ArchiveSource(rangesOf(source), source.name), name: MANIFEST_NAME };
  if (typeof source !== "string") return { source: new EmbeddedSource(source), name: MANIFEST_NAME };
  const address = new URL(source);
  if (!["http:", "https:"].includes(address.protocol))
    throw new StreamError(`Streams are played from http and https addresses; found "${address.protocol}".`);
  const packed = /\.v3s$/i.test(address.pathname);
  if (!packed && !address.pathname.endsWith(".json"))
    address.pathname = `${address.pathname.replace(/\/$/, "")}/${MANIFEST_NAME}`;
  const http = new HttpSource(address.href, (...taken) => received.add(...taken), trouble, early);
  const name = address.pathname.slice(address.pathname.lastIndexOf("/") + 1);
  if (!packed) return { source: http, name };
  return { source: new ArchiveSource((...range) => http.readRange(name, ...range), name), name: MANIFEST_NAME };
}

function streamInfo(manifest: Manifest): StreamInfo {
  return {
    fps: manifest.fps,
    frameCount: manifest.frame_count,
    shDegree: manifest.renditions[0].sh_degree,
    totalBytes: manifest.total_bytes,
    renditions: manifest.renditions.map(({ id, splats, sh_degree: shDegree, bandwidth }) => ({ id, splats, shDegree, bandwidth })),
    groups: manifest.spans,
    box: manifest.bounding_box,
    ...manifest.metadata,
    live: manifest.live,
    hasSound: manifest.audio !== null,
    hasSet: manifest.set.length > 0,
    checksums: isSecureContext,
  };
}
