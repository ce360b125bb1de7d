/** Splats with escapes, copied into a small picture. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { escapedSplats } from "../src/render/escapes.ts";

/** Code of a channel, as the shaders read it. */
function read(luma: Float32Array, side: number, columns: number, channel: number, x: number, y: number): number {
  const row = Math.trunc(channel / columns) * side + y;
  return Math.floor(luma[row * side * columns + (channel % columns) * side + x] * 255 + 0.5);
}

for (const [tile, some] of [[3, 9], [16, 5], [16, 70], [20, 201]])
  void test(`${some} splats of ${tile * tile} have escapes`, () => {
    const [columns, rows, channels] = [3, 5, 13];
    const luma = Uint8Array.from({ length: tile * columns * tile * rows }, (_, i) => (i * 7919) % 256);
    const statics = Uint32Array.from({ length: 4 * tile * tile }, (_, i) => i + 1);
    // 7 and the number of pixels have no common divisor: all pixels differ, and are not in order.
    const pixels = Array.from({ length: some }, (_, k) => (5 + 7 * k) % (tile * tile));
    const escapes = Int32Array.from(pixels.flatMap((pixel, k) => [
      [pixel, k % channels, 256 + 1000 * k, 0],
      [pixel, (k + 6) % channels, -1 - 30 * k, 0],
    ]).flat());
    const found = escapedSplats({ tile, columns, rows }, channels, luma, statics, escapes);
    const { side } = found;
    assert.deepEqual([...found.pixels], pixels);
    assert.ok(side <= tile && side * side >= some);
    assert.equal(found.luma.length, side * columns * side * rows);
    assert.equal(found.statics.length, 4 * side * side);
    pixels.forEach((pixel, k) => {
      assert.deepEqual([...found.statics.subarray(4 * k, 4 * k + 4)], [1, 2, 3, 4].map((n) => 4 * pixel + n));
      for (let c = 0; c < channels; c++) {
        const x = (c % columns) * tile + (pixel % tile);
        const y = Math.trunc(c / columns) * tile + Math.trunc(pixel / tile);
        const code =
          c === k % channels ? 256 + 1000 * k : c === (k + 6) % channels ? -1 - 30 * k : luma[y * tile * columns + x];
        assert.equal(read(found.luma, side, columns, c, k % side, Math.trunc(k / side)), code);
      }
    });
    // The rest draws nothing.
    assert.ok(found.statics.subarray(4 * some).every((word) => word === 0));
  });
