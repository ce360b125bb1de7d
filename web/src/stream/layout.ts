/** Names, bounds and places of what a frame's image holds, as in studio/stream/attributes.py and layout.py. */

import { names } from "stream-schema";
import type { Rendition } from "./manifest_types.ts";
import { MAX_VALUE } from "./metadata.ts";

const MAX_SHAPE = 1e4;

/** What channels describe. */
export type Attribute = "means" | "scales" | "opacities" | "sh";

/** Bounds of a channel's values, so that everything rendered is finite. */
export function valueBounds(name: string): readonly [low: number, high: number] {
  const most = name.startsWith("shape_") ? MAX_SHAPE : MAX_VALUE;
  return [-most, most];
}

/** Attributes with the names of their channels, in order. Names with {k} occur for each SH coefficient, others once. */
export function attributeNames(shDegree: number): [attribute: Attribute, names: string[]][] {
  const repeated = Array.from({ length: (shDegree + 1) ** 2 }, (_, k) => String(k));
  return Object.entries(names).map(([attribute, found]) => [
    attribute as Attribute,
    [...new Set(repeated.flatMap((k) => found.map((name) => name.replace("{k}", k))))],
  ]);
}

/** Number of the first tile of each attribute in the image, and of all tiles: one for each channel. */
export function tilesOf(shDegree: number): Record<Attribute | "count", number> {
  let count = 0;
  const first = attributeNames(shDegree).map(([attribute, { length }]) => [attribute, (count += length) - length]);
  return { ...(Object.fromEntries(first) as Record<Attribute, number>), count };
}

/** How a group's image holds its channels: tile c is at column c % columns, row c / columns. */
export type PictureLayout = Pick<Rendition, "tile" | "columns" | "rows">;

/** Width and height of a group's image. */
export const pictureSize = ({ tile, columns, rows }: PictureLayout): [number, number] => [columns * tile, rows * tile];

/** (C, 2) float32 base and step of each channel, in order, with value = base + code * step. */
export function unitsOf({ channels }: Pick<Rendition, "channels">): Float32Array<ArrayBuffer> {
  return Float32Array.from(channels.flatMap(({ offset, step }) => [offset - 128 * step, step]));
}

/** Distance from the image's first value to that of tile `number`. */
export function tileCorner({ tile, columns }: { readonly tile: number; readonly columns: number }, number: number): number {
  return (Math.floor(number / columns) * tile * columns + (number % columns)) * tile;
}

/** The names of all channels, in order. */
export const channelNames = (shDegree: number): string[] => attributeNames(shDegree).flatMap(([, found]) => found);

/** Side of a tile in pixels for a number of splats. */
export function tileSide(splats: number): number {
  let side = 16 * Math.max(1, Math.floor(Math.sqrt(splats) / 16));
  while (side * side < splats) side += 16;
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

/** Pixels of splats 0, 1, 2, ... in a tile (docs/STREAM.md, "Position of splat i in a tile"): walks the Morton curve through
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
