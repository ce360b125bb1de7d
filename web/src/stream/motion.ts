/** Decodes splats from a side file and a luma picture, for sorting and for the shaders. */

import type { MotionGroup } from "./manifest.ts";
import { tilePixels } from "./morton.ts";
import type { SideFile } from "./side_file.ts";

/** RGBA32F texels per block in the table that the shader reads. */
export const BLOCK_TEXELS = 5;
/** Floats per block in that table: the affine map in x, y, z of texels 0 to 3, the center's x, y, z in w of texels 0 to 2, the rotation in texel 4. */
export const BLOCK_FLOATS = 4 * BLOCK_TEXELS;

const f = Math.fround;

/** Data shared by all frames of a group. */
export class MotionTables {
  readonly group: MotionGroup;
  readonly side: SideFile;
  /** (N) pixel of each splat within a tile: row * tile + column. */
  readonly pixels: Uint32Array<ArrayBuffer>;
  /** (B, 3) mean cell of each block, rounded down. */
  readonly centers: Float64Array;
  private readonly keyframe: Float32Array;
  private readonly local: Float32Array;
  private readonly offsets: Uint32Array;

  constructor(group: MotionGroup, side: SideFile) {
    this.group = group;
    this.side = side;
    const { splats, positions, blocks } = group;
    this.pixels = tilePixels(group.tile, splats);
    const width = group.columns * group.tile;
    this.offsets = new Uint32Array(splats);
    for (let i = 0; i < splats; i++) {
      const pixel = this.pixels[i];
      const row = Math.floor(pixel / group.tile);
      this.offsets[i] = row * width + pixel - row * group.tile;
    }
    this.centers = new Float64Array(3 * blocks.count);
    const members = new Uint32Array(blocks.count);
    for (let i = 0; i < splats; i++) {
      const b = side.labels[i];
      members[b]++;
      for (let k = 0; k < 3; k++) this.centers[3 * b + k] += side.cells[3 * i + k];
    }
    for (let b = 0; b < blocks.count; b++)
      for (let k = 0; k < 3; k++)
        this.centers[3 * b + k] = Math.floor(this.centers[3 * b + k] / Math.max(members[b], 1));
    // Rounded to float32 exactly where the Python decoder rounds, so that positions match bit for bit.
    this.keyframe = new Float32Array(3 * splats);
    this.local = new Float32Array(3 * splats);
    const ratio = positions.step / blocks.radius;
    for (let i = 0; i < splats; i++)
      for (let k = 0; k < 3; k++) {
        const cell = side.cells[3 * i + k];
        this.keyframe[3 * i + k] = positions.min[k] + (cell + 0.5) * positions.step;
        this.local[3 * i + k] = (cell - this.centers[3 * side.labels[i] + k]) * ratio;
      }
  }

  /**
   * Static data of each splat at its tile pixel: a (tile, tile) RGBA32UI texture of cell x | y << 16, cell z | class << 16,
   * block, 1 + splat (0 if there is no splat).
   */
  statics(): Uint32Array<ArrayBuffer> {
    const { cells, labels, classes } = this.side;
    const texels = new Uint32Array(4 * this.group.tile ** 2);
    for (let i = 0; i < this.group.splats; i++) {
      const at = 4 * this.pixels[i];
      texels[at] = cells[3 * i] | (cells[3 * i + 1] << 16);
      texels[at + 1] = cells[3 * i + 2] | (classes[i] << 16);
      texels[at + 2] = labels[i]!;
      texels[at + 3] = i + 1;
    }
    return texels;
  }

