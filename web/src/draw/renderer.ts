/** The renderer interface, which WebGL2 and WebGPU implement. */

import type { GroupSetup, Picture } from "../worker/messages.ts";
import type { Pinhole } from "./camera.ts";

export interface Renderer {
  readonly name: "WebGL2" | "WebGPU";
  /** Whether the GPU sorts the splats for each drawing; if not, pictures come with an order. */
  readonly sorts: boolean;
  /** Whether the CPU draws, since there is no GPU. */
  readonly software: boolean;
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
  /** Uploads a new sort order for the same frame; not if `sorts`. */
  setOrder(order: Uint32Array, count: number): void;
  /**
   * Draws the last upload, scaled to the canvas.
   *
   * @param background - RGB, 0 to 1; null leaves the background transparent
   */
  draw(pinhole: Pinhole, background: readonly [number, number, number] | null): void;
  /** Draws off screen and reads the pixels back: (height, width, 4) bytes, top row first. */
  snapshot(
    pinhole: Pinhole,
    background: readonly [number, number, number],
  ): Uint8ClampedArray<ArrayBuffer> | Promise<Uint8ClampedArray<ArrayBuffer>>;
  /** GPU times of a recent drawing; null if they cannot be measured. */
  readonly gpuTimes: GpuTimes | null;
  /** Number of splats in a recent drawing; null if only the worker knows it. */
  readonly visible: number | null;
  /** Waits until all drawing is done. */
  finish(): void | Promise<void>;
  dispose(): void;
}

/** GPU times in milliseconds. */
export interface GpuTimes {
  readonly all: number;
  /** Dequantizing and projecting, and sorting; null if the GPU does not sort. */
  readonly project: number | null;
  readonly sort: number | null;
}

/** As in studio.rasterizer: splats nearer than this are not drawn. */
export const NEAR = 0.01;
/** Maximum alpha of a splat at a pixel, and the minimum that is drawn, as in studio.rasterizer. */
export const ALPHA_MAX = 0.99;
export const ALPHA_MIN = 1 / 255;
