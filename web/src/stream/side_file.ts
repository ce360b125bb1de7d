/** Decompresses and parses the side file of the profile `motion` (docs/STREAM.md, "The side file"). */

import { messageOf, StreamError } from "./errors.ts";
import { type MotionGroup, valueBounds } from "./manifest.ts";

const MAX_CLASS = 15;
const MAX_MOVE = 1e9;

/** Contents of a side file; N splats, B blocks, F frames. */
export interface SideFile {
  /** (N, 3) cells of the keyframe's lattice. */
  readonly cells: Uint16Array;
  /** (N) block of each splat. */
  readonly labels: Uint16Array;
  /** (N) class: the step of the residuals is doubled this many times. */
  readonly classes: Uint8Array;
  /** (F - 1, 12, B) affine motions, in units of `blocks.step`. */
  readonly motions: Float64Array;
  /** (F - 1, 3, B) rotations, in units of `blocks.rotationStep`. */
  readonly turns: Float64Array;
  /** Values outside the video's 256 codes, sorted by frame; `starts` (F + 1) is the index of each frame's first. */
  readonly escapes: {
    readonly starts: Uint32Array;
    readonly channel: Uint8Array;
    readonly splat: Uint32Array;
    readonly code: Int32Array;
  };
}

/** Reads the parts of the file in sequence. */
class Cursor {
  private readonly data: Uint8Array;
  private position = 0;

  constructor(data: Uint8Array) {
    this.data = data;
  }

  get left(): number {
    return this.data.length - this.position;
  }

  take(count: number): Uint8Array {
    if (count > this.left) throw new StreamError("it ends early");
    this.position += count;
    return this.data.subarray(this.position - count, this.position);
  }

  /** Reads integers stored as zigzag codes in byte planes, lowest bytes first. */
  numbers(count: number, width: 2 | 4): Int32Array {
    const planes = this.take(count * width);
    const values = new Int32Array(count);
    if (width === 2)
      for (let i = 0; i < count; i++) {
        const z = planes[i] | (planes[count + i] << 8);
        values[i] = (z >>> 1) ^ -(z & 1);
      }
    else
      for (let i = 0; i < count; i++) {
        const z =
          planes[i] | (planes[count + i] << 8) | (planes[2 * count + i] << 16) | (planes[3 * count + i] << 24);
        values[i] = (z >>> 1) ^ -(z & 1);
      }
    return values;
  }
}

/** Cells of the octree's last level in Morton order, each repeated once per splat in it: (splats, 3). */
function readOctree(cursor: Cursor, bits: number, splats: number): Uint16Array {
  const wrong = "the octree's cells do not match the number of splats";
  // Coordinates of the level's occupied cells, one array per axis; two sets, swapped at each level.
  let [x, y, z] = [new Uint16Array(splats), new Uint16Array(splats), new Uint16Array(splats)];
  let [nextX, nextY, nextZ] = [new Uint16Array(splats), new Uint16Array(splats), new Uint16Array(splats)];
  let count = 1;
  for (let level = 0; level < bits; level++) {
    const occupancy = cursor.take(count);
    let filled = 0;
    for (let i = 0; i < count; i++) {
      const children = occupancy[i];
      if (children === 0) throw new StreamError(wrong);
      const [px, py, pz] = [x[i] << 1, y[i] << 1, z[i] << 1];
      // Most cells have a single child: only the bits that are set are visited, lowest first.
      for (let left: number = children; left !== 0; left &= left - 1) {
        if (filled === splats) throw new StreamError(wrong);
        const c = 31 - Math.clz32(left & -left);
        nextX[filled] = px | (c & 1);
        nextY[filled] = py | ((c >> 1) & 1);
        nextZ[filled] = pz | (c >> 2);
        filled++;
      }
    }
    [x, y, z, nextX, nextY, nextZ] = [nextX, nextY, nextZ, x, y, z];
    count = filled;
  }
  const shared = cursor.numbers(count, 4);
  const cells = new Uint16Array(3 * splats);
  let splat = 0;
  for (let i = 0; i < count; i++) {
    const copies = shared[i] + 1;
    if (copies < 1 || copies > splats - splat) throw new StreamError("the octree's points do not match the number of splats");
    for (let k = 0; k < copies; k++, splat++) {
      cells[3 * splat] = x[i]!;
      cells[3 * splat + 1] = y[i]!;
      cells[3 * splat + 2] = z[i]!;
    }
  }
  if (splat !== splats) throw new StreamError("the octree's points do not match the number of splats");
  return cells;
}

/** Undoes second differences over frames, with `rows` numbers per frame. */
function integrate(differences: Int32Array, frames: number, rows: number): Float64Array {
  const values = new Float64Array(differences.length);
  for (let t = 0; t < frames; t++)
    for (let i = 0; i < rows; i++) {
      const at = t * rows + i;
      const before = t > 0 ? values[at - rows] : 0;
      const earlier = t > 1 ? values[at - 2 * rows] : 0;
      values[at] = differences[at] + 2 * before - earlier;
    }
  return values;
}

