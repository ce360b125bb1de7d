/** PSNR and size of each frame below the timeline, on the same scale; a click seeks. */

import { clock } from "../ui/format.ts";
import type { Mark, QualityCurves } from "./api.ts";
import { areaPath, decibelRange, frameAt, linePath, placeOf, type Series, sizeRange } from "./curves.ts";
import { draw, make } from "./dom.ts";

const WIDTH = 1000;

export class Plots {
  readonly element = make("div", { class: "plots" });
  /** Figures of a frame as text. */
  readonly readout = make("p", { class: "readout" });
  private readonly area = make("div", { class: "area" });
  private readonly head = make("div", { class: "line head" });
  private readonly pointer = make("div", { class: "line pointer", hidden: "" });
  private readonly strip = make("div", { class: "strip" });
  private readonly quality: QualityCurves | null;
  private readonly count: number;
  private readonly fps: number;
  private frame = 0;
  private hovered: number | null = null;
  private camera: string | null = null;

  constructor(quality: QualityCurves | null, count: number, fps: number, seek: (frame: number) => void) {
    this.quality = quality;
    this.count = count;
    this.fps = fps;
    this.element.append(this.area, this.strip);
    if (quality !== null) {
      const range = decibelRange(quality.psnr_trained, quality.psnr_decoded);
      const cameras = `mean over ${quality.held_out ? "held-out" : "training"} cameras`;
      if (range !== null) {
        const title = `PSNR, ${cameras}: trained and decoded, ${range[0]} to ${range[1]} dB`;
        const plot = this.plot("psnr", title, `${range[1]} dB`, `${range[0]}`);
        plot.append(
          draw("path", { class: "trained", d: linePath(quality.psnr_trained, range, WIDTH) }),
          draw("path", { class: "decoded", d: linePath(quality.psnr_decoded, range, WIDTH) }),
        );
      }
      const kilobytes = quality.bytes.map((value) => (value === null ? null : value / 1000));
      const sizes = sizeRange(kilobytes);
      if (sizes !== null) {
        const plot = this.plot("size", `kB per frame, 0 to ${sizes[1]} kB`, `${sizes[1]} kB`, "0");
        plot.append(draw("path", { class: "bytes", d: areaPath(kilobytes, sizes[1], WIDTH) }));
      }
    }
    this.area.append(this.head, this.pointer);
    const at = (event: PointerEvent): number => {
      const box = this.area.getBoundingClientRect();
      return frameAt((event.clientX - box.left) / (box.width || 1), count);
    };
    let pressed = false;
    this.area.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      pressed = true;
      this.area.setPointerCapture(event.pointerId);
      seek(at(event));
    });
    this.area.addEventListener("pointermove", (event) => {
      this.hover(at(event));
      if (pressed) seek(at(event));
    });
    for (const name of ["pointerup", "pointercancel"] as const)
      this.area.addEventListener(name, () => {
        pressed = false;
      });
    this.area.addEventListener("pointerleave", () => {
      this.hover(null);
    });
    this.show(0);
  }

  /** Shows the frame on the canvas. */
  show(frame: number): void {
    this.frame = frame;
    this.head.style.left = this.left(frame);
    if (this.hovered === null) this.write();
  }

  /** Also shows the figure of this camera; null for none. */
  compare(camera: string | null): void {
    this.camera = camera;
    this.write();
  }

  mark(marks: readonly Mark[], seek: (frame: number) => void): void {
    this.strip.replaceChildren(
      ...marks
        .filter(({ frame }) => frame < this.count)
        .map(({ frame, note }) => {
          const tick = make("button", { type: "button", title: `Frame ${frame}: ${note}`, "aria-label": `Mark at frame ${frame}` });
          tick.style.left = this.left(frame);
          tick.addEventListener("click", () => {
            seek(frame);
          });
          return tick;
        }),
    );
  }

  private plot(kind: string, title: string, top: string, bottom: string): SVGElement {
    const svg = draw("svg", { viewBox: `0 0 ${WIDTH} 100`, preserveAspectRatio: "none", role: "img", "aria-label": title });
    const labels = make("div", { class: "labels" }, make("span", {}, top), make("span", {}, bottom));
    const names = kind === "psnr" ? [make("i", { class: "trained" }), "trained ", make("i", { class: "decoded" }), "decoded, PSNR"] : ["kB per frame"];
    this.area.append(make("div", { class: `plot ${kind}` }, svg, labels, make("div", { class: "name" }, ...names)));
    return svg;
  }

  private left(frame: number): string {
    return `${(100 * placeOf(frame, this.count)).toFixed(3)}%`;
  }

  private hover(frame: number | null): void {
    this.hovered = frame;
    this.pointer.hidden = frame === null;
    if (frame !== null) this.pointer.style.left = this.left(frame);
    this.write();
  }

  private write(): void {
    const frame = this.hovered ?? this.frame;
    const { quality, camera } = this;
    const parts = [`Frame ${frame}`, clock(frame / this.fps)];
    const figure = (series: Series | undefined, digits: number, unit: string, scale = 1): string => {
      const value = series?.[frame] ?? null;
      return value === null ? "not measured" : `${(value * scale).toFixed(digits)} ${unit}`;
    };
    if (quality !== null) {
      parts.push(`trained ${figure(quality.psnr_trained, 2, "dB")}`, `decoded ${figure(quality.psnr_decoded, 2, "dB")}`);
      if (camera !== null) parts.push(`${camera} ${figure(quality.by_camera[camera], 2, "dB")}`);
      parts.push(figure(quality.bytes, 1, "kB", 1e-3));
    }
    this.readout.replaceChildren(...parts.map((text) => make("span", {}, text)));
  }
}
