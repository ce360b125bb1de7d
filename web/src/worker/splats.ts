/** Dequantizes all of a frame's splats, for engines that take arrays; the player's own shaders read the image instead. */

import type { GroupSetup, Splats } from "./messages.ts";
import { BLOCK_FLOATS, type MotionTables } from "../stream/motion.ts";

type Arrays = Pick<Splats, "means" | "quats" | "scales" | "opacities" | "sh">;

/** Floats per splat. */
export function splatFloats(shDegree: number): number {
  return 11 + 3 * (shDegree + 1) ** 2;
}

/** Divides a buffer of `count * splatFloats(shDegree)` floats. */
export function splatArrays(buffer: ArrayBuffer, count: number, shDegree: number): Arrays {
  let at = 0;
  const next = (width: number): Float32Array<ArrayBuffer> => {
    const part = new Float32Array(buffer, 4 * at, count * width);
    at += count * width;
    return part;
  };
  return { means: next(3), quats: next(4), scales: next(3), opacities: next(1), sh: next(3 * (shDegree + 1) ** 2) };
}

/** Where a channel's values go: an array, the distance from one splat's value to the next, and the place of the first. */
type Target = readonly [array: Float32Array, stride: number, first: number];

const clamped = (value: number): number => Math.min(Math.max(value, 0), 1);
const same = (value: number): number => value;

/**
 * Fills in everything but the means.
 *
 * @param within - frame within the group
 * @param luma - the decoded image
 * @param blocks - the frame's block table, or null in the profile `planes`
 */
export function dequantize(
  setup: GroupSetup,
  tables: MotionTables | null,
  within: number,
  luma: Uint8Array,
  blocks: Float32Array | null,
  out: Arrays,
): void {
  const { splats: count, units, tile, columns, shDegree } = setup;
  const coefficients = 3 * (shDegree + 1) ** 2;
  const offsets = tables?.offsets ?? rowOffsets(count, tile, columns);
  const { quats, scales, opacities, sh } = out;
  // By channel; the first ones are positions.
  const motion = tables !== null;
  const rotations: Target[] = [0, 1, 2, 3].map((k) => [quats, 4, k]);
  const logScales: Target[] = [0, 1, 2].map((k) => [scales, 3, k]);
  const harmonics: Target[] = Array.from({ length: coefficients }, (_, k) => [sh, coefficients, k]);
  const opacity: Target = [opacities, 1, 0];
  const targets = motion
    ? [...rotations.slice(1), ...logScales, opacity, ...harmonics]
    : [...harmonics, opacity, ...logScales, ...rotations];
  const first = motion ? 3 : 6;
  const meaning = ([array]: Target): ((value: number) => number) =>
    array === scales ? Math.exp : array === opacities ? clamped : same;
  targets.forEach((target, k) => {
    const channel = first + k;
    const finish = meaning(target);
    const values = Float32Array.from({ length: 256 }, (_, code) => finish(units[2 * channel] + code * units[2 * channel + 1]));
    const corner = Math.floor(channel / columns) * tile * tile * columns + (channel % columns) * tile;
    const [array, stride, begin] = target;
    for (let i = 0, to = begin; i < count; i++, to += stride) array[to] = values[luma[corner + offsets[i]]];
  });
  if (tables === null) {
    normalize(quats);
    return;
  }
  const { starts, channel, splat, code } = tables.side.escapes;
  for (let e = starts[within]; e < starts[within + 1]; e++) {
    const target = targets[channel[e] - first];
    if ((target as Target | undefined) === undefined) continue; // a position, or none
    const [array, stride, begin] = target;
    array[stride * splat[e] + begin] = meaning(target)(units[2 * channel[e]] + code[e] * units[2 * channel[e] + 1]);
  }
  turn(quats, tables.side.labels, blocks!);
  mixColors(sh);
}

/** Distances from a tile's first value in the image, for splats in rows. */
function rowOffsets(count: number, tile: number, columns: number): Uint32Array {
  return Uint32Array.from({ length: count }, (_, i) => Math.floor(i / tile) * tile * columns + (i % tile));
}

function normalize(quats: Float32Array): void {
  for (let q = 0; q < quats.length; q += 4) {
    const size = Math.hypot(quats[q], quats[q + 1], quats[q + 2], quats[q + 3]) || 1;
    for (let k = 0; k < 4; k++) quats[q + k] /= size;
  }
}

/** From modified Rodrigues parameters within the blocks (x, y, z at 1 to 3 of each quaternion) to quaternions in the world. */
function turn(quats: Float32Array, labels: ArrayLike<number>, blocks: Float32Array): void {
  for (let q = 0, i = 0; q < quats.length; q += 4, i++) {
    const px = quats[q + 1];
    const py = quats[q + 2];
    const pz = quats[q + 3];
    const square = px * px + py * py + pz * pz;
    const scale = 1 / (1 + square);
    const w = (1 - square) * scale;
    const x = 2 * px * scale;
    const y = 2 * py * scale;
    const z = 2 * pz * scale;
    const at = BLOCK_FLOATS * labels[i] + 16;
    const bw = blocks[at];
    const bx = blocks[at + 1];
    const by = blocks[at + 2];
    const bz = blocks[at + 3];
    quats[q] = bw * w - bx * x - by * y - bz * z;
    quats[q + 1] = bw * x + w * bx + by * z - bz * y;
    quats[q + 2] = bw * y + w * by + bz * x - bx * z;
    quats[q + 3] = bw * z + w * bz + bx * y - by * x;
  }
}

/** From luma, orange and green to RGB. */
function mixColors(sh: Float32Array): void {
  for (let k = 0; k < sh.length; k += 3) {
    const luma = sh[k];
    const orange = sh[k + 1];
    const green = sh[k + 2];
    sh[k] = luma + orange - green;
    sh[k + 1] = luma + green;
    sh[k + 2] = luma - orange - green;
  }
}
