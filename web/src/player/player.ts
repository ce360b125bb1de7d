/**
 * The player without controls: a worker that decodes and sorts, a renderer, and a clock that determines which frame is
 * due. The main thread only uploads and draws.
 */

import { centerOf, depthAxis, OrbitCamera, type PartialView, type Pinhole, pinholeOf, type View, visibility } from "../render/camera.ts";
import type { Renderer } from "../render/renderer.ts";
import { messageOf } from "../stream/errors.ts";
import { groupOfFrame } from "../stream/manifest.ts";
import type { Camera, Vector } from "../stream/metadata.ts";
import type { EmbeddedFiles } from "../worker/embedded.ts";
import type { DecodePath, DepthAxis, FromWorker, GroupSetup, Picture, StreamInfo, ToWorker } from "../worker/messages.ts";
import { takeEarlyFiles } from "./early_files.ts";
import { Emitter } from "./events.ts";
import { type Course, dueFrame, playable } from "./schedule.ts";
import { Screen } from "./screen.ts";
import { Sound } from "./sound.ts";
import { Statistics } from "./statistics.ts";
import { VideoReader } from "./video_reader.ts";
import { takeWorker } from "./spare_worker.ts";

/** Relative change of the view that triggers another sort. */
const SORT_AGAIN = 1e-3;
/** Milliseconds to wait for a frame before the clock stops, and before the stall is reported and the sound stops, too. */
const GRACE = 120;
const TELL = 500;
/** No view has this axis: the next view is sorted for. */
const UNSORTED: DepthAxis = [0, 0, 0, 0];

interface Requested {
  readonly frame: number;
  /** When, in milliseconds. */
  readonly at: number;
  readonly seek: boolean;
  /** Frames to subtract from the clock when it is shown: the stream's length if playback has looped. */
  readonly lap: number;
  /** Along which its splats are sorted. */
  readonly axis: DepthAxis;
}

export interface PlayerOptions {
  readonly path?: DecodePath | "auto";
  readonly loop?: boolean;
}

export class Player extends Emitter {
  readonly camera = new OrbitCamera();
  readonly statistics = new Statistics();
  private readonly screen: Screen;
  readonly sound = new Sound({
    changed: () => this.emit("sound", undefined),
    notice: (message) => this.emit("notice", message),
  });
  info: StreamInfo | null = null;
  path: DecodePath | null = null;
  bandwidth = 0;
  receivedBytes = 0;
  fetchedGroups: readonly number[] = [];
  readonly leftOut = new Map<number, string>();
  private readonly worker: Worker;
  private readonly videos: VideoReader;
  private readonly stop = new AbortController();
  private playing_ = false;
  private loop_: boolean;
  private speed_ = 1;
  /** Clock position in frames. */
  private position = 0;
  private lastTick: number | null = null;
  private lastShownAt: number | null = null;
  /** Frame and splats on the canvas. */
  private shown: { frame: number; count: number; group: number } | null = null;
  private requested: Requested | null = null;
  /** The next frame, which is not due yet. */
  private ready: { readonly picture: Picture; readonly requested: Requested } | null = null;
  private waiting = false;
  /** Axis along which the frame on the canvas was sorted, or is being sorted. */
  private sortedAxis: DepthAxis = UNSORTED;
  private sorting = false;
  /** Number of the last sort request. */
  private sortRequest = 0;
  private handle = 0;
  private failed = false;
  /** Another bake has taken the stream's place. */
  private updated = false;

