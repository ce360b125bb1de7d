/** Renders frames to the canvas: from the orbit camera or a fixed one, at a resolution that keeps up. */

import type { OrbitCamera, Pinhole, View } from "../render/camera.ts";
import { resize, sizeOf } from "../render/gl.ts";
import type { Renderer } from "../render/renderer.ts";
import type { Vector } from "../stream/metadata.ts";
import { Resolution } from "./resolution.ts";
import type { Statistics } from "./statistics.ts";

const SETTLE = 200; // milliseconds without a change after which the image is rendered at full resolution

export class Screen {
  readonly resolution = new Resolution();
  /** Whether the canvas must be rendered again. */
  dirty = true;
  /** Size of the last image in pixels. */
  size: readonly number[] = [0, 0];
  background: Vector | null = [0, 0, 0];
  /** A pinhole instead of the orbit camera. */
  fixed: Pinhole | null = null;
  private began: number | null = null;
  private renderedAt = 0;
  private count = 0;
  /** Whether the last image has full resolution, since nothing moves. */
  private sharp = false;
  private lastView = "";
  private readonly resizing: ResizeObserver;

  /** `renderer`: replaced by that of an immersive session while there is one. `rendered`: called when the canvas was rendered,
   * and can be copied. */
  constructor(
    public renderer: Renderer,
    private readonly canvas: HTMLCanvasElement,
    private readonly camera: OrbitCamera,
    private readonly statistics: Statistics,
    private readonly rendered: () => void,
    private readonly viewed: (view: View) => void,
  ) {
    this.resolution.software = this.renderer.software;
    this.resizing = new ResizeObserver(() => {
      this.dirty = true;
    });
    this.resizing.observe(canvas);
  }

  dispose(): void {
    this.resizing.disconnect();
    this.renderer.dispose();
  }

  /** Forgets when the last image was begun: the page was hidden, or something else took the time. */
  forget(): void {
    this.began = null;
    this.resolution.forget();
  }

  /** Called for each animation frame: renders if something has changed. `still`: nothing will change by playing or seeking. */
  update(now: number, still: boolean): void {
    if (this.began !== null && !this.renderer.busy) this.finished(now);
    if (this.dirty) {
      this.sharp = false;
      this.render(now);
    } else if (still && !this.sharp && now - this.renderedAt > SETTLE && !this.renderer.busy) {
      this.sharp = true;
      this.render(now);
    }
  }

  render(now: number): void {
    const { renderer, canvas, statistics } = this;
    if (renderer.lost || renderer.busy) return;
    this.finished(now);
    this.renderedAt = now;
    resize(canvas, ...sizeOf(canvas));
    const began = performance.now();
    const pinhole = this.pinhole();
    this.size = [pinhole.width, pinhole.height];
    renderer.draw(pinhole, this.background);
    statistics.draw.add(performance.now() - began);
    if (renderer.gpuTime !== null) statistics.gpu.add(renderer.gpuTime);
    this.dirty = false;
    this.began = now;
    // In the same task, while the canvas still holds the image.
    this.rendered();
    const { view } = this.camera;
    const key = JSON.stringify(view);
    if (key === this.lastView) return;
    this.lastView = key;
    this.viewed(view);
  }

  /** The camera of the next image, in its pixels. */
  pinhole(): Pinhole {
    const [width, height] = this.targetSize();
    const { fixed } = this;
    if (fixed === null) return this.camera.pinhole(width, height);
    const scale = Math.min(width / fixed.width, height / fixed.height);
    return {
      ...fixed,
      width,
      height,
      fx: fixed.fx * scale,
      fy: fixed.fy * scale,
      cx: (fixed.cx - fixed.width / 2) * scale + width / 2,
      cy: (fixed.cy - fixed.height / 2) * scale + height / 2,
    };
  }

  private targetSize(): [number, number] {
    const [width, height] = sizeOf(this.canvas);
    const scale = this.sharp ? 1 : this.resolution.scale(width, height);
    return [Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale))];
  }

  /** The GPU has finished the last image. */
  private finished(now: number): void {
    if (this.began === null) return;
    const took = now - this.began;
    this.began = null;
    if (this.sharp) return;
    if (this.count++ < 2) return; // the first ones compile shaders
    if (this.resolution.measured(took)) this.dirty = true;
  }
}