  /** The block table of a frame of the group, (B, 20) float32; see BLOCK_FLOATS. */
  blocks(index: number): Float32Array<ArrayBuffer> {
    const { count, step, rotationStep } = this.group.blocks;
    const { motions, turns } = this.side;
    const table = new Float32Array(BLOCK_FLOATS * count);
    for (let b = 0; b < count; b++) {
      const to = BLOCK_FLOATS * b;
      for (let k = 0; k < 3; k++) table[to + 4 * k + 3] = this.centers[3 * b + k]!;
      table[to + 16] = 1;
      if (index === 0) continue;
      for (let j = 0; j < 4; j++)
        for (let k = 0; k < 3; k++)
          table[to + 4 * j + k] = motions[((index - 1) * 12 + 3 * j + k) * count + b] * step;
      const turn = [0, 1, 2].map((k) => turns[((index - 1) * 3 + k) * count + b] * rotationStep);
      const square = turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2;
      table[to + 16] = (1 - square) / (1 + square);
      for (let k = 0; k < 3; k++) table[to + 17 + k] = (2 * turn[k]) / (1 + square);
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

  /**
   * Centers of all splats in a frame of the group.
   *
   * @param index - frame within the group
   * @param luma - the decoded picture, rows * tile by columns * tile
   * @param out - (N, 3) float32, filled
   */
  positions(index: number, luma: Uint8Array, table: Float32Array, out: Float32Array): void {
    const { splats, channels, tile, columns } = this.group;
    const { labels, classes, escapes } = this.side;
    const { keyframe, local, offsets } = this;
    const width = columns * tile;
    const first = [0, 1, 2].map((c) => Math.floor(c / columns) * tile * width + (c % columns) * tile);
    const [fx, fy, fz] = [first[0], first[1], first[2]];
    const gains = Float32Array.from({ length: 16 }, (_, c) => 2 ** c);
    // lookup table of value = offset + (code - 128) * step: 256 codes, three channels
    const values = new Float32Array(768);
    for (let c = 0; c < 3; c++) {
      const { offset, step } = channels[c];
      const base = f(offset - 128 * step);
      for (let code = 0; code < 256; code++) values[256 * c + code] = f(f(code * f(step)) + base);
    }
    if (index === 0)
      for (let i = 0; i < splats; i++) {
        const at = offsets[i];
        const gain = gains[classes[i]];
        const to = 3 * i;
        out[to] = f(keyframe[to] + f(values[luma[fx + at]] * gain));
        out[to + 1] = f(keyframe[to + 1] + f(values[256 + luma[fy + at]] * gain));
        out[to + 2] = f(keyframe[to + 2] + f(values[512 + luma[fz + at]] * gain));
      }
    else
      for (let i = 0; i < splats; i++) {
        const at = offsets[i];
        const gain = gains[classes[i]];
        const to = 3 * i;
        const b = BLOCK_FLOATS * labels[i];
        const [u, v, w] = [local[to], local[to + 1], local[to + 2]];
        const x = f(f(f(table[b + 12] + f(u * table[b])) + f(v * table[b + 4])) + f(w * table[b + 8]));
        const y = f(f(f(table[b + 13] + f(u * table[b + 1])) + f(v * table[b + 5])) + f(w * table[b + 9]));
        const z = f(f(f(table[b + 14] + f(u * table[b + 2])) + f(v * table[b + 6])) + f(w * table[b + 10]));
        out[to] = f(f(keyframe[to] + x) + f(values[luma[fx + at]] * gain));
        out[to + 1] = f(f(keyframe[to + 1] + y) + f(values[256 + luma[fy + at]] * gain));
        out[to + 2] = f(f(keyframe[to + 2] + z) + f(values[512 + luma[fz + at]] * gain));
      }
    for (let e = escapes.starts[index]; e < escapes.starts[index + 1]; e++) {
      const c = escapes.channel[e];
      if (c > 2) continue;
      const i = escapes.splat[e];
      const { offset, step } = channels[c];
      const value = f(f(f(escapes.code[e]) * f(step)) + f(offset - 128 * step));
      const to = 3 * i + c;
      let place = keyframe[to];
      if (index > 0) {
        const b = BLOCK_FLOATS * labels[i] + c;
        let moved = table[b + 12];
        for (let k = 0; k < 3; k++) moved = f(moved + f(local[3 * i + k] * table[b + 4 * k]));
        place = f(place + moved);
      }
      out[to] = f(place + f(value * gains[classes[i]]));
    }
  }
}
