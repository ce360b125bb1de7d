/** Quality and size of each frame below the timeline, on the same time axis, on request; a click seeks. */

import { clock } from "../ui/format.ts";
import type { Mark, MetricCurves, QualityCurves } from "./api.ts";
import { areaPath, curveRange, frameAt, linePath, placeOf, type Series, sizeRange, ticks } from "./curves.ts";
import { draw, make } from "../ui/dom.ts";
import { WORDS } from "./language.ts";

const WIDTH = 1000;

/** A curve's color and name, in a legend. */
const key = (kind: string, name: string): HTMLElement => make("span", {}, make("i", { class: kind }), name);

export class Plots {
  readonly element = make("div", { class: "plots" });
  private readonly numbers = make("details", { class: "numbers" }, make("summary", {}, WORDS.numbers));
  private readonly readout = make("p", { class: "readout" }); // figures of a frame as text
  private readonly area = make("div", { class: "area" });
  private readonly head = make("div", { class: "line head" });
  private readonly pointer = make("div", { class: "line pointer", hidden: "" });
  private readonly axis = make("div", { class: "axis" });
  private readonly own = draw("path", { class: "own" }); // the plotted metric of the camera that is compared with
  private readonly ownLegend = make("span", { hidden: "" });
  private readonly plotted: MetricCurves | null;
  private readonly several: boolean; // whether several cameras were measured
  private readonly cameras: string; // whose mean the figures are
  private range: readonly [number, number] | null = null;
  private readonly strip = make("div", { class: "strip" });
  private frame = 0;
  private hovered: number | null = null;
  private camera: string | null = null;

  constructor(
    private readonly quality: QualityCurves | null,
    private readonly count: number,
    private readonly fps: number,
    seek: (frame: number) => void,
  ) {
    this.numbers.append(this.readout, this.area, this.axis);
    this.element.append(this.strip, this.numbers);
    const plotted = (this.plotted = quality?.metrics[0] ?? null);
    const names = Object.keys(plotted?.by_camera ?? {});
    this.several = names.length > 1;
    const kind = quality?.held_out === true ? WORDS.heldOut : WORDS.training;
    this.cameras = names.length === 1 ? WORDS.oneCamera(kind, names[0]) : WORDS.meanOf(names.length, kind);
    if (quality !== null) {
      const range = plotted === null ? null : curveRange(plotted.trained, plotted.decoded, ...Object.values(plotted.by_camera));
      if (plotted !== null && range !== null) {
        const limits = `${WORDS.range(...range)} ${plotted.unit}`;
        const title = WORDS.curves(plotted.title, this.cameras, limits);
        const legend = [
          `${plotted.title}, ${this.cameras}:`, " ", key("decoded", WORDS.decoded), " ", key("trained", WORDS.beforeBaking), " ", this.ownLegend,
        ];
        const plot = this.plot("quality", title, legend, limits, range);
        plot.append(
          draw("path", { class: "trained", d: linePath(plotted.trained, range, WIDTH) }),
          draw("path", { class: "decoded", d: linePath(plotted.decoded, range, WIDTH) }),
          this.own,
        );
        this.range = range;
      }
      const kilobytes = quality.bytes.map((value) => (value === null ? null : value / 1000));
      const sizes = sizeRange(kilobytes);
      if (sizes !== null) {
        const limits = `${WORDS.range(...sizes)} KB`;
        const plot = this.plot("size", WORDS.sizes(limits), [WORDS.sizeOf], limits, sizes);
        plot.append(draw("path", { class: "bytes", d: areaPath(kilobytes, sizes[1], WIDTH) }));
      }
    }
    for (const seconds of ticks(0, (count - 1) / fps, 5)) {
      const tick = make("span", {}, clock(seconds));
      tick.style.left = `${(100 * placeOf(seconds * fps, count)).toFixed(2)}%`;
      this.axis.append(tick);
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
    this.area.addEventListener("pointerleave", () => this.hover(null));
    this.show(0);
  }

  /** Shows the frame on the canvas. */
  show(frame: number): void {
    this.frame = frame;
    this.head.style.left = this.left(frame);
    if (this.hovered === null) this.write();
  }

  /** Shows curve and figure of this camera; null for none. */
  compare(camera: string | null): void {
    this.camera = camera;
    // the only camera's curve is the mean
    const series = camera === null || !this.several ? undefined : this.plotted?.by_camera[camera];
    this.own.setAttribute("d", series === undefined || this.range === null ? "" : linePath(series, this.range, WIDTH));
    this.ownLegend.hidden = series === undefined;
    this.ownLegend.replaceChildren(key("own", `${WORDS.decoded}, ${WORDS.only(camera ?? "")}`));
    this.write();
  }

  mark(marks: readonly Mark[], goTo: (mark: Mark) => void): void {
    this.strip.replaceChildren(
      ...marks
        .filter(({ frame }) => frame < this.count)
        .map((mark) => {
          const { frame, note } = mark;
          const tick = make("button", { type: "button", title: `${WORDS.frame(frame)}: ${note}`, "aria-label": WORDS.markAt(frame) });
          tick.style.left = this.left(frame);
          tick.addEventListener("click", () => goTo(mark));
          return tick;
        }),
    );
  }

  private plot(
    kind: string,
    title: string,
    legend: readonly (Node | string)[],
    range: string,
    [low, high]: readonly [number, number],
  ): SVGElement {
    const svg = draw("svg", { viewBox: `0 0 ${WIDTH} 100`, preserveAspectRatio: "none", role: "img", "aria-label": title });
    const name = make("div", { class: "name" }, make("span", {}, ...legend), make("span", { class: "range" }, range));
    const lines = ticks(low, high, 4).map((value) => {
      const line = make("span", { class: "tick" }, String(value));
      line.style.bottom = `${((100 * (value - low)) / (high - low)).toFixed(2)}%`;
      return line;
    });
    this.area.append(name, make("div", { class: `plot ${kind}` }, ...lines, svg));
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
    const parts = [WORDS.frame(frame), clock(frame / this.fps)];
    const figure = (series: Series | undefined, digits: number, unit: string, scale = 1): string => {
      const value = series?.[frame] ?? null;
      return value === null ? WORDS.unmeasured : `${(value * scale).toFixed(digits)} ${unit}`.trimEnd();
    };
    if (quality !== null) {
      for (const { title, unit, digits, decoded, trained, by_camera } of quality.metrics) {
        const [own, before] = [figure(decoded, digits, unit), figure(trained, digits, unit)];
        parts.push(`${title}, ${this.cameras}: ${WORDS.decoded} ${own}, ${WORDS.trained} ${before}`);
        if (camera !== null && this.several) parts.push(`${WORDS.only(camera)}: ${figure(by_camera[camera], digits, unit)}`);
      }
      parts.push(`${WORDS.size} ${figure(quality.bytes, 1, "KB", 1e-3)}`);
    }
    this.readout.replaceChildren(...parts.map((text) => make("span", {}, text)));
  }
}
