/** Splats with escapes (codes that do not fit into a byte), as a small image of their own. */

import type { PictureLayout } from "../stream/layout.ts";

const STEP = 8; // multiples of which sides are

export interface EscapedSplats {
  /** Their pixels in the tile of all splats. */
  readonly pixels: Uint32Array<ArrayBuffer>;
  /** Side of the small image's tiles; at most `tile`. */
  readonly side: number;
  /** Luma of all their channels, laid out as the image is, with `side` in place of `tile`: code / 255, not limited to 1. */
  readonly luma: Float32Array<ArrayBuffer>;
  /** Their statics: (side, side, 4). */
  readonly statics: Uint32Array<ArrayBuffer>;
}

/** Copies the splats with escapes out of a frame. `luma`: the frame's image: (rows * tile, columns *
 * tile). `statics`: (tile, tile, 4). `escapes`: (n, 4): pixel in the tile, channel, code, unused; those of a pixel follow one
 * another. */
export function escapedSplats(
  { tile, columns, rows }: PictureLayout,
  channels: number,
  luma: Uint8Array,
  statics: Uint32Array,
  escapes: Int32Array,
): EscapedSplats {
  const count = escapes.length / 4;
  const pixels = new Uint32Array(new Set(Array.from({ length: count }, (_, i) => escapes[4 * i])));
  // In steps, so that textures of this size are seldom allocated again.
  const side = Math.min(tile, STEP * Math.ceil(Math.sqrt(pixels.length) / STEP));
  const small = new Float32Array(side * columns * side * rows);
  const kept = new Uint32Array(4 * side * side);
  const place = (width: number, channel: number, pixel: number): number =>
    (Math.floor(channel / columns) * width + Math.floor(pixel / width)) * width * columns +
    (channel % columns) * width +
    (pixel % width);
  pixels.forEach((pixel, k) => {
    kept.set(statics.subarray(4 * pixel, 4 * pixel + 4), 4 * k);
    for (let c = 0; c < channels; c++) small[place(side, c, k)] = luma[place(tile, c, pixel)] / 255;
  });
  for (let i = 0, k = 0; i < count; i++) {
    if (escapes[4 * i] !== pixels[k]) k++;
    if (escapes[4 * i + 1] < channels) small[place(side, escapes[4 * i + 1], k)] = escapes[4 * i + 2] / 255;
  }
  return { pixels, side, luma: small, statics: kept };
}
