/** Pixels of splats in a tile, along the Morton curve (docs/STREAM.md, "Where splat i lies in a tile"). */

/** Side of the squares in which the curve is walked. */
const SQUARE = 16;
const CODES = SQUARE * SQUARE;

/** The even bits of a number, packed. */
function compact(value: number): number {
  let bits = value & 0x55555555;
  bits = (bits | (bits >>> 1)) & 0x33333333;
  bits = (bits | (bits >>> 2)) & 0x0f0f0f0f;
  bits = (bits | (bits >>> 4)) & 0x00ff00ff;
  return (bits | (bits >>> 8)) & 0x0000ffff;
}

/** Columns and rows of the codes in the first square. */
const COLUMNS = Uint8Array.from({ length: CODES }, (_, code) => compact(code));
const ROWS = Uint8Array.from({ length: CODES }, (_, code) => compact(code >>> 1));

/**
 * Pixels of splats 0, 1, 2, ... in a tile.
 *
 * Walks the curve and skips what is outside the tile; a square of the curve that is completely outside is skipped in one
 * step. Nothing is sorted.
 *
 * @param tile - side of the tile in pixels
 * @param count - number of splats, at most tile^2
 * @param width - pixels from one row to the next: the tile's side, or the width of an image that begins with the tile
 * @returns row * width + column for each splat
 */
export function tilePixels(tile: number, count: number, width = tile): Uint32Array<ArrayBuffer> {
  const pixels = new Uint32Array(count);
  let size = SQUARE;
  while (size < tile) size *= 2;
  const squares = (size / SQUARE) ** 2;
  let filled = 0;
  for (let square = 0; square < squares && filled < count; ) {
    const left = SQUARE * compact(square);
    const top = SQUARE * compact(square >>> 1);
    if (left >= tile || top >= tile) {
      // The lowest corner of the largest aligned square that starts here is outside, and so is the whole square.
      let step = 1;
      while (step < squares && (square & (4 * step - 1)) === 0) step *= 4;
      square += step;
      continue;
    }
    square++;
    const corner = top * width + left;
    const whole = left + SQUARE <= tile && top + SQUARE <= tile;
    for (let code = 0; code < CODES && filled < count; code++) {
      const column = COLUMNS[code];
      const row = ROWS[code];
      if (whole || (left + column < tile && top + row < tile)) pixels[filled++] = corner + row * width + column;
    }
  }
  return pixels;
}
