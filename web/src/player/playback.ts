/** The clock: determines which frame is due, asks for it ahead of time, and follows the sound. */

import type { View } from "../render/camera.ts";
import { messageOf } from "../stream/errors.ts";
import { groupOfFrame } from "../stream/manifest.ts";
import type { StreamEvents, StreamInfo, StreamSource } from "../worker/messages.ts";
import { Emitter } from "./emitter.ts";
import { type Course, dueFrame, playable } from "./schedule.ts";
import type { Sound } from "./sound.ts";
import { Statistics } from "./statistics.ts";
import { type StreamOptions, V3Stream } from "./stream.ts";

/** Milliseconds to wait for a frame before the clock stops, and before the stall is reported and the sound stops, too. */
const GRACE = 120;
const TELL = 500;
const LOOK = 30_000; // milliseconds between two looks whether the stream was baked again

interface Requested {
  readonly frame: number;
  /** When, in milliseconds. */
  readonly at: number;
  readonly seek: boolean;
  /** Frames to subtract from the clock when it is shown: the stream's length if playback has looped. */
  readonly lap: number;
}

/** Events of a player. */
export interface PlayerEvents extends Pick<StreamEvents, "opened" | "grown" | "fetched" | "updated" | "notice" | "failed"> {
  /** The first image is on the canvas. */
  ready: undefined;
  play: undefined;
  pause: undefined;
  /** Another frame is shown. */
  frame: { readonly frame: number; readonly seconds: number };
  seeked: { readonly frame: number };
  /** The canvas was rendered; it can be copied in the handler. */
  rendered: { readonly frame: number };
  /** The end was reached without looping. */
  ended: undefined;
  looped: undefined;
  waiting: boolean;
  view: View;
  /** Sound was loaded, muted, or blocked by the browser; see `Playback.sound`. */
  sound: undefined;
}

/** The place of a frame that is shown. */
export interface Shown {
  readonly frame: number;
  readonly group: number;
}

/** Plays frames as `Content`: sorted images, or splats. */
export abstract class Playback<Content extends Shown> extends Emitter<PlayerEvents> {
  readonly statistics = new Statistics();
  readonly stream: V3Stream;
  /** Loaded with the first sound of a stream; null before. */
  sound: Sound | null = null;
  private muted_ = false;
  protected shown: Shown | null = null; // frame on the screen
  protected requested: Requested | null = null;
  protected failed = false;
  /** Aborted when the player is disposed of. */
  readonly stop = new AbortController();
  /** The next frame, which is not due yet. */
  private ready: { readonly content: Content; readonly requested: Requested } | null = null;
  private playing_ = false;
  private loop_: boolean;
  private speed_ = 1;
  private position = 0; // clock position in frames
  private lastTick: number | null = null;
  private lastShownAt: number | null = null;
  private waiting = false;
  private updated = false; // another bake has taken the stream's place
  /** Frames of the group on the screen that were shown and dropped, for the choice of renditions. */
  private tally = { group: -1, shown: 0, dropped: 0 };

  constructor(options: StreamOptions) {
    super();
    this.loop_ = options.loop ?? true;
    const stream = (this.stream = new V3Stream(options));
    stream.on("opened", (info) => this.opened(info));
    for (const name of ["grown", "fetched", "notice"] as const) stream.on(name, (value) => this.emit(name, value));
    stream.on("failed", (message) => this.fail(message));
    stream.on("leftOut", ({ group, message }) => this.left(group, message));
    stream.on("improved", ({ group }) => {
      if (!this.playing_ && this.shown?.group === group && this.requested === null) this.request(this.shown.frame, true);
    });
    stream.on("updated", () => {
      this.updated = true;
      this.setWaiting(false);
      this.emit("updated", undefined);
    });
    stream.on("sound", (heard) => void this.load(heard));
    // Hidden pages get no animation frames; the clock must not advance in the meantime.
    const { signal } = this.stop;
    document.addEventListener("visibilitychange", () => {
      this.skipTime();
      this.look();
    }, { signal });
    const looking = setInterval(() => this.look(), LOOK);
    signal.addEventListener("abort", () => clearInterval(looking));
  }

  /** Asks the stream for a frame, which `arrived` gets. */
  protected abstract ask(frame: number, seek: boolean): void;

  protected abstract put(content: Content, now: number): void;

  /** The content will not be shown. */
  protected abstract discard(content: Content): void;

  /** Opens a stream; see `V3Stream.open`. */
  open(source: StreamSource): Promise<StreamInfo> {
    this.shown = this.ready = this.requested = null;
    this.failed = this.updated = false;
    this.position = 0;
    this.sound?.clear();
    const opened = this.stream.open(source);
    this.stream.request({ type: "playing", playing: this.playing_ });
    return opened;
  }

  get info(): StreamInfo | null {
    return this.stream.info;
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
    this.stream.request({ type: "playing", playing: true });
    this.lastTick = null;
    // Within the viewer's input, if it is one: some browsers start sound only then.
    if (info !== null && this.shown !== null && this.requested?.seek !== true) this.sound?.follow(this.position / info.fps, this.speed_);
    this.emit("play", undefined);
  }

  pause(): void {
    if (!this.playing_) return;
    this.playing_ = false;
    this.stream.request({ type: "playing", playing: false });
    this.sound?.halt();
    if (this.shown !== null && this.requested?.seek !== true) {
      this.position = this.shown.frame;
      this.setWaiting(false); // what comes next is not shown
    }
    this.emit("pause", undefined);
  }

  get loop(): boolean {
    return this.loop_;
  }

  set loop(loop: boolean) {
    this.loop_ = loop;
    if (this.sound !== null) this.sound.looping = loop && this.info?.live !== true;
    this.stream.request({ type: "loop", loop });
  }

