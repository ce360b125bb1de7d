/** Reading a stream, held against arrays that Python wrote (tests/web/write_fixtures.py). */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import zlib from "node:zlib";
import { RateRule } from "../src/worker/rate_rule.ts";
import { crc32 } from "../src/stream/crc32.ts";
import { tilePixels, tileSide } from "../src/stream/layout.ts";
import {
  groupOfFrame,
  type Manifest,
  parseManifest,
  parsePage,
  type Rendition,
} from "../src/stream/manifest.ts";
import { MotionTables } from "../src/stream/motion.ts";
import { inDisplayOrder, samplesNeeded } from "../src/stream/mp4.ts";
import { inflate, parseSideFile, type SideFile } from "../src/stream/side_file.ts";
import { DepthSorter, OF_SET, SortedSet } from "../src/stream/sort.ts";
import { linkTo, parseView } from "../src/ui/link.ts";

const folder = process.env["V3_FIXTURES"] ?? join(import.meta.dirname, "build", "fixtures");
const bytes = (name: string): Uint8Array<ArrayBuffer> => new Uint8Array(readFileSync(join(folder, name)));
const json = (name: string): unknown => JSON.parse(readFileSync(join(folder, name), "utf8"));

function group(name: string): Rendition {
  const data = bytes(`${name}.json`);
  return parseManifest(new TextDecoder().decode(data), data.length).groups[0].renditions[0];
}

async function side(): Promise<[Rendition, SideFile]> {
  const motion = group("motion");
  return [motion, parseSideFile(await inflate(bytes("motion.bin"), motion.side.raw_bytes), motion)];
}

interface Arrays {
  cells: number[];
  labels: number[];
  classes: number[];
  motions: number[];
  turns: number[];
  escapes: [number, number, number, number][];
  pixels: number[];
}

void test("the side file contains what Python reads from it", async () => {
  const [motion, read] = await side();
  const want = json("side.json") as Arrays;
  assert.deepEqual([...read.cells], want.cells);
  assert.deepEqual([...read.labels], want.labels);
  assert.deepEqual([...read.classes], want.classes);
  assert.deepEqual([...read.motions], want.motions);
  assert.deepEqual([...read.turns], want.turns);
  assert.ok(want.escapes.length > 0, "the fixture has no escapes");
  const { starts, splat, channel, code } = read.escapes;
  const escapes: number[][] = [];
  for (let frame = 0; frame < motion.frame_count; frame++)
    for (let e = starts[frame]; e < starts[frame + 1]; e++) escapes.push([frame, splat[e], channel[e], code[e]]);
  const key = ([frame, s, c]: number[]): number => (frame * 1e6 + s) * 100 + c;
  escapes.sort((a, b) => key(a) - key(b));
  assert.deepEqual(escapes, want.escapes.sort((a, b) => key(a) - key(b)));
});

void test("positions are Python's bit by bit", async () => {
  const [motion, read] = await side();
  const tables = new MotionTables(motion, read);
  assert.deepEqual([...tables.pixels], (json("side.json") as Arrays).pixels);
  const luma = bytes("motion.luma");
  const want = new Float32Array(bytes("motion.positions").buffer);
  const size = luma.length / motion.frame_count;
  const out = new Float32Array(3 * motion.splats);
  for (let frame = 0; frame < motion.frame_count; frame++) {
    tables.positions(frame, luma.subarray(frame * size, (frame + 1) * size), tables.blocks(frame), out);
    assert.deepEqual(out, want.subarray(frame * out.length, (frame + 1) * out.length), `frame ${frame}`);
  }
});

void test("pixels of the Morton curve are Python's", () => {
  for (const [key, want] of Object.entries(json("morton.json") as Record<string, number[]>)) {
    const [tile, count] = key.split(" ").map(Number);
    const pixels = tilePixels(tile, count);
    const sum = pixels.reduce((a, b) => a + b, 0);
    assert.deepEqual([sum, ...pixels.slice(0, 50), ...pixels.slice(-50)], want, key);
  }
});

