/** The renderer interface. WebGL2 implements it; another graphics API would be another implementation. */

import type { GroupSetup, Picture } from "../worker/messages.ts";
import type { Pinhole } from "./camera.ts";

export interface Renderer {
  readonly name: string;
  /** Maximum texture size in pixels. */
  readonly maxTexture: number;
  /** Whether the GPU is still working on the last drawing; more drawings would only queue up. */
  readonly busy: boolean;
  /** Whether the graphics context is lost; nothing can be drawn until it is restored. */
  readonly lost: boolean;
  /** Compiles the shaders for such a stream in the background. */
  prepare(profile: "motion" | "planes", shDegree: number): void;
  /** Uploads a group's shared data; only pictures of this group may follow until the next call. */
  setGroup(setup: GroupSetup): void;
  /** Uploads a frame. */
  setPicture(picture: Picture): void;
  /** Uploads a new sort order for the same frame. */
  setOrder(order: Uint32Array, count: number): void;
  /**
   * Draws the last upload, scaled to the canvas.
   *
   * @param background - RGB, 0 to 1; null leaves the background transparent
   */
  draw(pinhole: Pinhole, background: readonly [number, number, number] | null): void;
  /** Draws off screen and reads the pixels back: (height, width, 4) bytes, top row first. */
  snapshot(pinhole: Pinhole, background: readonly [number, number, number]): Uint8ClampedArray<ArrayBuffer>;
  /** GPU time of a recent frame in milliseconds; null if it cannot be measured. */
  readonly gpuMilliseconds: number | null;
  /** Waits until all drawing is done. */
  finish(): void;
  dispose(): void;
}

/** Maximum alpha of a splat at a pixel, and the minimum that is drawn, as in studio.rasterizer. */
export const ALPHA_MAX = 0.99;
export const ALPHA_MIN = 1 / 255;
/** Added to the diagonal of every projected covariance, in square pixels, as in studio.rasterizer. */
export const DILATION = 0.3;
