/** Decodes splats from a side file and a luma image, for sorting and for the shaders. */

import { tileCorner, tilePixels, tilesOf } from "./layout.ts";
import type { Rendition } from "./manifest.ts";
import type { SideFile } from "./side_file.ts";

/** RGBA32F texels per block in the table that the shader reads. */
export const BLOCK_TEXELS = 5;
/** Floats per block in that table: the affine map in x, y, z of texels 0 to 3, the center's x, y, z in w of texels 0 to 2, the rotation in texel 4. */
export const BLOCK_FLOATS = 4 * BLOCK_TEXELS;

const f = Math.fround;

/** Data shared by all frames of a group. */
export class MotionTables {
  /** (N) pixel of each splat within a tile: row * tile + column. */
  readonly pixels: Uint32Array<ArrayBuffer>;
  /** (B, 3) mean cell of each block, rounded down. */
  readonly centers: Float64Array;
  /** (N) distance of each splat's value from the first one of its tile in the image. */
  readonly offsets: Uint32Array;
  /** (N, 3) centers in the keyframe, and their places in their blocks, in units of the blocks' radius. */
  private readonly keyframe: Float32Array;
  private readonly local: Float32Array;

  constructor(readonly group: Rendition, readonly side: SideFile) {
    const { splats, blocks, positions, tile, columns } = group;
    const { cells, labels } = side;
    this.pixels = tilePixels(tile, splats);
    this.offsets = this.pixels.map((pixel) => (columns - 1) * tile * Math.floor(pixel / tile) + pixel);
    // The loops create no objects and call no functions for each splat: see side_file.ts.
    const centers = (this.centers = new Float64Array(3 * blocks.count));
    const members = new Uint32Array(blocks.count);
    for (let i = 0, p = 0; i < splats; i++, p += 3) {
      const label = labels[i];
      const to = 3 * label;
      members[label]++;
      centers[to] += cells[p];
      centers[to + 1] += cells[p + 1];
      centers[to + 2] += cells[p + 2];
    }
    for (let b = 0; b < blocks.count; b++)
      for (let k = 3 * b; k < 3 * b + 3; k++) centers[k] = Math.floor(centers[k] / Math.max(members[b], 1));
    // Rounded to float32 exactly where the Python decoder rounds, so that positions match bit for bit.
    const keyframe = (this.keyframe = new Float32Array(3 * splats));
    const local = (this.local = new Float32Array(3 * splats));
    const { step } = positions;
    const ratio = step / blocks.radius;
    const [minX, minY, minZ] = positions.min;
    for (let i = 0, p = 0; i < splats; i++, p += 3) {
      const x = cells[p];
      const y = cells[p + 1];
      const z = cells[p + 2];
      const from = 3 * labels[i];
      keyframe[p] = minX + (x + 0.5) * step;
      keyframe[p + 1] = minY + (y + 0.5) * step;
      keyframe[p + 2] = minZ + (z + 0.5) * step;
      local[p] = (x - centers[from]) * ratio;
      local[p + 1] = (y - centers[from + 1]) * ratio;
      local[p + 2] = (z - centers[from + 2]) * ratio;
    }
  }

  /** Static data of each splat at its tile pixel: a (tile, tile) RGBA32UI texture of cell x | y << 16, cell z | class << 16,
   * block, 1 + splat (0 if there is no splat). */
  statics(): Uint32Array<ArrayBuffer> {
    const { cells, labels, classes } = this.side;
    const { pixels } = this;
    const { splats, tile } = this.group;
    const texels = new Uint32Array(4 * tile ** 2);
    for (let i = 0, p = 0; i < splats; i++, p += 3) {
      const at = 4 * pixels[i];
      texels[at] = cells[p] | (cells[p + 1] << 16);
      texels[at + 1] = cells[p + 2] | (classes[i] << 16);
      texels[at + 2] = labels[i];
      texels[at + 3] = i + 1;
    }
    return texels;
  }

