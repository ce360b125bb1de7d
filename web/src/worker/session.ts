/** An open stream: turns requests for frames into sorted images. */

import { messageOf, StreamError } from "../stream/errors.ts";
import { GroupTable } from "../stream/group_table.ts";
import { groupOfFrame, isMotion, type Manifest, MANIFEST_NAME, type Rendition, type VideoEntry, whatChanged } from "../stream/manifest.ts";
import { MotionTables } from "../stream/motion.ts";
import { planePositions, planesLayout, planeUnits } from "../stream/planes.ts";
import { inflate, parseSideFile } from "../stream/side_file.ts";
import { DepthSorter } from "../stream/sort.ts";
import { warmUp } from "../stream/warm_up.ts";
import { ArchiveSource, rangesOf } from "./archive.ts";
import { CheckedPictures } from "./checked_pictures.ts";
import { demux } from "./demux.ts";
import { EarlyFiles } from "./early_files.ts";
import { type EmbeddedFiles, EmbeddedSource } from "./embedded.ts";
import { HttpSource } from "./http.ts";
import type { DecodePath, DepthAxis, EarlyPort, FromWorker, GroupSetup, Picture, StreamInfo } from "./messages.ts";
import { Closed, PathFailed, type PictureSource, WebCodecsPictures } from "./pictures.ts";
import { PlanesPictures } from "./planes_pictures.ts";
import { Pool } from "./pool.ts";
import { RateRule } from "./rate_rule.ts";
import { demuxSample } from "./sample_video.ts";
import { readChecked, type Source } from "./source.ts";
import { type Files, GroupStore } from "./store.ts";
import { StreamFiles } from "./stream_files.ts";
import { type VideoChannel, VideoElementPictures } from "./video_pictures.ts";

const NEEDS_WEBCODECS =
  "Streams of the profile planes need WebCodecs, which this browser supports only on secure (HTTPS) pages, or not at all.";

/** Seconds between two reads of a live stream's manifest; in between, about the duration of a group. */
const SHORTEST_PAUSE = 0.5;
const LONGEST_PAUSE = 5;
/** Number of groups kept prepared (side file parsed, video demuxed). */
const PREPARED = 3;

interface Prepared {
  readonly group: Rendition;
  readonly tables: MotionTables | null;
  readonly pictures: PictureSource;
  readonly milliseconds: number;
}

interface Decoded {
  readonly frame: number;
  readonly positions: Float32Array<ArrayBuffer>;
  readonly pixels: Uint32Array | null;
}

type Post = (message: FromWorker, transfer?: Transferable[]) => void;

export class Session {
  private readonly pool = new Pool();
  private readonly sorter = new DepthSorter();
  private readonly closing = new AbortController();
  private readonly prepared = new Map<number, Promise<Prepared>>();
  private readonly told = new Set<number>();
  private manifest: Manifest | null = null;
  private store: GroupStore | null = null;
  private stream: StreamFiles | null = null;
  private soundWanted = true;
  private path: DecodePath;
  private readonly mayChangePath: boolean;
  private bandwidth = 0;
  private received = 0;
  private wanted: { frame: number; axis: DepthAxis; seek: boolean } | null = null;
  private running = false;
  /** Cancels waiting for the frame in progress, because another one was requested. */
  private interrupt: (() => void) | null = null;
  /**
   * The last two decoded frames, the newest first: their positions are kept for sorting again. The page requests a frame
   * ahead, so the one on the screen can be either.
   */
  private readonly decoded: Decoded[] = [];
  private setupSent = -1;

  constructor(
    private readonly post: Post,
    private readonly channel: VideoChannel,
    path: DecodePath | "auto",
    private readonly maxTexture: number,
    private loop: boolean,
  ) {
    this.mayChangePath = path === "auto";
    this.path = path !== "auto" ? path : "VideoDecoder" in self ? "webcodecs" : "video";
  }