  /** @throws StreamError - the browser cannot render */
  constructor(readonly canvas: HTMLCanvasElement, private readonly options: PlayerOptions = {}) {
    super();
    this.loop_ = options.loop ?? true;
    this.screen = new Screen(canvas, this.camera, this.statistics, {
      rendered: () => this.emit("rendered", { frame: this.frame }),
      view: (view) => this.emit("view", view),
    });
    this.worker = takeWorker();
    this.videos = new VideoReader((message, transfer) => this.post(message, transfer));
    this.worker.onmessage = (event: MessageEvent<FromWorker>) => {
      const began = performance.now();
      this.receive(event.data);
      this.handlerTime += performance.now() - began;
    };
    this.worker.onerror = (event) => this.fail(`The player's worker failed: ${event.message}.`);
    const { signal } = this.stop;
    canvas.addEventListener("webglcontextrestored", () => this.restore(), { signal });
    document.addEventListener("visibilitychange", () => {
      // Hidden pages get no animation frames; the clock must not advance in the meantime.
      this.lastTick = this.lastShownAt = null;
      this.sound.halt();
      this.screen.forget();
    }, { signal });
    this.handle = requestAnimationFrame(this.tick);
  }

  private handlerTime = 0;

  /** The renderer of the page while an immersive session has its own. */
  private outside: Renderer | null = null;
  /** The center of the viewer's head in an immersive session. */
  private head: Pinhole | null = null;

  /** Draws no more to the page: an immersive session draws, with its own renderer, and advances the clock. */
  enterImmersion(renderer: Renderer): void {
    cancelAnimationFrame(this.handle);
    this.outside = this.screen.renderer;
    this.change(renderer);
  }

  /** Advances the clock to `now`, and sorts for the center of the head; the session draws. */
  advanceImmersion(now: number, head: Pinhole): void {
    this.head = head;
    this.advance(now);
    this.follow();
  }

  /** Draws to the page again. */
  leaveImmersion(): void {
    this.head = null;
    this.screen.renderer.dispose();
    const renderer = this.outside;
    this.outside = null;
    if (renderer === null || this.stop.signal.aborted) return;
    this.change(renderer);
    this.screen.dirty = true;
    this.handle = requestAnimationFrame(this.tick);
  }

  /** Uses another renderer, to which everything must be sent again. */
  private change(renderer: Renderer): void {
    this.screen.renderer = renderer;
    this.lastTick = this.lastShownAt = null;
    this.screen.forget();
    if (this.info === null) return;
    renderer.prepare(this.info.profile, this.info.shDegree);
    this.restore();
  }

  /**
   * Opens a stream by the URL of its folder, its manifest or its one file (`.v3s`), from files that the page itself
   * holds, or from a file on this computer.
   */
  open(address: string, files: EmbeddedFiles | null = null, archive: File | null = null): void {
    this.info = this.group = null;
    this.shown = this.ready = this.requested = null;
    this.failed = this.updated = false;
    if (this.handle === 0) this.handle = requestAnimationFrame(this.tick);
    this.position = 0;
    this.leftOut.clear();
    this.fetchedGroups = [];
    this.sound.clear();
    const url = new URL(address, document.baseURI).href;
    const early = files === null && archive === null ? takeEarlyFiles(url) : null;
    const path = this.options.path ?? "auto";
    const { maxTexture } = this.screen.renderer;
    this.post({ type: "open", url, files, archive, early, path, maxTexture, loop: this.loop_ }, early === null ? [] : [early.port]);
    this.tellPlaying();
  }

  private tellPlaying(): void {
    this.post({ type: "playing", playing: this.playing_ });
  }

  private courseOf({ groups, frameCount, live }: StreamInfo): Course {
    // Looping begins when a live stream is complete.
    return { groups, frameCount, live, looping: this.loop_ && !live, leftOut: this.leftOut };
  }

  /** Goes to the newest group of a live stream. */
  seekLive(): void {
    const last = this.info?.groups.at(-1);
    if (last !== undefined) this.seekFrame(last.firstFrame);
  }

  get playing(): boolean {
    return this.playing_;
  }

