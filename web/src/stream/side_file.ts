/** Decompresses and parses the side file (docs/STREAM.md, "The side file"). */

import { messageOf, StreamError } from "./errors.ts";
import { valueBounds } from "./layout.ts";
import type { Rendition } from "./manifest.ts";

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
  /** (F - 1, 3, B) rotations, in units of `blocks.rotation_step`. */
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
  private position = 0;

  constructor(private readonly data: Uint8Array) {}

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
    for (let i = 0; i < count; i++) {
      let code = 0;
      for (let byte = 0; byte < width; byte++) code |= planes[byte * count + i] << (8 * byte);
      values[i] = (code >>> 1) ^ -(code & 1);
    }
    return values;
  }
}

/** Coordinates of an octree level's occupied cells, one array per axis. */
type Level = Readonly<Record<"x" | "y" | "z", Uint16Array>>;

const levelOf = (most: number): Level => ({ x: new Uint16Array(most), y: new Uint16Array(most), z: new Uint16Array(most) });

const WRONG_CELLS = "the octree's cells do not match the number of splats";

/** The children of a level's first cells; returns their number. The loops of this file run once a group, most of the time
 * before the browser has compiled them: they create no objects and call no functions for each splat. */
function subdivide(from: Level, occupancy: Uint8Array, to: Level, most: number): number {
  const { x, y, z } = from;
  const { x: toX, y: toY, z: toZ } = to;
  let filled = 0;
  for (let i = 0; i < occupancy.length; i++) {
    const children = occupancy[i];
    const px = x[i] << 1;
    const py = y[i] << 1;
    const pz = z[i] << 1;
    // Most cells have a single child.
    if (children !== 0 && (children & (children - 1)) === 0) {
      if (filled === most) throw new StreamError(WRONG_CELLS);
      const c = 31 - Math.clz32(children);
      toX[filled] = px | (c & 1);
      toY[filled] = py | ((c >> 1) & 1);
      toZ[filled] = pz | (c >> 2);
      filled++;
      continue;
    }
    if (children === 0) throw new StreamError(WRONG_CELLS);
    for (let c = 0; c < 8; c++)
      if (((children >> c) & 1) !== 0) {
        if (filled === most) throw new StreamError(WRONG_CELLS);
        toX[filled] = px | (c & 1);
        toY[filled] = py | ((c >> 1) & 1);
        toZ[filled] = pz | (c >> 2);
        filled++;
      }
  }
  return filled;
}

/** Cells of the octree's last level in Morton order, each repeated once per splat in it: (splats, 3). */
function readOctree(cursor: Cursor, bits: number, splats: number): Uint16Array {
  // The root is at (0, 0, 0).
  let [from, to] = [levelOf(splats), levelOf(splats)];
  let count = 1;
  for (let level = 0; level < bits; level++) {
    count = subdivide(from, cursor.take(count), to, splats);
    [from, to] = [to, from];
  }
  const { x, y, z } = from;
  const shared = cursor.numbers(count, 4);
  const cells = new Uint16Array(3 * splats);
  let at = 0;
  for (let i = 0; i < count; i++) {
    const copies = shared[i] + 1;
    if (copies < 1 || 3 * copies > cells.length - at)
      throw new StreamError("the octree's points do not match the number of splats");
    for (const end = at + 3 * copies; at < end; at += 3) {
      cells[at] = x[i];
      cells[at + 1] = y[i];
      cells[at + 2] = z[i];
    }
  }
  if (at !== cells.length) throw new StreamError("the octree's points do not match the number of splats");
  return cells;
}

/** Undoes second differences over frames, with `rows` numbers per frame. */
function integrate(differences: Int32Array, frames: number, rows: number): Float64Array {
  const values = new Float64Array(differences);
  for (let at = rows; at < 2 * rows && at < frames * rows; at++) values[at] += 2 * values[at - rows];
  for (let at = 2 * rows; at < frames * rows; at++) values[at] += 2 * values[at - rows] - values[at - 2 * rows];
  return values;
}

/** Whether a value is greater than `limit`, or less than -`limit`. */
function exceeds(values: Float64Array | Uint8Array, limit: number): boolean {
  for (let i = 0; i < values.length; i++) {
    const value = values[i];
    if (value > limit || value < -limit) return true;
  }
  return false;
}

const WRONG_LABELS = "the runs of labels do not match the number of splats";

