/** Dequantizes all of a frame's splats, for engines that take arrays; the player's own shaders read the image instead. */

import { attributeNames, tileCorner, tilesOf, unitsOf } from "../stream/layout.ts";
import { BLOCK_FLOATS, type MotionTables } from "../stream/motion.ts";
import type { SplatArrays } from "./messages.ts";
import type { Pool } from "./pool.ts";

/** The splats of a frame. `within`: frame within the group. `luma`: the decoded image. */
export function splatsOf(tables: MotionTables, within: number, luma: Uint8Array, pool: Pool): SplatArrays {
  const { splats, sh_degree: shDegree } = tables.group;
  const out = splatArrays(pool, splats, shDegree);
  const blocks = tables.blocks(within);
  tables.positions(within, luma, blocks, out.means);
  dequantize(tables, within, luma, blocks, out);
  return out;
}

/** Arrays for a frame's splats, one after the other in a buffer. */
function splatArrays(pool: Pool, count: number, shDegree: number): SplatArrays {
  const lengths = { means: 3, sh: 3 * (shDegree + 1) ** 2, opacities: 1, scales: 3, quats: 4 };
  const { buffer } = pool.take(4 * count * (lengths.sh + 11));
  let at = 0;
  const arrays = Object.entries(lengths).map(([name, length]) => {
    const part = new Float32Array(buffer, 4 * at, count * length);
    at += count * length;
    return [name, part];
  });
  return Object.fromEntries(arrays) as SplatArrays;
}

/** The destination of a channel's values: an array, the distance from one splat's value to the next, and the place of the first. */
type Target = readonly [array: Float32Array, stride: number, first: number];

const clamped = (value: number): number => Math.min(Math.max(value, 0), 1);
const same = (value: number): number => value;

/** Fills in everything but the means. `blocks`: the frame's block table. */
function dequantize(tables: MotionTables, within: number, luma: Uint8Array, blocks: Float32Array, out: SplatArrays): void {
  const { group, offsets } = tables;
  const { splats: count, sh_degree: shDegree } = group;
  const units = unitsOf(group);
  const { quats, scales, opacities, sh } = out;
  const tiles = tilesOf(shDegree);
  // By tile. Quaternions and scales hold the shapes until `findAxes`.
  const targets = new Map<number, Target>();
  for (const [name, { length }] of attributeNames(shDegree)) {
    if (name === "means") continue;
    for (let k = 0; k < length; k++) {
      const shape: Target = k < 3 ? [quats, 4, k + 1] : [scales, 3, k - 3];
      targets.set(tiles[name] + k, name === "scales" ? shape : [out[name], length, k]);
    }
  }
  const meaning = ([array]: Target): ((value: number) => number) => (array === opacities ? clamped : same);
  targets.forEach((target, channel) => {
    const finish = meaning(target);
    const values = Float32Array.from({ length: 256 }, (_, code) => finish(units[2 * channel] + code * units[2 * channel + 1]));
    const corner = tileCorner(group, channel);
    const [array, stride, begin] = target;
    for (let i = 0, to = begin; i < count; i++, to += stride) array[to] = values[luma[corner + offsets[i]]];
  });
  const { starts, channel, splat, code } = tables.side.escapes;
  for (let e = starts[within]; e < starts[within + 1]; e++) {
    const target = targets.get(channel[e]);
    if (target === undefined) continue; // a position
    const [array, stride, begin] = target;
    array[stride * splat[e] + begin] = meaning(target)(units[2 * channel[e]] + code[e] * units[2 * channel[e] + 1]);
  }
  findAxes(quats, scales);
  turn(quats, tables.side.labels, blocks);
  mixColors(sh);
}

const SWEEPS = 3;

/** Turns shapes (xx, yy, zz at 1 to 3 of each quaternion, xy, xz, yz in the scales) into rotations and scales within the blocks:
 * Jacobi rotations, as in studio/stream/shapes.py. */
function findAxes(quats: Float32Array, scales: Float32Array): void {
  // Entry (p, q) is at 2 + p + q, entry (p, p) at p.
  const shape = new Float64Array(6);
  const quat = new Float64Array(4);
  for (let i = 0, q = 0; i < scales.length; i += 3, q += 4) {
    for (let k = 0; k < 3; k++) {
      shape[k] = quats[q + 1 + k];
      shape[3 + k] = scales[i + k];
    }
    quat.fill(0);
    quat[0] = 1;
    for (let sweep = 0; sweep < SWEEPS; sweep++) {
      rotate(shape, quat, 0, 1, 3, -1);
      rotate(shape, quat, 0, 2, 2, 1);
      rotate(shape, quat, 1, 2, 1, -1);
    }
    for (let k = 0; k < 4; k++) quats[q + k] = quat[k]; // faster than `set`
    for (let k = 0; k < 3; k++) scales[i + k] = shape[k] * shape[k];
  }
}

/** One Jacobi rotation: makes the entry (a, b) zero. The quaternion turns about the component `around`. */
function rotate(shape: Float64Array, quat: Float64Array, a: number, b: number, around: number, sign: number): void {
  const across = shape[2 + a + b];
  if (across === 0) return;
  const difference = shape[b] - shape[a];
  const reach = Math.abs(difference) + Math.sqrt(difference * difference + 4 * across * across);
  const tangent = ((difference < 0 ? -2 : 2) * across) / reach;
  const cosine = 1 / Math.sqrt(1 + tangent * tangent);
  const sine = tangent * cosine;
  shape[a] -= tangent * across;
  shape[b] += tangent * across;
  shape[2 + a + b] = 0;
  const other = 3 - a - b;
  const first = shape[2 + other + a];
  const second = shape[2 + other + b];
  shape[2 + other + a] = cosine * first - sine * second;
  shape[2 + other + b] = sine * first + cosine * second;
  const half = Math.sqrt((1 + cosine) / 2);
  const turned = (sign * sine) / (2 * half);
  const next = (around % 3) + 1;
  const last = (next % 3) + 1;
  const w = quat[0];
  const x = quat[around];
  const y = quat[next];
  const z = quat[last];
  quat[0] = w * half - x * turned;
  quat[around] = w * turned + x * half;
  quat[next] = y * half + z * turned;
  quat[last] = z * half - y * turned;
}

/** Turns rotations within the blocks into those in the world. */
function turn(quats: Float32Array, labels: ArrayLike<number>, blocks: Float32Array): void {
  for (let q = 0, i = 0; q < quats.length; q += 4, i++) {
    const w = quats[q];
    const x = quats[q + 1];
    const y = quats[q + 2];
    const z = quats[q + 3];
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

/** Turns luma, orange and green into RGB. */
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