  play(): void {
    if (this.playing_ || this.failed) return;
    const { info } = this;
    // At the end, playback starts over.
    if (info !== null && this.shown !== null && dueFrame(this.courseOf(info), this.shown.frame + 1) === "end") this.seekFrame(0);
    this.playing_ = true;
    this.tellPlaying();
    this.lastTick = null;
    // Within the viewer's input, if it is one: some browsers start sound only then.
    if (info !== null && this.shown !== null && this.requested?.seek !== true) this.sound.follow(this.position / info.fps, this.speed_);
    this.emit("play", undefined);
  }

  pause(): void {
    if (!this.playing_) return;
    this.playing_ = false;
    this.tellPlaying();
    this.sound.halt();
    if (this.shown !== null && this.requested?.seek !== true) this.position = this.shown.frame;
    this.emit("pause", undefined);
  }

  get loop(): boolean {
    return this.loop_;
  }

  set loop(loop: boolean) {
    this.loop_ = loop;
    this.sound.looping = loop && this.info?.live !== true;
    this.post({ type: "loop", loop });
  }

  /** Playback speed relative to the stream's frame rate, 0.1 to 4. */
  get speed(): number {
    return this.speed_;
  }

  set speed(speed: number) {
    this.speed_ = Math.max(0.1, Math.min(4, speed));
  }

  get frame(): number {
    return this.shown?.frame ?? Math.floor(this.position);
  }

  get seconds(): number {
    return this.info === null ? 0 : this.frame / this.info.fps;
  }

  get duration(): number {
    return this.info === null ? 0 : this.info.frameCount / this.info.fps;
  }

  /** Number of splats on the canvas, and of the whole frame. */
  get splats(): { drawn: number; all: number } {
    return { drawn: this.shown?.count ?? 0, all: this.group?.splats ?? 0 };
  }

  /** What the frame on the canvas is from: its group, in the rendition that was chosen for it. */
  group: Pick<GroupSetup, "rendition" | "bytes" | "frames" | "splats" | "shDegree"> | null = null;

  get drawSize(): readonly number[] {
    return this.screen.size;
  }

  seek(seconds: number): void {
    if (this.info !== null) this.seekFrame(Math.floor(seconds * this.info.fps + 1e-6));
  }

  seekFrame(frame: number): void {
    const { info } = this;
    if (info === null) return;
    const inside = Math.max(0, Math.min(info.frameCount - 1, Math.round(frame)));
    const target = playable(this.courseOf(info), inside);
    if (target === null) return;
    this.position = target;
    this.sound.halt();
    if (this.ready !== null) this.recycle(this.ready.picture);
    this.ready = null;
    this.request(target, true);
  }

  get background(): Vector | null {
    return this.screen.background;
  }

  /** RGB, 0 to 1; null for a transparent background. */
  set background(color: Vector | null) {
    this.screen.background = color;
  }

  get view(): View {
    return this.camera.view;
  }

  /** The camera of the image on the canvas, in pixels of any size. */
  get pinhole(): Pinhole {
    return this.screen.pinhole();
  }

  /** How much of the image to show from this view, 0 to 1: below 1, no camera filmed from near here. */
  get visibility(): number {
    const range = this.info?.viewRange ?? null;
    return range === null ? 1 : visibility(range, centerOf(this.screen.pinhole()));
  }

  set view(view: PartialView) {
    this.camera.view = { ...this.camera.view, ...view };
    this.screen.fixed = null;
  }

  /** Call after moving the camera. */
  moved(): void {
    this.screen.fixed = null;
  }

  /** Looks through the given camera, whose image fills the canvas; null returns to the orbit camera. */
  set fixedCamera(camera: Camera | null) {
    this.screen.fixedCamera = camera;
  }