void test("a damaged side file is refused, whatever byte is wrong", async () => {
  const motion = group("motion");
  const raw = await inflate(bytes("motion.bin"), motion.side.raw_bytes);
  let refused = 0;
  for (let at = 0; at < raw.length; at += 97) {
    const changed = raw.slice();
    changed[at] ^= 0x55;
    try {
      const read = parseSideFile(changed, motion);
      assert.ok(read.labels.every((label) => label < motion.blocks.count));
    } catch (error) {
      assert.equal((error as Error).name, "StreamError");
      refused++;
    }
  }
  assert.ok(refused > 10);
  assert.throws(() => parseSideFile(raw.subarray(0, -1), motion), /ends early/);
  await assert.rejects(inflate(bytes("motion.bin"), motion.side.raw_bytes - 1), /more than/);
  await assert.rejects(inflate(bytes("motion.bin"), motion.side.raw_bytes + 1), /not/);
  await assert.rejects(inflate(bytes("motion.bin").slice(9), motion.side.raw_bytes), /./);
});

void test("escapes that are not in order are refused", async () => {
  const motion = group("motion");
  const raw = await inflate(bytes("motion.bin"), motion.side.raw_bytes);
  // The escapes are the end of the file: a byte for each channel, and four for splat, frame and code.
  const count = (json("side.json") as Arrays).escapes.length;
  const first = raw.length - 13 * count;
  const channels = raw.slice(first, first + count);
  assert.ok(channels[0] < channels[count - 1]);
  raw.set(channels.reverse(), first);
  assert.throws(() => parseSideFile(raw, motion), /order/);
});

void test("a side file that decompresses to far more than it says is not decompressed", async () => {
  const bomb = new Uint8Array(zlib.deflateRawSync(new Uint8Array(8 << 20)));
  await assert.rejects(inflate(bomb, 1000), /more than 1000/);
});

void test("all that is drawn is finite, whatever numbers the manifest has", async () => {
  const text = new TextDecoder().decode(bytes("motion.json"));
  const inflated = await inflate(bytes("motion.bin"), group("motion").side.raw_bytes);
  const luma = bytes("motion.luma");
  type Numbers = Record<string, number>;
  const places: ((group: { positions: Numbers; blocks: Numbers; channels: Numbers[] }) => readonly [Numbers, string])[] = [
    (g) => [g.positions, "step"],
    ...["radius", "step", "rotation_step"].map((key) => (g: { blocks: Numbers }) => [g.blocks, key] as const),
    ...[0, 3, 6, 10].flatMap((c) =>
      ["offset", "step"].map((key) => (g: { channels: Numbers[] }) => [g.channels[c], key] as const),
    ),
  ];
  let [drawn, refused] = [0, 0];
  for (const place of places)
    for (const value of [5e-324, 1e-300, 1e-9, 1e5, 1e8, 1e9, -1e9]) {
      const values = JSON.parse(text) as { groups: { renditions: Parameters<(typeof places)[0]>[0][] }[] };
      const [at, key] = place(values.groups[0].renditions[0]);
      at[key] = value;
      try {
        const motion = parseManifest(JSON.stringify(values), bytes("motion.json").length).groups[0].renditions[0];
        const tables = new MotionTables(motion, parseSideFile(inflated, motion));
        const positions = new Float32Array(3 * motion.splats);
        for (let index = 0; index < motion.frame_count; index++) {
          const blocks = tables.blocks(index);
          assert.ok(blocks.every(Number.isFinite), `${key} ${value}`);
          tables.positions(index, luma.subarray(0, motion.rows * motion.columns * motion.tile ** 2), blocks, positions);
          assert.ok(positions.every(Number.isFinite), `${key} ${value}`);
        }
        drawn++;
      } catch (error) {
        if ((error as Error).name !== "StreamError") throw error;
        refused++;
      }
    }
  assert.ok(drawn > 10 && refused > 10, `${drawn} drawn, ${refused} refused`);
});

