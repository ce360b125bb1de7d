/** Footage of a held-out camera over the player's image from exactly that camera, divided by a line to drag. */

import type { Player } from "../player/player.ts";
import { pixelRatio, resize, sizeOf } from "../render/gl.ts";
import type { Vector } from "../stream/metadata.ts";
import type { ReviewCamera, ReviewServer } from "./api.ts";
import { make } from "../ui/dom.ts";
import { around, cameraOf, type Part, placed, whole, withRoom } from "./framing.ts";
import { Pictures } from "./pictures.ts";
import css from "./wipe.css";
import { WORDS } from "./language.ts";

const GROUND = "#0b0d10";
const STEP = 0.02;

const EDGE = 12; // pixels between a label and the edge of the image

export class Wipe {
  private readonly pictures: Pictures;
  private readonly layer: HTMLElement;
  private readonly canvas = make("canvas");
  private readonly line: HTMLElement;
  private readonly left = make("span");
  private readonly right = make("span", {}, WORDS.video);
  private readonly names: HTMLElement;
  /** The camera that is compared with; null for none. */
  camera: ReviewCamera | null = null;
  private part: Part | null = null;
  private before: Vector | null = null;
  private all = false;
  /** Position of the line, 0 to 1; left of it is the footage. */
  at = 0.5;
  private behind = ""; // the view behind the comparison, as JSON: another one means that it was moved

  /** @param moved - called when the view was moved, which is to end the comparison */
  constructor(
    private readonly player: Player,
    server: ReviewServer,
    private readonly background: Vector,
    moved: () => void,
  ) {
    this.pictures = new Pictures(server, () => this.draw());
    this.line = make("div", {
      role: "slider",
      tabindex: "0",
      "aria-label": WORDS.wipe,
      "aria-valuemin": "0",
      "aria-valuemax": "100",
    });
    this.names = make("div", { class: "names" }, this.left, this.right);
    this.layer = make("div", { class: "wipe", hidden: "" }, make("style", {}, css), this.canvas, this.names, this.line);
    (player.canvas.parentElement ?? document.body).append(this.layer);
    // The view behind must not turn meanwhile.
    for (const name of ["pointerdown", "pointermove", "pointerup", "pointercancel", "wheel", "dblclick", "touchstart", "gesturestart"])
      this.layer.addEventListener(name, (event) => event.stopPropagation(), { passive: true });
    this.layer.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      this.layer.setPointerCapture(event.pointerId);
      this.move(event.clientX);
    });
    this.layer.addEventListener("pointermove", (event) => {
      if (this.layer.hasPointerCapture(event.pointerId)) this.move(event.clientX);
    });
    this.line.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -STEP, ArrowRight: STEP, Home: -1, End: 1 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      this.place(this.at + step);
    });
    player.on("frame", () => this.draw());
    player.on("view", (view) => {
      if (this.camera !== null && JSON.stringify(view) !== this.behind) moved();
    });
    new ResizeObserver(() => {
      this.frame();
      this.draw();
    }).observe(this.layer);
    this.place(0.5);
  }

  /** Compares with a camera, or ends the comparison. `all` shows its whole image instead of the performer. */
  show(camera: ReviewCamera | null, all: boolean): void {
    const { player } = this;
    if (camera !== null && this.camera === null) this.before = player.background;
    if (camera === null && this.camera !== null) player.background = this.before;
    this.camera = camera;
    this.all = all;
    this.behind = JSON.stringify(player.view);
    this.layer.hidden = camera === null;
    if (camera === null) {
      this.part = null;
      this.pictures.stop();
      player.fixedCamera = null;
      return;
    }
    player.background = this.background;
    this.frame();
    this.draw();
  }

  /** Chooses the part of the camera's image: all of it, or the performer between the title and the controls. */
  private frame(): void {
    const { camera, player, layer } = this;
    if (camera === null || layer.clientHeight === 0) return;
    if (this.all || player.info === null) this.part = whole(camera);
    else {
      const [top, bottom] = [this.line.offsetTop, layer.clientHeight - this.line.offsetTop - this.line.offsetHeight];
      this.part = withRoom(around(camera, player.info.box), layer.clientWidth, layer.clientHeight, top, bottom);
    }
    player.fixedCamera = cameraOf(camera, this.part);
  }

  private move(x: number): void {
    const box = this.layer.getBoundingClientRect();
    this.place((x - box.left) / (box.width || 1));
  }

  place(at: number): void {
    this.at = Math.max(0, Math.min(1, at));
    const percent = `${(100 * this.at).toFixed(2)}%`;
    this.line.style.left = percent;
    this.line.setAttribute("aria-valuenow", String(Math.round(100 * this.at)));
    // Each label is on its side of the line, and goes where there is no room.
    for (const [label, share] of [[this.left, this.at], [this.right, 1 - this.at]] as const) {
      label.style.maxWidth = `calc(${(100 * share).toFixed(2)}% - ${EDGE + 8}px)`;
      label.style.visibility = share < 0.2 ? "hidden" : "";
    }
    this.draw();
  }

  private draw(): void {
    const { camera, part, player, canvas } = this;
    if (camera === null || part === null || player.info === null) return;
    const ratio = pixelRatio();
    const [width, height] = sizeOf(canvas);
    resize(canvas, width, height);
    const { frame } = player;
    const picture = this.pictures.ask(camera.name, frame, player.info.frameCount);
    const context = canvas.getContext("2d")!;
    const box = placed(camera, part, width, height);
    const column = Math.round(this.at * width);
    context.clearRect(0, 0, width, height);
    context.fillStyle = GROUND;
    if (picture === null) {
      // No other frame's image: it would show differences that are none.
      context.fillRect(0, 0, column, height);
    } else {
      context.save();
      context.beginPath();
      context.rect(0, 0, column, height);
      context.clip();
      context.imageSmoothingQuality = "high";
      context.drawImage(picture, box.x, box.y, box.width, box.height);
      context.restore();
    }
    // The camera saw nothing beyond its image, and the labels are in it.
    const [right, bottom] = [box.x + box.width, box.y + box.height];
    const edges = { "--left": box.x, "--top": box.y, "--right": width - right };
    for (const [name, edge] of Object.entries(edges)) this.names.style.setProperty(name, `${Math.max(0, edge / ratio)}px`);
    context.fillRect(0, 0, width, box.y);
    context.fillRect(0, bottom, width, height - bottom);
    context.fillRect(0, 0, box.x, height);
    context.fillRect(right, 0, width - right, height);
    const what = WORDS.footage(camera.name, camera.undistorted);
    const missing = this.pictures.problem === "" ? WORDS.isLoading : WORDS.unavailable(this.pictures.problem);
    this.left.textContent = picture === null ? `${what}: ${missing}` : what;
    this.layer.dataset["frame"] = picture === null ? "" : String(frame);
  }
}
