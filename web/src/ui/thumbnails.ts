/** Small copies of frames that were on the canvas, for the timeline's preview. Nothing is decoded or fetched for them. */

import type { Player } from "../player/player.ts";

/** Parts of the timeline with a copy each, and their height in pixels. */
const PARTS = 60;
const HEIGHT = 108;
/** Milliseconds between copies, and at least this many times what the last one took: without a GPU, a copy waits for it. */
const PAUSE = 150;
const RARELY = 50;
const NEAR = 3; // parts to either side in which the nearest copy is looked for

interface Copy {
  readonly picture: HTMLCanvasElement;
  /** The view it was drawn from. */
  readonly view: string;
}

export class Thumbnails {
  private readonly copies = new Map<number, Copy>();
  private next = 0;

  constructor(private readonly player: Player) {
    player.on("opened", () => this.copies.clear());
    player.on("rendered", ({ frame }) => this.take(frame));
  }

  /** The copy of the frame nearest to `frame`; null if none is near. */
  find(frame: number): HTMLCanvasElement | null {
    const part = this.part(frame);
    for (let step = 0; step <= NEAR; step++) {
      const copy = this.copies.get(part - step) ?? this.copies.get(part + step);
      if (copy !== undefined) return copy.picture;
    }
    return null;
  }

  private part(frame: number): number {
    const frames = this.player.info?.frameCount ?? 1;
    return Math.floor((frame * Math.min(PARTS, frames)) / frames);
  }

  private take(frame: number): void {
    const { canvas, camera, background } = this.player;
    const now = performance.now();
    if (now < this.next || canvas.width === 0 || canvas.height === 0) return;
    const part = this.part(frame);
    const view = JSON.stringify([camera.view, canvas.width, canvas.height, background]);
    const old = this.copies.get(part);
    if (old?.view === view) return;
    const picture = old?.picture ?? document.createElement("canvas");
    // The middle of wide and of tall images.
    const aspect = Math.max(0.6, Math.min(4 / 3, canvas.width / canvas.height));
    const [width, height] = [Math.min(canvas.width, canvas.height * aspect), Math.min(canvas.height, canvas.width / aspect)];
    picture.width = Math.round(HEIGHT * aspect);
    picture.height = HEIGHT;
    const [left, top] = [(canvas.width - width) / 2, (canvas.height - height) / 2];
    picture.getContext("2d")?.drawImage(canvas, left, top, width, height, 0, 0, picture.width, picture.height);
    this.copies.set(part, { picture, view });
    const end = performance.now();
    this.next = end + Math.max(PAUSE, RARELY * (end - now));
  }
}