void test("splats are sorted back to front, the later one first at equal depth", () => {
  let seed = 1;
  const random = (): number => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const count = 20_000;
  const positions = Float32Array.from({ length: 3 * count }, () => 4 * random() - 2);
  const axis = [0.48, -0.6, 0.64, 1.5] as const;
  const out = new Uint32Array(count);
  const total = new DepthSorter().sort(positions, null, axis, out);
  const depth = (i: number): number =>
    axis[0] * positions[3 * i] + axis[1] * positions[3 * i + 1] + axis[2] * positions[3 * i + 2] + axis[3];
  const front = Array.from({ length: count }, (_, i) => i).filter((i) => depth(i) >= 0.01);
  assert.equal(total, front.length);
  assert.deepEqual(new Set(out.subarray(0, total)), new Set(front));
  for (let k = 1; k < total; k++) assert.ok(depth(out[k]) - depth(out[k - 1]) < 8 / 65535);
  const flat = new Uint32Array(5);
  const pixels = Uint32Array.of(50, 40, 30, 20, 10);
  assert.equal(new DepthSorter().sort(new Float32Array(15), pixels, [0, 0, 1, 1], flat), 5);
  assert.deepEqual([...flat], [10, 20, 30, 40, 50]);
  assert.equal(new DepthSorter().sort(new Float32Array(15), pixels, [0, 0, 1, -1], flat), 0);
});

void test("another format or version is refused in a sentence", () => {
  const text = new TextDecoder().decode(bytes("motion.json"));
  const version = Number(/"version":(\d+)/.exec(text)![1]);
  for (const other of [version - 1, version + 1, `"${version}"`, null])
    assert.throws(() => parseManifest(text.replace(/"version":\d+/, `"version":${other}`), 1), RegExp(`has format version .* plays version ${version}`));
  assert.throws(() => parseManifest("[", 1), /not readable JSON/);
  for (const other of ["{}", "null", "[]"]) assert.throws(() => parseManifest(other, 2), /not the manifest/);
});

const ladder = (): [string, Manifest] => {
  const text = new TextDecoder().decode(bytes("ladder.json"));
  return [text, parseManifest(text, bytes("ladder.json").length)];
};

void test("groups have renditions, in the manifest and in pages", () => {
  const [, manifest] = ladder();
  assert.deepEqual(manifest.renditions.map(({ id }) => id), ["qp20", "qp34"]);
  assert.deepEqual(manifest.spans, [{ firstFrame: 0, frameCount: 3 }, { firstFrame: 3, frameCount: 2 }]);
  assert.equal(manifest.groups.length, 1);
  const page = manifest.pages[0];
  const text = new TextDecoder().decode(bytes("page.json"));
  const [{ renditions: [best, coarse] }] = parsePage(text, page, manifest);
  assert.deepEqual([best.id, best.index, best.first_frame, best.frame_count], ["qp20", 1, 3, 2]);
  assert.ok(best.bytes > coarse.bytes);
  assert.throws(() => parsePage(text.replace('"frame_count":2', '"frame_count":3'), page, manifest), /frame_count/);
  assert.throws(() => parsePage(text.replaceAll('"qp34"', '"qp35"'), page, manifest), /id must be qp34/);
  assert.throws(() => parsePage("[]", page, manifest), /not an object/);
  assert.throws(() => parsePage('{"format":"v3studio-stream-page","groups":[]}', page, manifest), /groups/);
});

void test("a group without a dilation has that of 3DGS", () => {
  const [text] = ladder();
  const read = (dilation?: number): number => {
    const values = JSON.parse(text) as { groups: { renditions: { dilation?: number }[] }[] };
    if (dilation !== undefined) values.groups[0].renditions[0].dilation = dilation;
    return parseManifest(JSON.stringify(values), 1).groups[0].renditions[0].dilation;
  };
  assert.deepEqual([read(), read(0.001), read(0.05), read(1)], [0.3, 0.001, 0.05, 1]);
});