  /**
   * Fetches and validates the manifest.
   *
   * @param files - the stream's, if the page holds them
   * @param archive - a stream in one file, if it is on this computer
   * @param port - where files arrive that the page has begun to fetch, if there are any
   */
  async open(url: string, files: EmbeddedFiles | null, archive: File | null, port: EarlyPort | null): Promise<void> {
    const address = new URL(url);
    const remote = files === null && archive === null;
    const packed = remote && /\.v3s$/i.test(address.pathname);
    if (remote && !packed && !address.pathname.endsWith(".json"))
      address.pathname = `${address.pathname.replace(/\/$/, "")}/${MANIFEST_NAME}`;
    // Until the first group is there, this thread has nothing else to do.
    void warmUp(() => this.idle && !this.closing.signal.aborted, demuxSample).catch(() => undefined);
    const last = address.pathname.slice(address.pathname.lastIndexOf("/") + 1);
    const name = remote && !packed ? last : MANIFEST_NAME;
    const early = port === null ? null : new EarlyFiles(port);
    let source: Source;
    if (files !== null) source = new EmbeddedSource(files);
    else if (archive !== null) source = new ArchiveSource(rangesOf(archive), archive.name);
    else {
      const http = this.httpSource(address.href, early);
      source = packed ? new ArchiveSource((...range) => http.readRange(last, ...range), last) : http;
    }
    const opened = (this.stream = new StreamFiles(source, name, this.closing.signal));
    const manifest = await opened.manifest(early);
    const { maxTexture } = this;
    this.closing.signal.throwIfAborted();
    checkDevice(manifest, maxTexture);
    if (this.path === "video" && manifest.profile === "planes") throw new StreamError(NEEDS_WEBCODECS);
    this.manifest = manifest;
    const table = new GroupTable(manifest, (page) => opened.sameBake(this.manifest!, () => opened.page(page, manifest)));
    const rates = manifest.renditions.map(({ bandwidth }) => bandwidth);
    this.table = table;
    const choice = {
      // Files in the page or on this computer need no network: the best rendition, always.
      rule: rates.length > 1 && remote ? new RateRule(rates) : null,
      rates,
      ids: manifest.renditions.map(({ id }) => id),
      fps: manifest.fps,
      fits: (group: Rendition): boolean => Math.max(...pictureSize(group)) <= maxTexture,
    };
    this.store = new GroupStore(
      table,
      choice,
      source,
      (reads) => opened.sameBake(this.manifest!, reads),
      () => this.tellFetched(),
      (group) => this.improved(group),
    );
    this.url = address.href;
    this.post({ type: "opened", info: this.info(manifest, table) });
    this.post({ type: "path", path: this.path });
    if (manifest.live) void this.watch(opened);
  }

  private url = "";
  private table: GroupTable | null = null;

  /** Reads the manifest of a live stream again until it is complete. */
  private async watch(stream: StreamFiles): Promise<void> {
    for (;;) {
      const { fps, frame_count: frameCount, spans } = this.manifest!;
      const pause = Math.min(Math.max(frameCount / fps / spans.length, SHORTEST_PAUSE), LONGEST_PAUSE);
      await new Promise((resolve) => setTimeout(resolve, 1000 * pause));
      if (this.closing.signal.aborted) return;
      let manifest: Manifest;
      try {
        manifest = await stream.manifest();
      } catch {
        continue; // the source has retried, and has told the viewer
      }
      const old = this.manifest!;
      if (manifest.manifest_sha256 === old.manifest_sha256) continue;
      const changed = whatChanged(old, manifest);
      if (changed !== null) {
        this.post({ type: "trouble", message: `The live stream was replaced by another one (${changed} differ); reload the page.` });
        return;
      }
      this.manifest = manifest;
      this.table!.grow(manifest);
      this.post({ type: "grown", info: this.info(manifest, this.table!) });
      this.store!.follow(this.playing, this.looping);
      this.prepareNext(this.playing);
      if (!manifest.live) return;
    }
  }

  /** Looping begins when a live stream is complete. */
  private get looping(): boolean {
    return this.loop && this.manifest?.live !== true;
  }

  /** Group of the last requested frame. */
  private playing = 0;

  private improved(group: number): void {
    if (group === this.playing && this.moving) {
      this.outdated.add(group); // in use; the next loop shows it
      return;
    }
    this.drop(group);
    if (this.setupSent === group) this.setupSent = -1;
    this.post({ type: "improved", group });
  }

  private moving = false;
  /** Prepared groups that were fetched again in a better rendition while they were played. */
  private readonly outdated = new Set<number>();

  setPlaying(playing: boolean): void {
    this.moving = playing;
    this.store?.setPlaying(playing);
  }

  played(group: number, shown: number, dropped: number): void {
    this.store?.played(group, shown, dropped);
  }

