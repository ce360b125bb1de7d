/** Channels are found by their names: in another order, a frame is the same. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { names } from "stream-schema";
import { imageSplats } from "../src/render/shaders.ts";
import { attributeNames, channelNames } from "../src/stream/layout.ts";
import { parseManifest, type Rendition } from "../src/stream/manifest.ts";
import { MotionTables } from "../src/stream/motion.ts";
import { inflate, parseSideFile, type SideFile } from "../src/stream/side_file.ts";
import { Pool } from "../src/worker/pool.ts";
import { splatsOf } from "../src/worker/splats.ts";

const folder = process.env["V3_FIXTURES"] ?? join(import.meta.dirname, "build", "fixtures");
const bytes = (name: string): Uint8Array<ArrayBuffer> => new Uint8Array(readFileSync(join(folder, name)));

function frame(group: Rendition, side: SideFile, luma: Uint8Array): Record<string, number[]> {
  const out = splatsOf(new MotionTables(group, side), 1, luma, new Pool());
  return Object.fromEntries(Object.entries(out).map(([name, array]) => [name, Array.from(array as Float32Array)]));
}

/** The shader, with the names of channels in place of their numbers. */
function shader(): string {
  const tiles = attributeNames(1).flatMap(([name, { length }]) => Array.from({ length }, (_, k) => `${name} ${k}`));
  return imageSplats(1).replace(/(?<=\bv\()\d+/g, (number) => tiles[Number(number)]);
}

void test("attributes are found by name", async () => {
  const manifest = bytes("motion.json");
  const group = parseManifest(new TextDecoder().decode(manifest), manifest.length).groups[0].renditions[0];
  const side = parseSideFile(await inflate(bytes("motion.bin"), group.side.raw_bytes), group);
  const { tile, columns, rows, sh_degree: degree } = group;
  const luma = bytes("motion.luma").subarray(tile * tile * columns * rows, 2 * tile * tile * columns * rows);
  const wanted = [frame(group, side, luma), shader()];
  const before = channelNames(degree);

  const table = names as Record<string, readonly string[]>;
  for (const [name, own] of Object.entries(table).reverse()) {
    Reflect.deleteProperty(table, name);
    table[name] = own;
  }
  const now = channelNames(degree);
  assert.notDeepEqual(now, before);
  const places = now.map((name) => before.indexOf(name));
  const moved = new Uint8Array(luma.length);
  places.forEach((from, to) => {
    const [start, end] = [from, to].map((c) => Math.floor(c / columns) * tile * tile * columns + (c % columns) * tile);
    for (let row = 0; row < tile; row++) {
      const down = row * tile * columns;
      moved.set(luma.subarray(start + down, start + down + tile), end + down);
    }
  });
  const escapes = { ...side.escapes, channel: side.escapes.channel.map((c) => places.indexOf(c)) };
  const channels = places.map((from) => group.channels[from]);
  assert.deepEqual([frame({ ...group, channels }, { ...side, escapes }, moved), shader()], wanted);
});