/** Deep changes of a manifest, and what the refusal says. Bounds of single values come from the schema, others do not. */
const REFUSED: readonly (readonly [place: string, value: unknown, message: RegExp])[] = [
  ["fps", 0, /fps must be a number above 0/],
  ["frame_count", 4, /frame_count must be 5/],
  ["total_bytes", 1.5, /total_bytes must be an integer/],
  ["manifest_sha256", "0", /manifest_sha256/],
  ["bounding_box.min.1", 1e9, /bounding_box has a minimum above/],
  ["bounding_box.max.2", 1e10, /bounding_box\.max\.2/],
  ["renditions.1.id", "qp20", /twice/],
  ["renditions.0.splats", 1, /splats must be at most 1/],
  ["renditions.0.bandwidth", -1, /renditions\.0\.bandwidth/],
  ["groups.0.index", 1, /groups\.0\.index must be 0/],
  ["groups.0.renditions.0.frame_count", 2, /frame_count must be 3/],
  ["groups.0.renditions.0.sh_degree", 1, /sh_degree must be 0/],
  ["groups.0.renditions.0.splats", 1e9, /groups\.0\.renditions\.0\.splats/],
  ["groups.0.renditions.0.bytes", 7, /sum of its file sizes/],
  ["groups.0.renditions.0.tile", 48, /tile does not fit/],
  ["groups.0.renditions.0.columns", 1, /tiles for \d+ channels/],
  ["groups.0.renditions.0.side.path", "/etc/passwd", /not named by/],
  ["groups.0.renditions.0.side.raw_bytes", 2 ** 40, /side\.raw_bytes/],
  ["groups.0.renditions.0.video.path", `files/${"0".repeat(32)}.mp4`, /not named by/],
  ["groups.0.renditions.0.video.checks", [], /video\.checks/],
  ["groups.0.renditions.0.video.checks.0.picture", 1, /checks\.0\.picture/],
  ["groups.0.renditions.0.video.checks.1.picture", 0, /checks\.1\.picture/],
  ["groups.0.renditions.0.channels.2.step", 0, /channels\.2\.step/],
  ["groups.0.renditions.0.channels.2.name", "constructor", /channels do not match/],
  ["groups.0.renditions.0.channels.6.offset", 90_000, /shape_xy beyond/],
  ["groups.0.renditions.0.channels.10.step", 1e9, /sh_0_y beyond/],
  ["groups.0.renditions.0.blocks.radius", 1e-300, /blocks\.radius/],
  ["groups.0.renditions.0.blocks.count", 32767, /32767 blocks/],
  ["groups.0.renditions.0.positions.min", [0, 0], /positions\.min must be a list of 3/],
  ...[0, 1.5, -0.1, null, "0.1"].map((value) => ["groups.0.renditions.0.dilation", value, /dilation/] as const),
  ["pages.0.frames", [3], /frame_count/],
  ["pages.0.frames", [-1], /frames/],
  ["audio.samples", 48_000, /audio ends after the frames/],
  ["audio.start", -1, /audio\.start/],
  ["audio.start", 0.2, /audio ends after the frames/],
  ["audio.codec", "opus", /audio\.codec/],
  ["audio.channels", 8, /audio\.channels/],
  ["audio.bytes", 2 ** 29, /audio\.bytes/],
  ["audio.path", `files/${"0".repeat(32)}.m4a`, /not named by/],
];

type Values = Record<string, unknown>;

/** A copy of the JSON with another value at a place. */
function changed(text: string, place: string, value: unknown): string {
  const values = JSON.parse(text) as Values;
  const keys = place.split(".");
  const last = keys.pop()!;
  const parent = keys.reduce((at, key) => at[key] as Values, values);
  assert.ok(last in parent || last === "dilation", place);
  parent[last] = value;
  return JSON.stringify(values);
}

void test("manifests out of bounds are refused with the place", () => {
  const text = new TextDecoder().decode(bytes("ladder.json"));
  for (const [place, value, message] of REFUSED) assert.throws(() => parseManifest(changed(text, place, value), 1), message, place);
});

void test("missing values, and values of another type, are refused", () => {
  const [text] = ladder();
  const withDefault = /^(live|audio|set|settings|metadata|dilation)$|\.\d+$/;
  const visit = (at: unknown, place: string): void => {
    if (typeof at !== "object" || at === null || /^(settings|metadata)$/.test(place)) return;
    for (const [key, value] of Object.entries(at)) {
      const inner = place === "" ? key : `${place}.${key}`;
      for (const other of withDefault.test(inner) ? ["?", 1e30] : [undefined, "?", {}, [[]]])
        assert.throws(() => parseManifest(changed(text, inner, other), 1), { name: "StreamError" }, inner);
      visit(value, inner);
    }
  };
  visit(JSON.parse(text), "");
});