  get muted(): boolean {
    return this.sound?.muted ?? this.muted_;
  }

  /** Call with `false` while handling an input of the viewer, since browsers may require one. */
  set muted(muted: boolean) {
    this.muted_ = muted;
    if (this.sound !== null) this.sound.muted = muted;
    else this.emit("sound", undefined);
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
    this.sound?.halt();
    this.dropReady();
    this.request(target, true);
  }

  /** Goes to the newest group of a live stream. */
  seekLive(): void {
    const last = this.info?.groups.at(-1);
    if (last !== undefined) this.seekFrame(last.firstFrame);
  }

  dispose(): void {
    this.stop.abort();
    this.stream.close();
    this.sound?.clear();
    this.removeAll();
  }

  /** Advances the clock to `now` (milliseconds), shows the frame that is due, and requests the next. */
  advance(now: number): void {
    const { info } = this;
    const elapsed = this.lastTick === null ? 0 : Math.min(now - this.lastTick, 250);
    this.lastTick = now;
    if (info === null || this.failed) return;
    const wanted = this.requested !== null && (this.playing_ || this.requested.seek || this.shown === null);
    if (wanted && performance.now() - this.requested!.at > TELL) this.setWaiting(true);
    if (!this.playing_ || this.shown === null || this.requested?.seek === true || info.frameCount === 1) return;
    const before = this.position;
    // The sound leads where there is some.
    const heard = this.sound?.follow(this.position / info.fps, this.speed_) ?? null;
    this.position = heard === null ? this.position + (elapsed / 1000) * info.fps * this.speed_ : heard * info.fps;
    const next = this.ready?.requested ?? this.requested;
    // Frame numbers continue past the end if the next frame is in the next loop.
    if (next !== null && this.position >= next.frame + next.lap) {
      if (this.ready !== null) {
        const { content } = this.ready;
        this.ready = null;
        this.position -= next.lap;
        if (next.lap > 0) this.sound?.lap();
        this.show(content, now);
        if (next.lap > 0) this.emit("looped", undefined);
      } else if (performance.now() - next.at > (heard === null ? GRACE : TELL)) {
        // The frame is late; the clock and the sound wait for it.
        this.sound?.halt();
        this.position = Math.max(before, next.frame + next.lap);
      }
    }
    if (this.ready === null && this.requested === null) this.askNext(info);
  }

  protected opened(info: StreamInfo): void {
    this.emit("opened", info);
    if (this.requested === null) this.request(Math.floor(this.position), true);
  }

  private async load({ file, start, length }: StreamEvents["sound"]): Promise<void> {
    const { info } = this;
    try {
      const { Sound: Loaded } = await import("./sound.ts");
      if (this.stop.signal.aborted || info !== this.info) return;
      if (this.sound === null) {
        this.sound = new Loaded(() => this.emit("sound", undefined), (message) => this.emit("notice", message));
        this.sound.muted = this.muted_;
      }
    } catch (error) {
      this.emit("notice", `The stream plays without sound: ${messageOf(error)}`);
      return;
    }
    this.sound.looping = this.loop_ && info?.live !== true;
    this.sound.load(file, start, length, this.duration);
  }

  protected fail(message: string): void {
    this.failed = true;
    this.playing_ = false;
    this.sound?.halt();
    this.emit("failed", message);
  }

  protected request(frame: number, seek: boolean, lap = 0): void {
    this.requested = { frame, at: performance.now(), seek, lap };
    this.ask(frame, seek);
  }

  protected arrived(content: Content): void {
    const { requested } = this;
    if (requested?.frame !== content.frame) {
      this.discard(content);
      return;
    }
    this.requested = null;
    if (requested.seek) {
      this.show(content, performance.now());
      this.emit("seeked", { frame: content.frame });
    } else this.ready = { content, requested };
  }

  /** Requests the frame on the screen again. */
  protected requestAgain(): void {
    const { frame } = this;
    this.dropReady();
    this.request(frame, true);
  }

  /** The time since the last frame does not count. */
  protected skipTime(): void {
    this.lastTick = this.lastShownAt = null;
    this.sound?.halt();
  }

  /** A stream that is wholly in memory asks the server for nothing that would show that it was baked again. */
  private look(): void {
    if (this.info !== null && !document.hidden) this.stream.request({ type: "look" });
  }

  private dropReady(): void {
    if (this.ready !== null) this.discard(this.ready.content);
    this.ready = null;
  }

  private courseOf({ groups, frameCount, live }: StreamInfo): Course {
    // Looping begins when a live stream is complete.
    return { groups, frameCount, live, looping: this.loop_ && !live, leftOut: this.stream.leftOut };
  }

  private show(content: Content, now: number): void {
    const first = this.shown === null;
    const { frame, group } = content;
    this.shown = { frame, group };
    this.put(content, now);
    this.statistics.shown++;
    this.count(group);
    if (this.lastShownAt !== null && this.playing_) this.statistics.interval.add(now - this.lastShownAt);
    this.lastShownAt = now;
    this.setWaiting(false);
    if (first) this.emit("ready", undefined);
    this.emit("frame", { frame, seconds: frame / (this.info?.fps ?? 1) });
  }

  private count(group: number): void {
    if (group !== this.tally.group) {
      if (this.tally.group >= 0) this.stream.request({ type: "played", ...this.tally });
      this.tally = { group, shown: 0, dropped: 0 };
    }
    this.tally.shown++;
  }

  private left(group: number, message: string): void {
    const { info } = this;
    if (info === null) return;
    const { firstFrame, frameCount } = info.groups[group];
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
}
