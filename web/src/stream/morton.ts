/** Pixels of splats in a tile, along the Morton curve (docs/STREAM.md, "Where splat i lies in a tile"). */

/** The even bits of a number, packed. */
function compact(value: number): number {
  let bits = value & 0x55555555;
  bits = (bits | (bits >>> 1)) & 0x33333333;
  bits = (bits | (bits >>> 2)) & 0x0f0f0f0f;
  bits = (bits | (bits >>> 4)) & 0x00ff00ff;
  return (bits | (bits >>> 8)) & 0x0000ffff;
}

/** Pixels of splats 0, 1, 2, ... in a tile: walks the curve through the smallest square that holds the tile, and skips what
 * is outside the tile. `tile`: side of the tile in pixels. `count`: number of splats, at most tile^2. Returns row * tile +
 * column for each splat. */
export function tilePixels(tile: number, count: number): Uint32Array<ArrayBuffer> {
  const pixels = new Uint32Array(count);
  for (let code = 0, filled = 0; filled < count; code++) {
    const column = compact(code);
    const row = compact(code >>> 1);
    if (column < tile && row < tile) pixels[filled++] = row * tile + column;
  }
  return pixels;
}