  /**
   * Renders the current frame from a camera and returns the pixels: RGBA, top row first. Sorts for that camera first.
   */
  async snapshot(camera: Camera, background: Vector = [0, 0, 0]): Promise<ImageData> {
    const before = this.screen.fixed;
    const pinhole = pinholeOf(camera);
    this.screen.fixed = pinhole;
    const sorted = new Promise<void>((resolve) => {
      this.snapshotSorted = resolve;
    });
    this.requestSort(depthAxis(pinhole));
    await sorted;
    const pixels = this.screen.renderer.snapshot(pinhole, background);
    this.screen.fixed = before;
    this.sortedAxis = UNSORTED;
    return new ImageData(pixels, camera.width, camera.height);
  }

  private snapshotSorted: (() => void) | null = null;

  dispose(): void {
    cancelAnimationFrame(this.handle);
    this.stop.abort();
    this.worker.terminate();
    this.videos.dispose();
    this.sound.dispose();
    this.screen.dispose();
    this.removeAll();
  }

  private post(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  private fail(message: string): void {
    this.failed = true;
    this.playing_ = false;
    this.sound.halt();
    this.emit("failed", message);
  }

  private receive(message: FromWorker): void {
    switch (message.type) {
      case "opened":
        this.opened(message.info);
        break;
      case "picture":
        this.arrived(message.picture);
        break;
      case "order":
        // Only the last sort is for the current view.
        if (message.request === this.sortRequest) this.sorting = false;
        if (message.frame === this.shown?.frame) {
          this.screen.renderer.setOrder(message.order, message.count);
          this.shown.count = message.count;
          this.statistics.sort.add(message.sort);
          this.screen.dirty = true;
        }
        this.post({ type: "recycle", buffers: [message.order.buffer] }, [message.order.buffer]);
        if (!this.sorting) {
          this.snapshotSorted?.();
          this.snapshotSorted = null;
        }
        break;
      case "grown":
        this.info = message.info;
        this.emit("grown", message.info);
        break;
      case "improved":
        if (!this.playing_ && this.shown?.group === message.group && this.requested === null)
          this.request(this.shown.frame, true);
        break;
      case "left-out":
        this.left(message.group, message.message);
        break;
      case "fetched":
        this.bandwidth = message.bandwidth;
        this.receivedBytes = message.bytes;
        this.fetchedGroups = message.groups;
        this.emit("fetched", { groups: message.groups });
        break;
      case "failed":
        this.fail(message.message);
        break;
      case "rebaked":
        this.updated = true;
        this.setWaiting(false);
        this.emit("updated", undefined);
        break;
      case "trouble":
        this.emit("notice", message.message);
        break;
      case "path":
        this.path = message.path;
        break;
      case "sound":
        this.sound.looping = this.loop_ && this.info?.live !== true;
        this.sound.load(message.file, message.start, message.length, this.duration);
        break;
      default:
        this.videos.receive(message);
    }
  }

  private opened(info: StreamInfo): void {
    this.info = info;
    this.camera.frame(info.box, info.camera, info.up);
    if (info.background !== null) this.screen.background = info.background;
    this.screen.resolution.budget = 1000 / Math.min(60, Math.max(30, info.fps));
    this.screen.dirty = true;
    this.emit("opened", info);
    if (this.requested === null) this.request(Math.floor(this.position), true);
    // The driver compiles while the first image is fetched and decoded.
    this.screen.renderer.prepare(info.profile, info.shDegree);
  }

  private request(frame: number, seek: boolean, lap = 0): void {
    // Sorted for the current camera: at most one frame old when it is drawn.
    const axis = depthAxis(this.head ?? this.screen.pinhole());
    this.requested = { frame, at: performance.now(), seek, lap, axis };
    this.post({ type: "present", frame, axis, seek });
  }

  private arrived(picture: Picture): void {
    const { requested } = this;
    if (picture.setup !== null) this.setups.set(picture.group, picture.setup);
    // After a change of the renderer, an image for the one before may still arrive.
    const usable = !this.needsSetup || this.setups.has(picture.group);
    if (requested?.frame !== picture.frame || !usable) {
      this.recycle(picture);
      return;
    }
    this.needsSetup = false;
    this.requested = null;
    const { decode, dequantize, sort } = picture.timings;
    this.statistics.decode.add(decode);
    this.statistics.dequantize.add(dequantize);
    this.statistics.sort.add(sort);
    if (requested.seek) {
      this.show(picture, performance.now(), requested.axis);
      this.emit("seeked", { frame: picture.frame });
    } else this.ready = { picture, requested };
  }

  /** Setups that came with images that have not been shown yet: one or two. */
  private readonly setups = new Map<number, NonNullable<Picture["setup"]>>();

  /** Whether the renderer is new, or its contents were lost, and images are of no use before their group's setup has come. */
  private needsSetup = false;

  private show(picture: Picture, now: number, axis: DepthAxis): void {
    const { renderer } = this.screen;
    const began = performance.now();
    const setup = this.setups.get(picture.group);
    if (setup !== undefined) {
      renderer.setGroup(setup);
      const { rendition, bytes, frames, splats, shDegree } = setup;
      this.statistics.prepare.add(setup.prepare);
      this.group = { rendition, bytes, frames, splats, shDegree };
      this.setups.clear();
    }
    renderer.setPicture(picture);
    this.sortedAxis = axis;
    this.sorting = false;
    this.statistics.upload.add(performance.now() - began);
    const first = this.shown === null;
    this.shown = { frame: picture.frame, count: picture.count, group: picture.group };
    this.statistics.shown++;
    this.count(picture.group);
    if (this.lastShownAt !== null && this.playing_) this.statistics.interval.add(now - this.lastShownAt);
    this.lastShownAt = now;
    this.recycle(picture);
    this.screen.dirty = true;
    this.setWaiting(false);
    if (first) {
      this.screen.render(now);
      this.emit("ready", undefined);
    }
    this.emit("frame", { frame: picture.frame, seconds: picture.frame / (this.info?.fps ?? 1) });
  }

  /** Frames of the group on the screen that were shown and dropped, for the choice of renditions. */
  private tally = { group: -1, shown: 0, dropped: 0 };

  private count(group: number): void {
    if (group !== this.tally.group) {
      if (this.tally.group >= 0) this.post({ type: "played", ...this.tally });
      this.tally = { group, shown: 0, dropped: 0 };
    }
    this.tally.shown++;
  }

  private recycle({ luma, order }: Picture): void {
    this.post({ type: "recycle", buffers: [luma.buffer, order.buffer] }, [luma.buffer, order.buffer]);
  }

  private left(group: number, message: string): void {
    const { info } = this;
    if (info === null) return;
    this.leftOut.set(group, message);
    const { firstFrame, frameCount } = info.groups[group];
    if (this.leftOut.size === info.groups.length) {
      this.fail(message);
      return;
    }
    this.emit("notice", `${message} Frames ${firstFrame} to ${firstFrame + frameCount - 1} are skipped.`);
    const { requested } = this;
    if (requested !== null && groupOfFrame(info.groups, requested.frame) === group) {
      const next = playable(this.courseOf(info), requested.frame);
      if (next === null) return;
      const lap = next < requested.frame ? info.frameCount : requested.lap;
      this.position = next + (requested.seek ? 0 : lap);
      this.request(next, requested.seek, requested.seek ? 0 : lap);
    }
  }

  private setWaiting(waiting: boolean): void {
    // Nothing that is missing of a replaced stream will come.
    if (waiting === this.waiting || (waiting && this.updated)) return;
    this.waiting = waiting;
    if (waiting) this.statistics.stalls++;
    this.emit("waiting", waiting);
  }

  private readonly tick = (now: number): void => {
    this.handle = requestAnimationFrame(this.tick);
    const began = performance.now();
    try {
      this.advance(now);
      this.follow();
      if (this.shown !== null) this.screen.update(now, !this.playing_ && this.requested === null);
    } catch (error) {
      this.fail(messageOf(error));
      cancelAnimationFrame(this.handle);
      this.handle = 0;
    }
    if (this.playing_) this.statistics.main.add(performance.now() - began + this.handlerTime);
    this.handlerTime = 0;
  };

  /** Advances the clock, shows the frame that is due, and requests the next. */
  private advance(now: number): void {
    const { info } = this;
    const elapsed = this.lastTick === null ? 0 : Math.min(now - this.lastTick, 250);
    this.lastTick = now;
    if (info === null || this.failed) return;
    if (this.requested !== null && performance.now() - this.requested.at > TELL) this.setWaiting(true);
    if (!this.playing_ || this.shown === null || this.requested?.seek === true || info.frameCount === 1) return;
    const before = this.position;
    // The sound leads where there is some.
    const heard = this.sound.follow(this.position / info.fps, this.speed_);
    this.position = heard === null ? this.position + (elapsed / 1000) * info.fps * this.speed_ : heard * info.fps;
    const next = this.ready?.requested ?? this.requested;
    // Frame numbers continue past the end if the next frame is in the next loop.
    if (next !== null && this.position >= next.frame + next.lap) {
      if (this.ready !== null) {
        const { picture } = this.ready;
        this.ready = null;
        this.position -= next.lap;
        if (next.lap > 0) this.sound.lap();
        this.show(picture, now, next.axis);
        if (next.lap > 0) this.emit("looped", undefined);
      } else if (performance.now() - next.at > (heard === null ? GRACE : TELL)) {
        // The frame is late; the clock and the sound wait for it.
        this.sound.halt();
        this.position = Math.max(before, next.frame + next.lap);
      }
    }
    if (this.ready === null && this.requested === null) this.askNext(info);
  }

  private askNext(info: StreamInfo): void {
    const course = this.courseOf(info);
    const first = this.shown!.frame + 1;
    // Frames that were due while the last one was loading are skipped.
    const due = course.looping ? Math.floor(this.position) : Math.min(Math.floor(this.position), info.frameCount - 1);
    const next = Math.max(first, due);
    this.statistics.dropped += next - first;
    this.tally.dropped += next - first;
    const found = dueFrame(course, next);
    if (found === "end") {
      this.pause();
      this.emit("ended", undefined);
    } else if (found === "wait") {
      // The clock waits for the next group.
      this.position = Math.min(this.position, info.frameCount);
      this.setWaiting(true);
    } else {
      if (found.skips) this.position = found.frame + found.lap;
      else if (found.lap > 0) this.position = Math.min(this.position, info.frameCount + 0.999);
      this.request(found.frame, false, found.lap);
    }
  }

  /** Requests a new sort of the frame on the canvas if the camera has moved since it was sorted. */
  private follow(): void {
    if (this.sorting || this.shown === null || this.requested?.seek === true) return;
    // While frames follow one another quickly, each comes sorted for a recent view.
    if (this.playing_ && this.requested !== null) return;
    const axis = depthAxis(this.head ?? this.screen.pinhole());
    const turned = Math.hypot(axis[0] - this.sortedAxis[0], axis[1] - this.sortedAxis[1], axis[2] - this.sortedAxis[2]);
    const moved = Math.abs(axis[3] - this.sortedAxis[3]);
    if (turned < SORT_AGAIN && moved < SORT_AGAIN * this.camera.distance) return;
    this.sortedAxis = axis;
    this.requestSort(axis);
  }

  private requestSort(axis: DepthAxis): void {
    this.sorting = true;
    this.post({ type: "sort", request: ++this.sortRequest, frame: this.shown?.frame ?? -1, axis });
  }

  /** Called when the graphics context is restored without its contents, and when the renderer has changed. */
  private restore(): void {
    this.needsSetup = true;
    this.post({ type: "forget-setup" });
    this.setups.clear();
    const { frame } = this;
    if (this.ready !== null) this.recycle(this.ready.picture);
    this.ready = null;
    this.request(frame, true);
  }
}