  /** The block table of a frame of the group, (B, 20) float32; see BLOCK_FLOATS. */
  blocks(index: number): Float32Array<ArrayBuffer> {
    const { count, step, rotation_step: rotationStep } = this.group.blocks;
    const { motions, turns } = this.side;
    const { centers } = this;
    const table = new Float32Array(BLOCK_FLOATS * count);
    for (let b = 0; b < count; b++) {
      const to = BLOCK_FLOATS * b;
      table[to + 3] = centers[3 * b];
      table[to + 7] = centers[3 * b + 1];
      table[to + 11] = centers[3 * b + 2];
      table[to + 16] = 1;
      if (index === 0) continue;
      const from = (index - 1) * 12 * count + b;
      for (let j = 0; j < 4; j++)
        for (let k = 0; k < 3; k++) table[to + 4 * j + k] = motions[from + (3 * j + k) * count] * step;
      const turn = (index - 1) * 3 * count + b;
      const x = turns[turn] * rotationStep;
      const y = turns[turn + count] * rotationStep;
      const z = turns[turn + 2 * count] * rotationStep;
      const square = x * x + y * y + z * z;
      table[to + 16] = (1 - square) / (1 + square);
      table[to + 17] = (2 * x) / (1 + square);
      table[to + 18] = (2 * y) / (1 + square);
      table[to + 19] = (2 * z) / (1 + square);
    }
    return table;
  }

  /** A frame's escapes for the shader, sorted by pixel: (E, 4) pixel, channel, code, 0. There are few or none. */
  escapes(index: number): Int32Array<ArrayBuffer> {
    const { starts, channel, splat, code } = this.side.escapes;
    const [begin, end] = [starts[index], starts[index + 1]];
    const order = Array.from({ length: end - begin }, (_, i) => begin + i).sort((a, b) => splat[a] - splat[b]);
    const entries = new Int32Array(4 * order.length);
    order.forEach((from, i) => {
      entries[4 * i] = this.pixels[splat[from]]!;
      entries[4 * i + 1] = channel[from]!;
      entries[4 * i + 2] = code[from]!;
    });
    return entries;
  }

  /** Centers of all splats in a frame of the group. `index`: frame within the group. `luma`: the decoded image, rows * tile
   * by columns * tile. `out`: (N, 3) float32, filled. */
  positions(index: number, luma: Uint8Array, table: Float32Array, out: Float32Array): void {
    const { splats, channels } = this.group;
    const { labels, classes, escapes } = this.side;
    const { offsets, keyframe, local } = this;
    const { means } = tilesOf(this.group.sh_degree);
    const [fx, fy, fz] = [means, means + 1, means + 2].map((c) => tileCorner(this.group, c));
    const gains = Float32Array.from({ length: 16 }, (_, c) => 2 ** c);
    // lookup table of value = offset + (code - 128) * step: 256 codes, three channels
    const values = new Float32Array(768);
    for (let c = 0; c < 3; c++) {
      const { offset, step } = channels[means + c];
      const base = f(offset - 128 * step);
      for (let code = 0; code < 256; code++) values[256 * c + code] = f(f(code * f(step)) + base);
    }
    // A stored value is rounded to float32, and a float32 times a power of two is one. In the keyframe, no block moves.
    for (let i = 0; i < splats; i++) {
      const at = offsets[i];
      const gain = gains[classes[i]];
      const to = 3 * i;
      const b = BLOCK_FLOATS * labels[i];
      const u = local[to];
      const v = local[to + 1];
      const w = local[to + 2];
      const x = f(f(f(table[b + 12] + f(u * table[b])) + f(v * table[b + 4])) + f(w * table[b + 8]));
      const y = f(f(f(table[b + 13] + f(u * table[b + 1])) + f(v * table[b + 5])) + f(w * table[b + 9]));
      const z = f(f(f(table[b + 14] + f(u * table[b + 2])) + f(v * table[b + 6])) + f(w * table[b + 10]));
      out[to] = f(keyframe[to] + x) + values[luma[fx + at]] * gain;
      out[to + 1] = f(keyframe[to + 1] + y) + values[256 + luma[fy + at]] * gain;
      out[to + 2] = f(keyframe[to + 2] + z) + values[512 + luma[fz + at]] * gain;
    }
    for (let e = escapes.starts[index]; e < escapes.starts[index + 1]; e++) {
      const c = escapes.channel[e] - means;
      if (c < 0 || c > 2) continue;
      const i = escapes.splat[e];
      const { offset, step } = channels[means + c];
      const value = f(f(f(escapes.code[e]) * f(step)) + f(offset - 128 * step));
      const to = 3 * i + c;
      const b = BLOCK_FLOATS * labels[i] + c;
      let moved = table[b + 12];
      for (let k = 0; k < 3; k++) moved = f(moved + f(local[3 * i + k] * table[b + 4 * k]));
      out[to] = f(f(keyframe[to] + moved) + f(value * gains[classes[i]]));
    }
  }
}
