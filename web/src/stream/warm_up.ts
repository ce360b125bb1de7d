/**
 * Runs the code that prepares a group once on made-up data, so that the browser has compiled it when the first group
 * arrives: before that, it takes several times as long.
 */

import type { MotionRendition } from "./manifest.ts";
import { crc32 } from "./crc32.ts";
import { MotionTables } from "./motion.ts";
import { parseSideFile } from "./side_file.ts";
import { DepthSorter } from "./sort.ts";

/** Few, so that a round is short; browsers compile a loop after some thousands of turns. */
const SPLATS = 512;
const ROUNDS = 24;
const BITS = 12;
const FRAMES = 3;
const BLOCKS = 8;
const ESCAPES = 16;
const TILE = 32;
const COLUMNS = 4;

const GROUP: MotionRendition = {
  index: 0,
  first_frame: 0,
  frame_count: FRAMES,
  splats: SPLATS,
  dilation: 0.3,
  sh_degree: 0,
  bytes: 0,
  id: "",
  qp: 0,
  pruning: "none",
  psnr_to_trained: null,
  tile: TILE,
  columns: COLUMNS,
  rows: COLUMNS,
  positions: { bits: BITS, min: [-0.5, -0.5, -0.5], step: 1 / 4096 },
  blocks: { count: BLOCKS, radius: 0.1, step: 1e-3, rotation_step: 1e-3 },
  channels: Array.from({ length: 13 }, () => ({ name: "", offset: 0.1, step: 0.013 })),
  bounding_box: { min: [0, 0, 0], max: [0, 0, 0] },
  video: { path: "", bytes: 0, sha256: "", qp: 0, checks: [] },
  side: { path: "", bytes: 0, sha256: "", raw_bytes: 0 },
};

/** A side file of that group: a cell for each splat, no motion, a few escapes. */
export function sideFile(): Uint8Array {
  const full = Math.log2(SPLATS) / 3;
  const parts: Uint8Array[] = [];
  for (let level = 0; level < BITS; level++)
    // All eight children first, then a single one.
    parts.push(new Uint8Array(Math.min(8 ** level, SPLATS)).fill(level < full ? 255 : 1 << level % 8));
  const motion = 4 * (FRAMES - 1) * 15 * BLOCKS;
  parts.push(new Uint8Array((4 + 2 + 1) * SPLATS + motion));
  // The zigzag code of a positive number is twice the number. Escapes: channel, splat, frame, code.
  parts.push(Uint8Array.of(2 * ESCAPES, 0, 0, 0), new Uint8Array((1 + 4 + 4 + 4) * ESCAPES));
  const file = new Uint8Array(parts.reduce((size, part) => size + part.length, 0));
  let at = 0;
  for (const part of parts) {
    file.set(part, at);
    at += part.length;
  }
  return file;
}

/** One of `ROUNDS` rounds; browsers compile between them, and other work is not held up for long. */
function round(file: Uint8Array): void {
  const tables = new MotionTables(GROUP, parseSideFile(file, GROUP));
  tables.statics();
  const luma = new Uint8Array((TILE * COLUMNS) ** 2).fill(128);
  crc32(luma);
  const sorter = new DepthSorter();
  const positions = new Float32Array(3 * SPLATS);
  const order = new Uint32Array(SPLATS);
  for (let frame = 0; frame < FRAMES; frame++) {
    const blocks = tables.blocks(frame);
    tables.escapes(frame);
    tables.positions(frame, luma, blocks, positions);
    sorter.sort(positions, tables.pixels, [0.6, 0, 0.8, 2], order);
  }
}

/** The next turn of the event loop. Unlike timers, messages are not delayed to 4 ms when they follow one another. */
function nextTurn(): Promise<void> {
  const { port1, port2 } = new MessageChannel();
  return new Promise((resolve) => {
    port1.onmessage = (): void => {
      port1.close();
      resolve();
    };
    port2.postMessage(null);
  });
}

/**
 * Runs it several times.
 *
 * @param wanted - whether there is still nothing else to do; asked before each round
 * @param also - something else to warm up in each round
 */
export async function warmUp(wanted: () => boolean, also: () => Promise<void> = () => Promise.resolve()): Promise<void> {
  const file = sideFile();
  for (let n = 0; n < ROUNDS; n++) {
    await nextTurn();
    if (!wanted()) return;
    await also();
    if (!wanted()) return;
    round(file);
  }
}