/** Labels of all splats, from runs of equal ones. */
function readLabels(cursor: Cursor, splats: number, blocks: number): Uint16Array {
  const count = cursor.numbers(1, 4)[0];
  if (count < 1 || count > splats) throw new StreamError(WRONG_LABELS);
  const more = cursor.numbers(count, 4);
  const changes = cursor.numbers(count, 2);
  const labels = new Uint16Array(splats);
  let at = 0;
  let label = 0;
  let earlier = 0;
  for (let i = 0; i < count; i++) {
    const next = changes[i] === 0 ? earlier : label + changes[i];
    earlier = label;
    label = next;
    if (label < 0 || label >= blocks) throw new StreamError("a splat belongs to a block that does not exist");
    if (more[i] < 0 || more[i] >= splats - at) throw new StreamError(WRONG_LABELS);
    labels.fill(label, at, at + more[i] + 1);
    at += more[i] + 1;
  }
  if (at !== splats) throw new StreamError(WRONG_LABELS);
  return labels;
}

/** Classes of all splats, from two in a byte. */
function readClasses(cursor: Cursor, splats: number): Uint8Array {
  const pairs = cursor.take(Math.ceil(splats / 2));
  const classes = new Uint8Array(splats);
  for (let i = 0; i < splats; i++) classes[i] = (pairs[i >> 1] >> (4 * (i & 1))) & 15;
  return classes;
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

/** Parses a decompressed side file. StreamError: the bytes do not match the manifest. */
export function parseSideFile(raw: Uint8Array, group: Rendition): SideFile {
  const cursor = new Cursor(raw);
  const { splats } = group;
  const blocks = group.blocks.count;
  const moved = group.frame_count - 1;
  const cells = readOctree(cursor, group.positions.bits, splats);
  const labels = readLabels(cursor, splats, blocks);
  const classes = readClasses(cursor, splats);
  const motions = integrate(cursor.numbers(moved * 12 * blocks, 4), moved, 12 * blocks);
  if (exceeds(motions, MAX_MOVE / group.blocks.step))
    throw new StreamError(`a block moves farther than ${MAX_MOVE}`);
  const turns = integrate(cursor.numbers(moved * 3 * blocks, 4), moved, 3 * blocks);
  if (exceeds(turns, MAX_MOVE / group.blocks.rotation_step))
    throw new StreamError(`the rotation of a block exceeds ${MAX_MOVE}`);
  const count = cursor.numbers(1, 4)[0];
  if (count < 0 || count > cursor.left) throw new StreamError(`the number of escapes is ${count}`);
  const outside = "an escape is outside the group";
  const channel = cursor.take(count);
  if (exceeds(channel, group.channels.length - 1)) throw new StreamError(outside);
  const splat = accumulate(cursor.numbers(count, 4), splats, outside);
  const frame = accumulate(cursor.numbers(count, 4), group.frame_count, outside);
  const beyond = cursor.numbers(count, 4);
  if (cursor.left > 0) throw new StreamError(`${cursor.left} bytes are left over`);
  for (let i = 1; i < count; i++) {
    const rises = channel[i] - channel[i - 1] || splat[i] - splat[i - 1] || frame[i] - frame[i - 1];
    if (rises <= 0) throw new StreamError("the escapes are not in order, or two are of one value");
  }
  checkValues(group, channel, beyond);
  return { cells, labels, classes, motions, turns, escapes: byFrame(channel, splat, frame, beyond, group.frame_count) };
}

/** Refuses escapes whose values are out of the bounds of their channel: they cannot be drawn. */
function checkValues({ channels }: Rendition, channel: Uint8Array, beyond: Int32Array): void {
  for (let i = 0; i < channel.length; i++) {
    const { name, offset, step } = channels[channel[i]];
    const [low, high] = valueBounds(name);
    const code = beyond[i] < 0 ? beyond[i] : beyond[i] + 255;
    const value = offset + (code - 128) * step;
    if (value < low || value > high || code >= 2 ** 31) throw new StreamError(`an escape in ${name} has the value ${value}`);
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

const SLICE = 16_384; // bytes that are decompressed at a time: they become at most a thousand times as many

/** Writes to a stream as fast as it is read. A Blob would be another way, through the browser's process. */
async function feed(writer: WritableStreamDefaultWriter<BufferSource>, data: Uint8Array<ArrayBuffer>): Promise<void> {
  for (let at = 0; at < data.length; at += SLICE) await writer.write(data.subarray(at, at + SLICE));
  await writer.close();
}

/** Decompresses a raw deflate stream, never storing more than `size` bytes of output. StreamError: not a deflate stream of
 * exactly that size. */
export async function inflate(data: Uint8Array<ArrayBuffer>, size: number): Promise<Uint8Array<ArrayBuffer>> {
  const out = new Uint8Array(size);
  let filled = 0;
  const { readable, writable } = new DecompressionStream("deflate-raw");
  const reader = readable.getReader();
  // The reader receives its errors.
  feed(writable.getWriter(), data).catch(() => undefined);
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
