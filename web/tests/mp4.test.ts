/** The index of video files, held against what FFmpeg reads (tests/web/write_fixtures.py). */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { readVideoIndex, type VideoIndex } from "../src/stream/mp4.ts";

const folder = process.env["V3_FIXTURES"] ?? join(import.meta.dirname, "build", "fixtures");

interface Expected {
  readonly width: number;
  readonly height: number;
  /** [offset, bytes, key, seconds] of each packet. */
  readonly packets: readonly (readonly [number, number, boolean, number])[];
}

const want = JSON.parse(readFileSync(join(folder, "video.json"), "utf8")) as Expected;
const file = new Uint8Array(readFileSync(join(folder, "video.mp4")));
const read = (data: Uint8Array, most = 100): Promise<VideoIndex> =>
  readVideoIndex(() => Promise.resolve(data), data.length, most);

void test("codec, size and packets", async () => {
  const { config, samples } = await read(file);
  assert.deepEqual([config.codec, config.codedWidth, config.codedHeight], ["avc1.4D400C", want.width, want.height]);
  const found = samples.map(({ offset, bytes, key }) => [offset, bytes, key]);
  assert.deepEqual(found, want.packets.map((packet) => packet.slice(0, 3)));
  samples.forEach(({ timestamp }, i) => assert.ok(Math.abs(timestamp - want.packets[i][3]) < 1e-6));
});

void test("no more of the file is needed than its index", async () => {
  const data = file;
  let needed = 0;
  await readVideoIndex((count) => Promise.resolve(data.subarray(0, (needed = Math.max(needed, count)))), data.length, 100);
  const { samples } = await read(data);
  assert.ok(needed <= samples[0].offset);
});

void test("boxes that are not needed may lie anywhere", async () => {
  const data = file;
  const free = new Uint8Array(24);
  new DataView(free.buffer).setUint32(0, 24);
  free.set(new TextEncoder().encode("free"), 4);
  const [plain, shifted] = [await read(data), await read(Uint8Array.from([...free, ...data]))];
  assert.deepEqual(shifted.samples, plain.samples);
});

void test("damage of any byte of the index is refused, or what it says lies in the file", async () => {
  const data = file;
  const first = (await read(data)).samples[0].offset;
  for (let at = 0; at < first; at++)
    for (const value of [0, 1, 127, 255, data[at] ^ 1]) {
      const damaged = data.slice();
      damaged[at] = value;
      const index = await read(damaged).catch((error: unknown) => {
        assert.equal((error as Error).name, "StreamError");
        return null;
      });
      for (const { offset, bytes } of index?.samples ?? []) assert.ok(offset >= 0 && offset + bytes <= data.length);
    }
});

void test("what is no such file is refused with a reason", async () => {
  const data = file;
  await assert.rejects(read(data, 2), /more than 2 frames/);
  await assert.rejects(read(data.subarray(0, 7)), /no index/);
  await assert.rejects(read(new Uint8Array(0)), /no index/);
  await assert.rejects(read(new TextEncoder().encode("<!doctype html><p>not found</p>")), /damaged/);
});