  private info(manifest: Manifest, table: GroupTable): StreamInfo {
    return {
      url: this.url,
      profile: manifest.profile,
      codec: manifest.codec.name,
      fps: manifest.fps,
      frameCount: manifest.frame_count,
      shDegree: manifest.renditions[0].sh_degree,
      totalBytes: manifest.total_bytes,
      renditions: manifest.renditions.length,
      groups: manifest.spans.map(({ firstFrame, frameCount }, index) => ({
        firstFrame,
        frameCount,
        bytes: table.bytes(index),
        splats: manifest.groups[index]?.renditions[0].splats ?? manifest.renditions[0].splats,
      })),
      box: manifest.bounding_box,
      ...manifest.metadata,
      live: manifest.live,
      hasSound: manifest.audio !== null,
      checksums: this.stream!.checked,
    };
  }

  private httpSource(address: string, early: EarlyFiles | null): HttpSource {
    return new HttpSource(
      address,
      (bytes, milliseconds) => this.count(bytes, milliseconds),
      (message) => this.post({ type: "trouble", message }),
      early,
    );
  }

  close(): void {
    this.closing.abort();
    this.store?.close();
    for (const index of [...this.prepared.keys()]) this.drop(index);
  }

  setLoop(loop: boolean): void {
    this.loop = loop;
  }

  recycle(buffers: readonly ArrayBuffer[]): void {
    for (const buffer of buffers) this.pool.give(buffer);
  }

  /** Retries groups that could not be fetched. */
  retry(): void {
    this.store?.forgive();
    this.told.clear();
  }

  forgetSetup(): void {
    this.setupSent = -1;
  }

  /** Decodes a frame and sorts it; a later call replaces one that has not started. */
  present(frame: number, axis: DepthAxis, seek: boolean): void {
    this.wanted = { frame, axis, seek };
    if (seek) this.interrupt?.();
    if (!this.running) void this.run();
  }

  /** Sorts one of the last two decoded frames. */
  sort(request: number, frame: number, axis: DepthAxis): void {
    const found = this.decoded.find((one) => one.frame === frame);
    if (found === undefined) {
      const none = new Uint32Array(0);
      this.post({ type: "order", request, frame: -1, order: none, count: 0, sort: 0 }, [none.buffer]);
      return;
    }
    const [order, count, milliseconds] = this.sorted(found.positions, found.pixels, axis);
    this.post({ type: "order", request, frame, order, count, sort: milliseconds }, [order.buffer]);
  }

  private async run(): Promise<void> {
    this.running = true;
    try {
      while (this.wanted !== null) {
        const { frame, axis } = this.wanted;
        this.wanted = null;
        await this.bring(frame, axis);
      }
    } finally {
      this.running = false;
    }
  }

  private async bring(frame: number, axis: DepthAxis): Promise<void> {
    const { manifest, store } = this;
    if (manifest === null || store === null || frame < 0 || frame >= manifest.frame_count) return;
    const index = groupOfFrame(manifest.spans, frame);
    if (index !== this.playing && this.outdated.delete(this.playing)) {
      this.drop(this.playing);
      if (this.setupSent === this.playing) this.setupSent = -1;
    }
    this.playing = index;
    store.follow(index, this.looping);
    try {
      const within = frame - manifest.spans[index].firstFrame;
      const work = this.prepare(index).then(async (prepared) => ({
        prepared,
        luma: await prepared.pictures.get(within),
      }));
      const interrupted = new Promise<null>((resolve) => {
        this.interrupt = (): void => resolve(null);
      });
      const done = await Promise.race([work, interrupted]);
      if (done === null) {
        work.then(
          ({ luma }) => this.pool.give(luma.data),
          () => undefined,
        );
        return;
      }
      this.deliver(done.prepared, frame, within, done.luma.data, done.luma.decode, axis);
      this.prepareNext(index);
    } catch (error) {
      if (this.closing.signal.aborted) return;
      if (error instanceof Closed) {
        if (store.has(index)) this.wanted ??= { frame, axis, seek: false }; // it was replaced by a better rendition
        return;
      }
      this.drop(index);
      if (error instanceof PathFailed && this.changePath()) {
        this.wanted ??= { frame, axis, seek: false };
        return;
      }
      this.leaveOut(index, messageOf(error));
    }
  }

