/** What draws pictures. WebGL2 does; another way of drawing is another class of this interface. */

import type { GroupSetup, Picture } from "../worker/messages.ts";
import type { Pinhole } from "./camera.ts";

export interface Renderer {
  readonly name: string;
  /** Side of the largest picture that can be held. */
  readonly maxTexture: number;
  /** Whether the graphics are still at what was drawn last; drawing more would only queue up. */
  readonly busy: boolean;
  /** Whether the graphics were lost; nothing can be drawn until they are restored. */
  readonly lost: boolean;
  /** Compiles, in the background, what drawing such a stream takes. */
  prepare(profile: "motion" | "planes", shDegree: number): void;
  /** Takes over a group; pictures of other groups must not be shown before its own. */
  setGroup(setup: GroupSetup): void;
  /** Takes over a frame's content. */
  setPicture(picture: Picture): void;
  /** Takes over another order of the same frame. */
  setOrder(order: Uint32Array, count: number): void;
  /**
   * Draws what was taken over last, scaled to the canvas.
   *
   * @param background - RGB 0 to 1; null leaves the canvas transparent there
   */
  draw(pinhole: Pinhole, background: readonly [number, number, number] | null): void;
  /** Draws and reads back, (height, width, 4) bytes from the top row on, without touching the canvas. */
  snapshot(pinhole: Pinhole, background: readonly [number, number, number]): Uint8ClampedArray<ArrayBuffer>;
  /** Milliseconds that the graphics took for a recent frame, where they can say. */
  readonly gpuMilliseconds: number | null;
  /** Waits until everything was drawn. */
  finish(): void;
  dispose(): void;
}

/** Largest alpha of a splat at a pixel, and the smallest that is drawn: as in studio.rasterizer. */
export const ALPHA_MAX = 0.99;
export const ALPHA_MIN = 1 / 255;
/** Square pixels added to every projected covariance: as in studio.rasterizer. */
export const DILATION = 0.3;
