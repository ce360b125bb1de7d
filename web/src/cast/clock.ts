/** The clock of a cast, which its timeline shows. */

import { Emitter } from "../player/emitter.ts";
import type { PlayerEvents } from "../player/playback.ts";
import type { Timed } from "../ui/timeline.ts";
import type { SplatPlayback } from "../player/splat_playback.ts";

const LONGEST = 3600; // seconds after which a cast starts over at the latest
const APART = 0.2; // seconds by which a stream may differ from the clock when all start over

/** A stream and when it begins, in seconds of the clock. */
export interface Part {
  readonly playback: SplatPlayback;
  readonly start: number;
}

/** Streams that have ended start over, until the last one has ended; then all start over. */
export class CastClock extends Emitter<PlayerEvents> implements Timed {
  readonly info: { readonly fps: number; readonly frameCount: number };
  seconds = 0;
  playing = false;

  constructor(private readonly parts: readonly Part[]) {
    super();
    const fps = Math.max(1, ...parts.map(({ playback }) => playback.info!.fps));
    const end = Math.max(0, ...parts.map(({ playback, start }) => start + playback.duration));
    this.info = { fps, frameCount: Math.max(1, Math.round(Math.min(end, LONGEST) * fps)) };
  }

  get frame(): number {
    return Math.min(this.info.frameCount - 1, Math.floor(this.seconds * this.info.fps + 1e-6));
  }

  get duration(): number {
    return this.info.frameCount / this.info.fps;
  }

  play(): void {
    this.playing = true;
    this.emit("play", undefined);
  }

  pause(): void {
    this.playing = false;
    for (const { playback } of this.parts) playback.pause();
    this.emit("pause", undefined);
  }

  seekFrame(frame: number): void {
    this.go(frame / this.info.fps, 0);
    this.emit("seeked", { frame });
  }

  /** Adds seconds while it plays. */
  advance(seconds: number): void {
    if (!this.playing) return;
    if (this.seconds + seconds >= this.duration) this.go(0, APART);
    else this.seconds += seconds;
    // A stream that has not begun shows its first frame.
    for (const { playback, start } of this.parts) if (this.seconds >= start) playback.play();
    this.told();
  }

  private go(seconds: number, apart: number): void {
    this.seconds = seconds;
    for (const { playback, start } of this.parts) {
      const own = Math.max(0, seconds - start) % (playback.duration || 1);
      const off = Math.abs(playback.seconds - own);
      if (seconds < start) playback.pause();
      if (seconds < start || Math.min(off, playback.duration - off) >= apart) playback.seek(own);
    }
    this.told();
  }

  private told(): void {
    this.emit("frame", { frame: this.frame, seconds: this.seconds });
  }
}
