/** The stream's sound, in an <audio> element, or in memory where it loops. While it plays, its clock leads the frames:
 * listeners notice a gap in the sound sooner than a late frame. The element keeps the pitch at other speeds. */

import { messageOf } from "../stream/errors.ts";
import { LoopSound } from "./loop_sound.ts";

const LONGEST_LOOP = 120; // seconds; two minutes take 46 MB
const STUCK = 2000; // milliseconds without progress after which the element no longer leads

export class Sound {
  readonly element = new Audio();
  private address: string | null = null;
  /** Seconds of the stream at which the sound starts, and its duration. */
  private start = 0;
  private length = 0;
  private active = false; // the element has been started for the current run of frames
  private failed = false;
  private loop: LoopSound | null = null;
  /** Whether `loop` plays, rather than the element. */
  private gapless = false;
  private looping_ = false;
  /** Whether it is silent because the browser lets it play only after the viewer has touched the page. */
  blocked = false;
  private refused = false; // it may not even play muted
  private lastTime = 0;
  private progressAt = 0;

  /** `changed`: whether it is heard has changed. `notice`: gets sentences for the viewer. */
  constructor(private readonly changed: () => void, private readonly notice: (message: string) => void) {
    this.element.preload = "auto";
    this.element.addEventListener("error", () => {
      if (this.address !== null) this.fail(this.element.error?.message ?? "");
    });
  }

  /** Whether there is sound that can be played. */
  get present(): boolean {
    return this.address !== null && !this.failed;
  }

  get muted(): boolean {
    return this.element.muted;
  }

  /** Call with `false` while handling an input of the viewer, since browsers may require one. */
  set muted(muted: boolean) {
    this.setMuted(muted);
    if (!muted) this.loop?.resume();
    if (!muted && this.blocked) {
      this.blocked = this.refused = false;
      this.halt(); // the next `follow` starts it, now with the viewer's consent
    }
    this.changed();
  }

  private setMuted(muted: boolean): void {
    this.element.muted = muted;
    if (this.loop !== null) this.loop.muted = muted;
  }

  /** Whether it starts over at the end of the frames. */
  set looping(looping: boolean) {
    this.looping_ = looping;
    if (!looping && this.gapless) this.halt();
  }

  /** `start`: seconds of the stream at which it starts. `length`: its duration, seconds. `frames`: duration of the frames,
   * seconds. */
  load(file: Blob, start: number, length: number, frames: number): void {
    this.clear();
    if (frames <= LONGEST_LOOP && "AudioContext" in window) this.loop = new LoopSound(file, start, frames);
    this.setMuted(this.muted);
    this.address = URL.createObjectURL(file);
    [this.start, this.length] = [start, length];
    this.failed = false;
    this.element.src = this.address;
    this.changed();
  }

  /** Forgets the sound of a stream. */
  clear(): void {
    this.halt();
    this.loop?.dispose();
    this.loop = null;
    if (this.address === null) return;
    URL.revokeObjectURL(this.address);
    this.address = null;
    this.element.removeAttribute("src");
    this.element.load();
    this.changed();
  }

  /** Plays along with the frames from `seconds` of the stream on, and returns the time of the stream that is heard now; null
   * if nothing is, so that another clock has to lead. Call it often; after `halt`, it starts at `seconds`. */
  follow(seconds: number, speed: number): number | null {
    const { element, loop } = this;
    const at = seconds - this.start;
    if (!this.present || this.refused) return null;
    if (this.active && this.gapless && speed !== 1) this.halt();
    if (!this.active) {
      loop?.resume();
      this.gapless = this.looping_ && speed === 1 && loop?.ready === true;
    }
    if (this.gapless) {
      if (!this.active) loop!.play(seconds);
      return this.progress(loop!.time);
    }
    if (at < 0 || at >= this.length || (this.active && element.ended)) return null;
    if (element.playbackRate !== speed) element.playbackRate = speed;
    if (!this.active) {
      element.currentTime = at;
      this.begin();
    }
    // `currentTime` is the target while the element is still seeking or starting: the frames wait for it.
    return this.progress(this.start + element.currentTime);
  }

  /** The time that is heard; null if it does not progress. */
  private progress(time: number): number | null {
    const now = performance.now();
    if (!this.active || time !== this.lastTime) [this.lastTime, this.progressAt] = [time, now];
    this.active = true;
    return now - this.progressAt > STUCK ? null : time;
  }

  /** The frames start over. */
  lap(): void {
    if (this.active && this.gapless) this.loop!.lap();
    else this.halt();
  }

  /** Pauses until the next `follow`. */
  halt(): void {
    if (!this.active) return;
    this.active = this.gapless = false;
    this.element.pause();
    this.loop?.halt();
  }

  private begin(): void {
    const { muted } = this.element; // may change before the browser answers
    this.element.play().catch((error: unknown) => {
      // AbortError: paused or loaded again before it started.
      if (!(error instanceof DOMException) || error.name === "AbortError") return;
      if (error.name !== "NotAllowedError") {
        this.fail(messageOf(error));
        return;
      }
      // Browsers refuse sound before the first input, but not silence: it still leads.
      this.active = false;
      if (muted) {
        this.refused = true;
        return;
      }
      this.blocked = this.element.muted = true;
      this.changed();
    });
  }

  private fail(reason: string): void {
    this.failed = true;
    this.halt();
    this.notice(`This browser cannot play the stream's sound${reason === "" ? "" : ` (${reason})`}.`);
    this.changed();
  }
}
