/** Names, bounds and places of what a frame's image holds, as in studio/stream/attributes.py and layout.py. */

import { names } from "stream-schema";
import type { SplatArrays } from "./manifest_types.ts";
import { MAX_VALUE } from "./metadata.ts";

const MAX_LOG_SCALE = Math.log(MAX_VALUE);
const MAX_SHAPE = 1e4;

/** Bounds of a component's or channel's values, so that everything rendered is finite: scales end where positions do. */
export function valueBounds(name: string): readonly [low: number, high: number] {
  if (name.startsWith("shape_")) return [-MAX_SHAPE, MAX_SHAPE];
  return [-MAX_VALUE, name.startsWith("log_scale") ? MAX_LOG_SCALE : MAX_VALUE];
}

/** Attributes with the names of their channels (`motion`) or components (`planes`), in order. Names with {k}
 * occur for each SH coefficient, others once. */
export function attributeNames(profile: "motion" | "planes", shDegree: number): [attribute: keyof SplatArrays, names: string[]][] {
  const repeated = Array.from({ length: (shDegree + 1) ** 2 }, (_, k) => String(k));
  return Object.entries(names[profile]).map(([attribute, found]) => [
    attribute as keyof SplatArrays,
    [...new Set(repeated.flatMap((k) => found.map((name) => name.replace("{k}", k))))],
  ]);
}

/** Number of the first tile of each attribute in the image, and of all tiles: one for each channel (`motion`) or plane
 * (`planes`, where a component of the means has two). */
export function tilesOf(profile: "motion" | "planes", shDegree: number): Record<keyof SplatArrays | "count", number> {
  let count = 0;
  const first = attributeNames(profile, shDegree).map(([attribute, { length }]) => {
    const at = count;
    count += profile === "planes" && attribute === "means" ? 2 * length : length;
    return [attribute, at];
  });
  return { ...(Object.fromEntries(first) as Record<keyof SplatArrays, number>), count };
}

/** Distance from the image's first value to that of tile `number`. */
export function tileCorner({ tile, columns }: { readonly tile: number; readonly columns: number }, number: number): number {
  return (Math.floor(number / columns) * tile * columns + (number % columns)) * tile;
}

/** The names of all channels or components, in order. */
export function channelNames(profile: "motion" | "planes", shDegree: number): string[] {
  return attributeNames(profile, shDegree).flatMap(([, found]) => found);
}

/** Side of the smallest square that fits `splats` pixels, rounded up to a multiple of `multiple`. */
export function squareSide(splats: number, multiple: number): number {
  let side = multiple * Math.max(1, Math.floor(Math.sqrt(splats) / multiple));
  while (side * side < splats) side += multiple;
  return side;
}

/** The even bits of a number, packed. */
function compact(value: number): number {
  let bits = value & 0x55555555;
  bits = (bits | (bits >>> 1)) & 0x33333333;
  bits = (bits | (bits >>> 2)) & 0x0f0f0f0f;
  bits = (bits | (bits >>> 4)) & 0x00ff00ff;
  return (bits | (bits >>> 8)) & 0x0000ffff;
}

/** Pixels of splats 0, 1, 2, ... in a tile (docs/STREAM.md, "Where splat i lies in a tile"): walks the Morton curve through
 * the smallest square that holds the tile, and skips what is outside the tile. `tile`: side of the tile in pixels. `count`:
 * number of splats, at most tile^2. Returns row * tile + column for each splat. */
export function tilePixels(tile: number, count: number): Uint32Array<ArrayBuffer> {
  const pixels = new Uint32Array(count);
  for (let code = 0, filled = 0; filled < count; code++) {
    const column = compact(code);
    const row = compact(code >>> 1);
    if (column < tile && row < tile) pixels[filled++] = row * tile + column;
  }
  return pixels;
}
