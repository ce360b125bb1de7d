/** The timeline: played, buffered and skipped parts; dragging seeks; a preview of what is under the pointer. */

import type { Emitter } from "../player/emitter.ts";
import type { PlayerEvents } from "../player/playback.ts";
import type { V3Stream } from "../player/stream.ts";
import type { StreamInfo } from "../worker/messages.ts";
import { clock } from "./format.ts";
import type { Thumbnails } from "./thumbnails.ts";
import type { Words } from "./words.ts";

/** The part of a player that a timeline needs. */
export interface Timed {
  readonly info: Pick<StreamInfo, "fps" | "frameCount"> | null;
  readonly frame: number;
  readonly playing: boolean;
  readonly on: Emitter<PlayerEvents>["on"];
  play(): void;
  pause(): void;
  seekFrame(frame: number): void;
}

export class Timeline {
  private readonly track: HTMLElement;
  private readonly buffered: HTMLElement;
  private readonly bubble: HTMLElement;
  private readonly preview: HTMLCanvasElement;
  private dragging = false;
  private resume = false;
  private next: number | null = null;
  private seeking = false;

  /** @param thumbnails - the preview of what is under the pointer; null for none */
  constructor(
    readonly element: HTMLElement,
    private readonly player: Timed,
    private readonly thumbnails: Thumbnails | null,
    private readonly words: Words,
  ) {
    element.innerHTML = `<div class="track"><div class="buffered"></div><div class="played"></div></div><div class="moments"></div><div class="knob"></div><div class="bubble"><canvas hidden></canvas><span></span></div>`;
    this.track = element.querySelector<HTMLElement>(".track")!;
    this.buffered = element.querySelector<HTMLElement>(".buffered")!;
    this.bubble = element.querySelector<HTMLElement>(".bubble")!;
    this.preview = element.querySelector<HTMLCanvasElement>(".bubble canvas")!;
    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || player.info === null) return;
      element.setPointerCapture(event.pointerId);
      this.dragging = true;
      this.resume = player.playing;
      player.pause();
      element.classList.add("dragging");
      this.seek(this.frameAt(event.clientX));
    });
    element.addEventListener("pointermove", (event) => {
      this.hint(event.clientX);
      if (this.dragging) this.seek(this.frameAt(event.clientX));
    });
    const end = (): void => {
      if (!this.dragging) return;
      this.dragging = false;
      element.classList.remove("dragging");
      if (this.resume) player.play();
    };
    element.addEventListener("pointerup", end);
    element.addEventListener("pointercancel", end);
    element.addEventListener("keydown", (event) => {
      const { info } = player;
      if (info === null) return;
      const steps: Partial<Record<string, number>> = {
        ArrowLeft: -1,
        ArrowRight: 1,
        ArrowDown: -1,
        ArrowUp: 1,
        PageDown: -Math.round(info.fps),
        PageUp: Math.round(info.fps),
        Home: -info.frameCount,
        End: info.frameCount,
      };
      const step = steps[event.key];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      player.pause();
      this.seek(player.frame + step);
    });
    player.on("seeked", () => {
      this.seeking = false;
      if (this.next !== null) {
        const next = this.next;
        this.next = null;
        this.seek(next);
      }
    });
    player.on("failed", () => {
      this.seeking = false;
    });
  }

  /** Seeks; during a seek, only the latest request is kept. */
  seek(frame: number): void {
    const { info } = this.player;
    if (info === null) return;
    const inside = Math.max(0, Math.min(info.frameCount - 1, frame));
    this.show(inside);
    if (this.seeking) {
      this.next = inside;
      // A seek may never complete, if its group turns out to be damaged.
      if (performance.now() - this.seekAt < 1500) return;
    }
    this.seeking = true;
    this.seekAt = performance.now();
    this.player.seekFrame(inside);
  }

  private seekAt = 0;

  /** Shows the frame on the canvas. */
  update(frame: number): void {
    if (!this.dragging) this.show(frame);
  }

  /** Shows which groups are in memory and which are skipped. */
  updateBuffered({ info, fetched: { groups }, leftOut }: V3Stream): void {
    if (info === null) return;
    const stops: string[] = [];
    const fetched = new Set(groups);
    info.groups.forEach((group, index) => {
      const color = leftOut.has(index) ? "var(--bad)" : fetched.has(index) ? "var(--buffered)" : "transparent";
      const [from, to] = [group.firstFrame, group.firstFrame + group.frameCount].map(
        (frame) => `${((100 * frame) / info.frameCount).toFixed(2)}%`,
      ) as [string, string];
      stops.push(`${color} ${from} ${to}`);
    });
    this.buffered.style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
  }

  /** Marks frames, such as the worst ones of a review. */
  mark(frames: readonly number[]): void {
    const last = Math.max(1, (this.player.info?.frameCount ?? 1) - 1);
    const moments = frames.map((frame) => {
      const moment = document.createElement("i");
      moment.style.left = `${((100 * frame) / last).toFixed(2)}%`;
      return moment;
    });
    this.element.querySelector(".moments")!.replaceChildren(...moments);
  }

  private show(frame: number): void {
    const { info } = this.player;
    if (info === null) return;
    const part = info.frameCount > 1 ? frame / (info.frameCount - 1) : 0;
    this.element.style.setProperty("--at", String(part));
    this.element.setAttribute("aria-valuemax", String(info.frameCount - 1));
    this.element.setAttribute("aria-valuenow", String(frame));
    this.element.setAttribute(
      "aria-valuetext",
      this.words.place((frame / info.fps).toFixed(1), (info.frameCount / info.fps).toFixed(1), frame),
    );
  }

  private frameAt(x: number): number {
    const box = this.track.getBoundingClientRect();
    const part = Math.max(0, Math.min(1, (x - box.left) / (box.width || 1)));
    return Math.round(part * ((this.player.info?.frameCount ?? 1) - 1));
  }

  private hint(x: number): void {
    const { info } = this.player;
    if (info === null) return;
    const frame = this.frameAt(x);
    this.bubble.querySelector("span")!.textContent = `${clock(frame / info.fps)} · ${frame}`;
    const picture = this.thumbnails?.find(frame) ?? null;
    this.preview.hidden = picture === null;
    if (picture !== null) {
      this.preview.width = picture.width;
      this.preview.height = picture.height;
      this.preview.getContext("2d")?.drawImage(picture, 0, 0);
    }
    // Inside the player also at the ends.
    const half = this.bubble.offsetWidth / 2;
    const at = (this.track.clientWidth * frame) / Math.max(1, info.frameCount - 1);
    this.bubble.style.left = `${Math.max(half, Math.min(this.track.clientWidth - half, at))}px`;
  }
}