void test("CRC-32 is that of zlib, and of the luma that Python decodes", () => {
  assert.equal(crc32(new TextEncoder().encode("123456789")), 0xcbf43926);
  for (let length = 0; length < 70; length++) {
    const data = Uint8Array.from({ length }, (_, i) => (i * i * 37 + length) & 255);
    assert.equal(crc32(data), zlib.crc32(data));
  }
  const [, manifest] = ladder();
  const [group] = manifest.groups[0].renditions;
  const luma = bytes("ladder.luma");
  const size = luma.length / group.frame_count;
  for (const { picture, crc32: wanted } of group.video.checks)
    assert.equal(crc32(luma.subarray(picture * size, (picture + 1) * size)), wanted);
});

void test("renditions are chosen as another implementation of the rule chose them, on a network that wanders", () => {
  const { rates, steps } = json("rule.json") as { rates: number[]; steps: [number, number, number, number][] };
  const rule = new RateRule(rates);
  for (const [buffered, bytes, seconds, wanted] of steps) {
    assert.equal(rule.choose(buffered), wanted);
    rule.fetched(bytes, seconds);
  }
});

void test("a set is merged into a frame's order by depth", () => {
  const [own, behind] = [7, 30].map((count) => Float32Array.from({ length: 3 * count }, (_, i) => ((i * 7919) % 101) / 50 - 1));
  const pixels = Uint32Array.from({ length: 7 }, (_, i) => 100 + i);
  const set = new SortedSet(behind);
  const sorter = new DepthSorter();
  for (const axis of [[0, 0, 1, 2], [0, 0, 1, 2], [1, 0, 0, 0.5]] as const) {
    const order = new Uint32Array(7);
    const count = sorter.sort(own, null, axis, order);
    const out = new Uint32Array(37);
    const total = set.merge(order, count, sorter.depths, pixels, axis, out);
    const depths = [...out.subarray(0, total)].map((entry) => {
      const [from, at] = entry >= OF_SET ? [behind, 3 * (entry - OF_SET)] : [own, 3 * (entry - 100)];
      return axis[0] * from[at] + axis[1] * from[at + 1] + axis[2] * from[at + 2] + axis[3];
    });
    assert.equal(new Set(out.subarray(0, total)).size, total);
    assert.ok(total >= 20 && depths.every((depth, i) => i === 0 || depth <= depths[i - 1] + 1e-4));
  }
});

void test("small things", () => {
  assert.equal(tileSide(1), 16);
  assert.equal(tileSide(257), 32);
  assert.equal(tileSide(4194304), 2048);
  const groups = [{ firstFrame: 0 }, { firstFrame: 5 }, { firstFrame: 9 }];
  assert.deepEqual([0, 4, 5, 8, 9, 100].map((frame) => groupOfFrame(groups, frame)), [0, 0, 1, 1, 2, 2]);
  const view = { azimuth: -32.5, elevation: 10, distance: 2.25, target: [0, 1, -0.5] as const };
  const link = new URL(linkTo("http://x.org/a/?compare=cam05&src=s", 3.24, view));
  assert.deepEqual(parseView(link.searchParams.get("view")), view);
  assert.equal(link.searchParams.get("t"), "3.24");
  assert.equal(link.searchParams.get("src"), "s");
  assert.equal(link.searchParams.get("compare"), null);
  assert.equal(parseView("1,2,0,0,0,0"), null);
  assert.equal(parseView(null), null);
});

void test("B-frames come after the pictures that they are predicted from", () => {
  // I0 P4 B2 B1 B3 P5, as time stamps in the order of decoding.
  const places = inDisplayOrder([0, 4, 2, 1, 3, 5].map((picture) => 0.5 + picture / 30));
  assert.deepEqual(places, [0, 4, 2, 1, 3, 5]);
  const needed = samplesNeeded(places.map((picture) => ({ picture })));
  assert.deepEqual(needed, [1, 4, 4, 5, 5, 6]);
  assert.throws(() => inDisplayOrder([1, 1]), /same time/);
});