  private deliver(
    prepared: Prepared,
    frame: number,
    within: number,
    luma: Uint8Array<ArrayBuffer>,
    decode: number,
    axis: DepthAxis,
  ): void {
    const { group, tables } = prepared;
    const began = performance.now();
    const blocks = tables?.blocks(within) ?? null;
    const oldest = this.decoded.length > 1 ? this.decoded.pop()!.positions : null;
    const positions = oldest?.length === 3 * group.splats ? oldest : new Float32Array(3 * group.splats);
    if (isMotion(group)) tables!.positions(within, luma, blocks!, positions);
    else planePositions(group, luma, positions);
    const dequantize = performance.now() - began;
    const pixels = tables?.pixels ?? null;
    const [order, count, sort] = this.sorted(positions, pixels, axis);
    this.decoded.unshift({ frame, positions, pixels });
    const setup = this.setupSent === group.index ? null : this.setup(prepared);
    this.setupSent = group.index;
    const escapes = tables?.escapes(within) ?? null;
    const picture: Picture = {
      frame,
      group: group.index,
      setup,
      luma,
      blocks,
      escapes: escapes !== null && escapes.length > 0 ? escapes : null,
      order,
      count,
      timings: { decode, dequantize, sort },
    };
    const transfer: Transferable[] = [luma.buffer, order.buffer];
    if (blocks !== null) transfer.push(blocks.buffer);
    if (picture.escapes !== null) transfer.push(picture.escapes.buffer);
    if (setup !== null && setup.statics !== null) transfer.push(setup.statics.buffer);
    this.post({ type: "picture", picture }, transfer);
    if (this.soundWanted) void this.bringSound();
  }

  /** Fetches the sound, once the first image is there. */
  private async bringSound(): Promise<void> {
    this.soundWanted = false;
    const { audio } = this.manifest!;
    if (audio === null) return;
    try {
      const data = await readChecked(this.stream!.source, audio, this.closing.signal);
      const file = new Blob([data], { type: "audio/mp4" });
      this.post({ type: "sound", file, start: audio.start, length: audio.samples / audio.sample_rate });
    } catch (error) {
      if (!this.closing.signal.aborted) this.post({ type: "trouble", message: `The stream plays without sound: ${messageOf(error)}` });
    }
  }

  private sorted(
    positions: Float32Array,
    pixels: Uint32Array | null,
    axis: DepthAxis,
  ): [Uint32Array<ArrayBuffer>, number, number] {
    const began = performance.now();
    const order = new Uint32Array(this.pool.take((4 * positions.length) / 3).buffer);
    const count = this.sorter.sort(positions, pixels, axis, order);
    return [order, count, performance.now() - began];
  }

  private setup({ group, tables, milliseconds }: Prepared): GroupSetup {
    const common = {
      group: group.index,
      rendition: group.id,
      bytes: group.bytes,
      frames: group.frame_count,
      prepare: milliseconds,
      splats: group.splats,
      shDegree: group.sh_degree,
      dilation: group.dilation,
    };
    if (!isMotion(group))
      return {
        ...common,
        ...planesLayout(group),
        profile: "planes",
        units: planeUnits(group),
        statics: null,
        blocks: 0,
        lattice: null,
        mirrored: group.components.slice(0, 3).map((entry) => entry.planes[1].part === "low_mirrored"),
      };
    const units = new Float32Array(2 * group.channels.length);
    group.channels.forEach(({ offset, step }, c) => {
      units[2 * c] = offset - 128 * step;
      units[2 * c + 1] = step;
    });
    return {
      ...common,
      profile: "motion",
      tile: group.tile,
      columns: group.columns,
      rows: group.rows,
      units,
      statics: tables!.statics(),
      blocks: group.blocks.count,
      lattice: {
        min: group.positions.min,
        step: group.positions.step,
        ratio: group.positions.step / group.blocks.radius,
      },
      mirrored: [],
    };
  }

  private prepare(index: number): Promise<Prepared> {
    let prepared = this.prepared.get(index);
    if (prepared === undefined) {
      prepared = this.read(index);
      prepared.catch(() => undefined);
    }
    // Most recently used last.
    this.prepared.delete(index);
    this.prepared.set(index, prepared);
    for (const old of [...this.prepared.keys()].slice(0, -PREPARED)) this.drop(old);
    return prepared;
  }

  /** Prepares the group that plays next in advance. */
  private prepareNext(index: number): void {
    const groups = this.manifest!.spans.length;
    const next = index + 1 < groups ? index + 1 : this.looping ? 0 : -1;
    if (next < 0 || this.prepared.has(next)) return;
    this.prepare(next).then(({ pictures }) => pictures.warm(), (error: unknown) => {
      this.drop(next);
      if (error instanceof StreamError && !(error instanceof PathFailed)) this.leaveOut(next, error.message);
    });
  }

