/** Points at places in the image: of the note that is being written, and of the marks of the frame on the screen. */

import type { Player } from "../player/player.ts";
import { add, centerOf, dot, middleOf, type Pinhole, placeIn } from "../render/camera.ts";
import type { Vector } from "../stream/metadata.ts";
import { make } from "./dom.ts";

const NEAR = 8; // pixels that a finger may move in a tap

/** The world point behind a place in the image, at the depth of another point. */
export function pointAt(pinhole: Pinhole, x: number, y: number, near: Vector): Vector {
  const { rotation: r, fx, fy, cx, cy } = pinhole;
  const eye = centerOf(pinhole);
  const depth = Math.max(dot(r.slice(6, 9) as unknown as Vector, add(near, eye, -1)), 1e-3);
  const [a, b] = [((x - cx) / fx) * depth, ((y - cy) / fy) * depth];
  return [0, 1, 2].map((k) => eye[k] + r[k] * a + r[3 + k] * b + r[6 + k] * depth) as unknown as Vector;
}

interface Pinned {
  readonly frame: number;
  readonly view: { readonly place?: Vector | null } | null;
}

export class Pins {
  private readonly layer = make("div", { class: "pins" });
  private marks: readonly Pinned[] = [];
  private writing = false;
  /** The place of the note that is being written; null for none. */
  chosen: Vector | null = null;

  constructor(private readonly player: Player) {
    const stage = player.canvas.parentElement!;
    stage.append(this.layer);
    let began: PointerEvent | null = null;
    // Before the view and the comparison, which may keep the events to themselves.
    stage.addEventListener("pointerdown", (event) => {
      began = event;
    }, { capture: true });
    stage.addEventListener("pointerup", (event) => {
      const moved = began === null ? Infinity : Math.hypot(event.clientX - began.clientX, event.clientY - began.clientY);
      if (this.writing && moved < NEAR) this.choose(event.clientX, event.clientY);
    }, { capture: true });
    player.on("rendered", () => this.draw());
    player.on("frame", () => this.draw());
  }

  /** Lets the viewer choose a place, beginning with this one. */
  begin(place: Vector | null): void {
    [this.writing, this.chosen] = [true, place];
    this.draw();
  }

  end(): void {
    [this.writing, this.chosen] = [false, null];
    this.draw();
  }

  show(marks: readonly Pinned[]): void {
    this.marks = marks;
    this.draw();
  }

  private choose(x: number, y: number): void {
    const { left, top, width, height } = this.layer.getBoundingClientRect();
    const { info, screen } = this.player;
    const pinhole = screen.pinhole();
    if (info === null || width === 0 || height === 0) return;
    const [u, v] = [((x - left) / width) * pinhole.width, ((y - top) / height) * pinhole.height];
    this.chosen = pointAt(pinhole, u, v, middleOf(info.box));
    this.draw();
  }

  private draw(): void {
    const { player } = this;
    const pinhole = player.screen.pinhole();
    const noted = this.marks.flatMap(({ frame, view }) => (frame === player.frame && view?.place ? [view.place] : []));
    const places = this.writing ? (this.chosen === null ? [] : [this.chosen]) : noted;
    const pins = places.map((point) => placeIn(pinhole, point)).filter((place) => place !== null);
    // The elements stay: this is called for each image.
    while (this.layer.childElementCount > pins.length) this.layer.lastElementChild!.remove();
    while (this.layer.childElementCount < pins.length) this.layer.append(make("i"));
    for (const [k, [x, y]] of pins.entries()) {
      const { style } = this.layer.children[k] as HTMLElement;
      style.left = `${((100 * x) / pinhole.width).toFixed(2)}%`;
      style.top = `${((100 * y) / pinhole.height).toFixed(2)}%`;
    }
  }
}
