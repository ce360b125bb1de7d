/** Pixels of splats in a tile, along the Morton curve (docs/STREAM.md, "Where splat i lies in a tile"). */

/** The even bits of a number, packed. */
function compact(value: number): number {
  let bits = value & 0x55555555;
  bits = (bits | (bits >>> 1)) & 0x33333333;
  bits = (bits | (bits >>> 2)) & 0x0f0f0f0f;
  bits = (bits | (bits >>> 4)) & 0x00ff00ff;
  return (bits | (bits >>> 8)) & 0x0000ffff;
}

/**
 * Pixels of splats 0, 1, 2, ... in a tile.
 *
 * Walks the curve and skips what is outside the tile; a square of the curve that is completely outside is skipped in one
 * step. Nothing is sorted.
 *
 * @param tile - side of the tile in pixels
 * @param count - number of splats, at most tile^2
 * @returns row * tile + column for each splat
 */
export function tilePixels(tile: number, count: number): Uint32Array<ArrayBuffer> {
  const pixels = new Uint32Array(count);
  let size = 1;
  while (size < tile) size *= 2;
  const end = size * size;
  let filled = 0;
  for (let code = 0; code < end && filled < count; ) {
    const column = compact(code);
    const row = compact(code >>> 1);
    if (column < tile && row < tile) {
      pixels[filled++] = row * tile + column;
      code++;
      continue;
    }
    // The lowest corner of the largest aligned square that starts here is outside, and so is the whole square.
    let step = 1;
    while (step < end && (code & (4 * step - 1)) === 0) step *= 4;
    code += step;
  }
  return pixels;
}