/** Cumulative sums of differences, checked to be in the range 0 to `limit` - 1. */
function accumulate(differences: Int32Array, limit: number, what: string): Uint32Array {
  const values = new Uint32Array(differences.length);
  let sum = 0;
  for (let i = 0; i < differences.length; i++) {
    sum += differences[i];
    if (sum < 0 || sum >= limit) throw new StreamError(what);
    values[i] = sum;
  }
  return values;
}

/**
 * Parses a decompressed side file.
 *
 * @throws StreamError - the bytes do not match the manifest
 */
export function parseSideFile(raw: Uint8Array, group: MotionGroup): SideFile {
  const cursor = new Cursor(raw);
  const { splats } = group;
  const blocks = group.blocks.count;
  const moved = group.frameCount - 1;
  const cells = readOctree(cursor, group.positions.bits, splats);
  const labels = new Uint16Array(
    accumulate(cursor.numbers(splats, 2), blocks, "a splat belongs to a block that does not exist"),
  );
  const classes = cursor.take(splats).slice();
  if (classes.some((value) => value > MAX_CLASS)) throw new StreamError(`a splat has a class above ${MAX_CLASS}`);
  const motions = integrate(cursor.numbers(moved * 12 * blocks, 4), moved, 12 * blocks);
  if (motions.some((value) => Math.abs(value) * group.blocks.step > MAX_MOVE))
    throw new StreamError(`a block moves farther than ${MAX_MOVE}`);
  const turns = integrate(cursor.numbers(moved * 3 * blocks, 4), moved, 3 * blocks);
  if (turns.some((value) => Math.abs(value) * group.blocks.rotationStep > MAX_MOVE))
    throw new StreamError(`the rotation of a block exceeds ${MAX_MOVE}`);
  const count = cursor.numbers(1, 4)[0];
  if (count < 0 || count > cursor.left) throw new StreamError(`the number of escapes is ${count}`);
  const outside = "an escape is outside the group";
  const channel = cursor.take(count);
  if (channel.some((value) => value >= group.channels.length)) throw new StreamError(outside);
  const splat = accumulate(cursor.numbers(count, 4), splats, outside);
  const frame = accumulate(cursor.numbers(count, 4), group.frameCount, outside);
  const beyond = cursor.numbers(count, 4);
  if (cursor.left > 0) throw new StreamError(`${cursor.left} bytes are left over`);
  checkValues(group, channel, beyond);
  return { cells, labels, classes, motions, turns, escapes: byFrame(channel, splat, frame, beyond, group.frameCount) };
}

/** Refuses escapes whose values are out of the bounds of their channel: they cannot be drawn. */
function checkValues({ channels }: MotionGroup, channel: Uint8Array, beyond: Int32Array): void {
  for (let i = 0; i < channel.length; i++) {
    const { name, offset, step } = channels[channel[i]];
    const [low, high] = valueBounds(name);
    const value = offset + ((beyond[i] < 0 ? beyond[i] : beyond[i] + 255) - 128) * step;
    if (value < low || value > high) throw new StreamError(`an escape in ${name} has the value ${value}`);
  }
}

/** Sorts escapes by frame, with a counting sort. */
function byFrame(
  channel: Uint8Array,
  splat: Uint32Array,
  frame: Uint32Array,
  beyond: Int32Array,
  frames: number,
): SideFile["escapes"] {
  const starts = new Uint32Array(frames + 1);
  for (const f of frame) starts[f + 1]++;
  for (let f = 0; f < frames; f++) starts[f + 1] += starts[f];
  const next = starts.slice();
  const count = channel.length;
  const sorted = { starts, channel: new Uint8Array(count), splat: new Uint32Array(count), code: new Int32Array(count) };
  for (let i = 0; i < count; i++) {
    const to = next[frame[i]]++;
    sorted.channel[to] = channel[i]!;
    sorted.splat[to] = splat[i]!;
    sorted.code[to] = beyond[i] < 0 ? beyond[i] : beyond[i] + 255;
  }
  return sorted;
}

/**
 * Decompresses a raw deflate stream, never storing more than `size` bytes of output.
 *
 * @throws StreamError - not a deflate stream of exactly that size
 */
export async function inflate(data: Uint8Array<ArrayBuffer>, size: number): Promise<Uint8Array<ArrayBuffer>> {
  const out = new Uint8Array(size);
  let filled = 0;
  const reader = new Blob([data]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (filled + value.length > size) {
        await reader.cancel();
        throw new StreamError(`it decompresses to more than ${size} bytes`);
      }
      out.set(value, filled);
      filled += value.length;
    }
  } catch (error) {
    if (error instanceof StreamError) throw error;
    throw new StreamError(`it cannot be decompressed (${messageOf(error)})`);
  }
  if (filled !== size) throw new StreamError(`it decompresses to ${filled} bytes, not ${size}`);
  return out;
}