  private drop(index: number): void {
    const prepared = this.prepared.get(index);
    this.prepared.delete(index);
    prepared?.then(
      ({ pictures }) => pictures.close(),
      () => undefined,
    );
  }

  /** Whether no group has been there yet. */
  private idle = true;

  private async read(index: number): Promise<Prepared> {
    const { group, files } = await this.store!.get(index).finally(() => (this.idle = false));
    const began = performance.now();
    if (!isMotion(group)) {
      const videos = group.components.flatMap(({ planes }) => planes);
      const pictures = new PlanesPictures(
        group,
        (plane) => this.openVideo(files, videos[plane], [group.side, group.side], group.frame_count),
        this.pool,
      );
      return { group, tables: null, pictures, milliseconds: performance.now() - began };
    }
    // While this thread reads the side file, others decompress and decode.
    const inflating = inflate(files.get(group.side.path)!, group.side.raw_bytes);
    inflating.catch(() => undefined);
    const pictures = await this.openVideo(files, group.video, pictureSize(group), group.frame_count);
    if (this.path !== "video") pictures.warm();
    try {
      const tables = new MotionTables(group, parseSideFile(await inflating, group));
      return { group, tables, pictures, milliseconds: performance.now() - began };
    } catch (error) {
      pictures.close();
      throw new StreamError(`${group.side.path} is damaged: ${messageOf(error)}.`);
    }
  }

  private async openVideo(
    files: Files,
    video: Pick<VideoEntry, "path" | "checks">,
    size: readonly [number, number],
    frames: number,
  ): Promise<PictureSource> {
    const pictures = await this.openPictures(files, video.path, size, frames);
    return new CheckedPictures(pictures, video.checks, video.path, this.pool);
  }

  private async openPictures(
    files: Files,
    path: string,
    size: readonly [number, number],
    frames: number,
  ): Promise<PictureSource> {
    const codec = this.manifest!.codec.name;
    const data = files.get(path)!;
    const demuxed = await demux(data, path, codec, size, frames);
    if (this.path === "video") {
      return new VideoElementPictures(this.channel, data, demuxed, size, this.pool);
    }
    const config: VideoDecoderConfig = {
      ...demuxed.config,
      optimizeForLatency: true,
      hardwareAcceleration: this.path === "webcodecs" ? "no-preference" : "prefer-software",
    };
    return new WebCodecsPictures(config, demuxed.packets, size, path, this.pool);
  }

  /** Switches to the next decode path, if there is one left. */
  private changePath(): boolean {
    if (!this.mayChangePath) return false;
    if (this.path === "webcodecs") this.path = "webcodecs-software";
    else if (this.path === "webcodecs-software" && this.manifest!.profile === "motion") this.path = "video";
    else return false;
    for (const index of [...this.prepared.keys()]) this.drop(index);
    this.post({ type: "path", path: this.path });
    return true;
  }

  private leaveOut(group: number, message: string): void {
    if (this.told.has(group)) return;
    this.told.add(group);
    this.post({ type: "left-out", group, message });
  }

  private count(bytes: number, milliseconds: number): void {
    this.received += bytes;
    // Short responses measure the round-trip time rather than the bandwidth.
    if (bytes < 20_000) return;
    const rate = (8 * bytes) / Math.max(milliseconds, 1) / 1000;
    this.bandwidth = this.bandwidth === 0 ? rate : 0.7 * this.bandwidth + 0.3 * rate;
  }

  private tellFetched(): void {
    this.post({
      type: "fetched",
      groups: this.store!.present,
      bytes: this.received,
      bandwidth: this.bandwidth,
      cached: this.store!.bytes,
    });
  }
}

/** Width and height of the image that holds all of a group's numbers of one frame. */
function pictureSize(group: Rendition): [number, number] {
  const { tile, columns, rows } = isMotion(group) ? group : planesLayout(group);
  return [columns * tile, rows * tile];
}

/** @throws StreamError - all renditions of a group are too large for this device */
function checkDevice(manifest: Manifest, maxTexture: number): void {
  for (const { renditions } of manifest.groups) {
    const sizes = renditions.map(pictureSize);
    if (sizes.every((size) => Math.max(...size) > maxTexture))
      throw new StreamError(
        `This stream's pictures are ${sizes[0].join("x")}, but this device's GPU supports at most ${maxTexture} pixels on a side.`,
      );
  }
}
