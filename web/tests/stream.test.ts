/** Reading a stream, held against arrays that Python wrote (tests/web/write_fixtures.py). */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import zlib from "node:zlib";
import { RateRule } from "../src/player/rate_rule.ts";
import { crc32 } from "../src/stream/crc32.ts";
import {
  type Group,
  groupOfFrame,
  type Manifest,
  type MotionGroup,
  parseManifest,
  parsePage,
  type PlanesGroup,
  squareSide,
} from "../src/stream/manifest.ts";
import { tilePixels } from "../src/stream/morton.ts";
import { MotionTables } from "../src/stream/motion.ts";
import { planePositions, planesLayout } from "../src/stream/planes.ts";
import { inflate, parseSideFile, type SideFile } from "../src/stream/side_file.ts";
import { DepthSorter } from "../src/stream/sort.ts";
import { warmUp } from "../src/stream/warm_up.ts";
import { demuxSample } from "../src/worker/sample_video.ts";
import { linkTo, parseTime, parseView } from "../src/ui/link.ts";
import { inDisplayOrder, packetsNeeded } from "../src/worker/order.ts";

const folder = process.env["V3_FIXTURES"] ?? join(import.meta.dirname, "build", "fixtures");
const bytes = (name: string): Uint8Array<ArrayBuffer> => new Uint8Array(readFileSync(join(folder, name)));
const json = (name: string): unknown => JSON.parse(readFileSync(join(folder, name), "utf8"));

function group(name: string): Group {
  const data = bytes(`${name}.json`);
  return parseManifest(new TextDecoder().decode(data), data.length).groups[0][0];
}

async function side(): Promise<[MotionGroup, SideFile]> {
  const motion = group("motion") as MotionGroup;
  return [motion, parseSideFile(await inflate(bytes("motion.bin"), motion.side.rawBytes), motion)];
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
  for (let frame = 0; frame < motion.frameCount; frame++)
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
  const size = luma.length / motion.frameCount;
  const out = new Float32Array(3 * motion.splats);
  for (let frame = 0; frame < motion.frameCount; frame++) {
    tables.positions(frame, luma.subarray(frame * size, (frame + 1) * size), tables.blocks(frame), out);
    assert.deepEqual(out, want.subarray(frame * out.length, (frame + 1) * out.length), `frame ${frame}`);
  }
});

void test("positions of planes are Python's", () => {
  const planes = group("planes") as PlanesGroup;
  const { tile, columns, rows } = planesLayout(planes);
  const luma = bytes("planes.luma");
  const want = new Float32Array(bytes("planes.positions").buffer);
  const count = planes.files.length;
  const out = new Float32Array(3 * planes.splats);
  for (let frame = 0; frame < planes.frameCount; frame++) {
    const picture = new Uint8Array(tile * tile * columns * rows);
    for (let plane = 0; plane < count; plane++)
      for (let row = 0; row < tile; row++) {
        const from = ((frame * count + plane) * tile + row) * tile;
        const to = (Math.floor(plane / columns) * tile + row) * tile * columns + (plane % columns) * tile;
        picture.set(luma.subarray(from, from + tile), to);
      }
    planePositions(planes, picture, out);
    for (let i = 0; i < out.length; i++) assert.ok(Math.abs(out[i] - want[frame * out.length + i]) < 1e-6);
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
  const motion = group("motion") as MotionGroup;
  const raw = await inflate(bytes("motion.bin"), motion.side.rawBytes);
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
  await assert.rejects(inflate(bytes("motion.bin"), motion.side.rawBytes - 1), /more than/);
  await assert.rejects(inflate(bytes("motion.bin"), motion.side.rawBytes + 1), /not/);
  await assert.rejects(inflate(bytes("motion.bin").slice(9), motion.side.rawBytes), /./);
});

void test("a side file that decompresses to far more than it says is not decompressed", async () => {
  const bomb = new Uint8Array(zlib.deflateRawSync(new Uint8Array(8 << 20)));
  await assert.rejects(inflate(bomb, 1000), /more than 1000/);
});

void test("warming up reads what it has made up, for as long as it is wanted", async () => {
  let rounds = 0;
  let others = 0;
  await warmUp(() => ++rounds <= 6, () => {
    others++;
    return Promise.resolve();
  });
  // Asked before each of the two parts of a round.
  assert.equal(rounds, 7);
  assert.equal(others, 3);
});

void test("the demuxer is warmed up with a video that it reads", async () => {
  await demuxSample();
});

void test("tables are right whichever groups came before", async () => {
  const [motion, read] = await side();
  const { tile, columns } = motion;
  const bigger = { ...motion, tile: tile + 5 };
  const wider = { ...motion, columns: columns + 1 };
  const luma = bytes("motion.luma").subarray(0, tile * columns * tile * motion.rows);
  const positions = (tables: MotionTables): Float32Array => {
    const out = new Float32Array(3 * motion.splats);
    tables.positions(0, luma, tables.blocks(0), out);
    return out;
  };
  const before = positions(new MotionTables(motion, read));
  for (const other of [bigger, wider]) {
    const tables = new MotionTables(other, read);
    assert.deepEqual(tables.pixels, tilePixels(other.tile, motion.splats));
    const rest = read.cells.subarray(0, 3 * 100);
    const fewer = { ...read, cells: rest, labels: read.labels.subarray(0, 100), classes: read.classes.subarray(0, 100) };
    assert.deepEqual(new MotionTables({ ...other, splats: 100 }, fewer).pixels, tilePixels(other.tile, 100));
  }
  assert.deepEqual(positions(new MotionTables(motion, read)), before);
});

void test("all that is drawn is finite, whatever numbers the manifest has", async () => {
  const text = new TextDecoder().decode(bytes("motion.json"));
  const inflated = await inflate(bytes("motion.bin"), (group("motion") as MotionGroup).side.rawBytes);
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
      const values = JSON.parse(text) as { groups: Parameters<(typeof places)[0]>[0][] };
      const [at, key] = place(values.groups[0]);
      at[key] = value;
      try {
        const motion = parseManifest(JSON.stringify(values), bytes("motion.json").length).groups[0][0] as MotionGroup;
        const tables = new MotionTables(motion, parseSideFile(inflated, motion));
        const positions = new Float32Array(3 * motion.splats);
        for (let index = 0; index < motion.frameCount; index++) {
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

void test("manifests out of bounds are refused with the place", () => {
  const text = new TextDecoder().decode(bytes("motion.json"));
  const refused = (change: (values: Record<string, never>) => void, message: RegExp): void => {
    const values = JSON.parse(text) as Record<string, never>;
    change(values);
    const changed = JSON.stringify(values);
    assert.throws(() => parseManifest(changed, changed.length), message);
  };
  type Edit = {
    version: number;
    groups: {
      splats: number;
      side: { path: string };
      channels: { offset: number; step: number }[];
      blocks: { radius: number };
      bytes: number;
      dilation?: unknown;
    }[];
  };
  const edit = (change: (values: Edit) => void) => (values: unknown) => {
    change(values as Edit);
  };
  refused(edit((v) => (v.version = 4)), /version 4.*update/);
  refused(edit((v) => (v.version = 1)), /profile/);
  refused(edit((v) => (v.groups[0].splats = 1e9)), /groups\.0\.splats/);
  refused(edit((v) => (v.groups[0].side.path = "/etc/passwd")), /groups\.0\.side\.path/);
  refused(edit((v) => (v.groups[1].side.path = v.groups[0].side.path)), /path twice/);
  refused(edit((v) => (v.groups[0].channels[2].step = 0)), /channels\.2\.step/);
  for (const dilation of [0, 1.5, -0.1, null, "0.1"]) refused(edit((v) => (v.groups[1].dilation = dilation)), /groups\.1\.dilation/);
  refused(edit((v) => (v.groups[0].blocks.radius = 1e-300)), /groups\.0\.blocks\.radius/);
  refused(edit((v) => (v.groups[0].channels[6].offset = 90)), /groups\.0.*log_scale_0 beyond/);
  refused(edit((v) => (v.groups[0].channels[10].step = 1e9)), /groups\.0.*sh_0_y beyond/);
  refused(edit((v) => (v.groups[0].bytes += 1)), /sum of its file sizes/);
  assert.throws(() => parseManifest("[", 1), /not readable JSON/);
  assert.throws(() => parseManifest("{}", 2), /not the manifest/);
});

const ladder = (): [string, Manifest] => {
  const text = new TextDecoder().decode(bytes("ladder.json"));
  return [text, parseManifest(text, bytes("ladder.json").length)];
};

void test("a manifest of version 3 has groups in renditions and in pages", () => {
  const [, manifest] = ladder();
  assert.deepEqual(manifest.renditions.map(({ id }) => id), ["qp20", "qp34"]);
  assert.deepEqual(manifest.spans, [{ firstFrame: 0, frameCount: 3 }, { firstFrame: 3, frameCount: 2 }]);
  assert.equal(manifest.groups.length, 1);
  const page = manifest.pages[0];
  const text = new TextDecoder().decode(bytes("page.json"));
  const [[best, coarse]] = parsePage(text, page, manifest);
  assert.deepEqual([best.rendition, best.index, best.firstFrame, best.frameCount], ["qp20", 1, 3, 2]);
  assert.ok(best.bytes > coarse.bytes);
  assert.throws(() => parsePage(text.replace('"frame_count":2', '"frame_count":3'), page, manifest), /frame_count/);
  assert.throws(() => parsePage(text.replaceAll('"qp34"', '"qp35"'), page, manifest), /id/);
  assert.throws(() => parsePage("[]", page, manifest), /StreamError|not an object|object/);
  assert.throws(() => parsePage('{"format":"v3studio-stream-page","groups":[]}', page, manifest), /groups/);
});

void test("a group without a dilation has that of 3DGS", () => {
  const text = new TextDecoder().decode(bytes("planes.json"));
  const read = (dilation?: number): number => {
    const values = JSON.parse(text) as { groups: { dilation?: number }[]; total_bytes: number };
    if (dilation !== undefined) values.groups[0].dilation = dilation;
    values.total_bytes += JSON.stringify(values).length - text.length;
    return parseManifest(JSON.stringify(values), JSON.stringify(values).length).groups[0][0].dilation;
  };
  assert.deepEqual([read(), read(0.001), read(0.05), read(1)], [0.3, 0.001, 0.05, 1]);
});

void test("manifests of version 3 out of bounds are refused", () => {
  const [text] = ladder();
  type One = { id: string; frame_count: number; splats: number; video: { path: string; checks: { picture: number }[] } };
  type Edit = { renditions: One[]; groups: { renditions: One[] }[]; pages: { frames: number[] }[]; audio: Record<string, unknown> };
  const refused = (change: (values: Edit) => void, message: RegExp): void => {
    const values = JSON.parse(text) as Edit;
    change(values);
    const changed = JSON.stringify(values);
    assert.throws(() => parseManifest(changed, changed.length), message);
  };
  const first = (v: Edit): One => v.groups[0].renditions[0];
  refused((v) => (first(v).frame_count = 2), /frame_count/);
  refused((v) => v.groups[0].renditions.pop(), /renditions/);
  refused((v) => v.groups[0].renditions.reverse(), /id/);
  refused((v) => (v.renditions[1].id = v.renditions[0].id), /twice/);
  refused((v) => (v.renditions[0].splats = 1), /splats/);
  refused((v) => (first(v).video.path = `files/${"0".repeat(32)}.mp4`), /not named by/);
  refused((v) => (first(v).video.checks = []), /checks/);
  refused((v) => (first(v).video.checks[0].picture = 1), /picture/);
  refused((v) => (first(v).video.checks[1].picture = 0), /picture/);
  refused((v) => (v.pages[0].frames = [3]), /frame_count/);
  refused((v) => (v.pages[0].frames = [-1]), /frames/);
  refused((v) => (v.audio["samples"] = 48_000), /audio ends after the frames/);
  refused((v) => (v.audio["start"] = -1), /audio\.start/);
  refused((v) => (v.audio["start"] = 0.2), /audio ends after the frames/);
  refused((v) => (v.audio["codec"] = "opus"), /audio\.codec/);
  refused((v) => (v.audio["channels"] = 8), /audio\.channels/);
  refused((v) => (v.audio["bytes"] = 2 ** 29), /audio\.bytes/);
  refused((v) => (v.audio["path"] = `files/${"0".repeat(32)}.m4a`), /not named by/);
});

void test("CRC-32 is that of zlib, and of the luma that Python decodes", () => {
  assert.equal(crc32(new TextEncoder().encode("123456789")), 0xcbf43926);
  for (let length = 0; length < 70; length++) {
    const data = Uint8Array.from({ length }, (_, i) => (i * i * 37 + length) & 255);
    assert.equal(crc32(data), zlib.crc32(data));
  }
  const [, manifest] = ladder();
  const [group] = manifest.groups[0];
  assert.ok(group.profile === "motion");
  const luma = bytes("ladder.luma");
  const size = luma.length / group.frameCount;
  for (const { picture, crc32: wanted } of group.video.checks)
    assert.equal(crc32(luma.subarray(picture * size, (picture + 1) * size)), wanted);
});

void test("renditions are chosen as Python's rule chooses them", () => {
  const { rates, steps } = json("rule.json") as { rates: number[]; steps: [number, number, number, number][] };
  const rule = new RateRule(rates);
  for (const [buffered, bytes, seconds, wanted] of steps) {
    assert.equal(rule.choose(buffered), wanted);
    rule.fetched(bytes, seconds);
  }
});

void test("small things", () => {
  assert.equal(squareSide(1, 16), 16);
  assert.equal(squareSide(257, 16), 32);
  assert.equal(squareSide(4194304, 16), 2048);
  const groups = [{ firstFrame: 0 }, { firstFrame: 5 }, { firstFrame: 9 }];
  assert.deepEqual([0, 4, 5, 8, 9, 100].map((frame) => groupOfFrame(groups, frame)), [0, 0, 1, 1, 2, 2]);
  const view = { azimuth: -32.5, elevation: 10, distance: 2.25, target: [0, 1, -0.5] as const };
  const link = new URL(linkTo("http://x.org/a/?benchmark&src=s", 3.24, view));
  assert.deepEqual(parseView(link.searchParams.get("view")), view);
  assert.equal(parseTime(link.searchParams.get("t")), 3.24);
  assert.equal(link.searchParams.get("src"), "s");
  assert.equal(parseView("1,2,0,0,0,0"), null);
  assert.equal(parseView(null), null);
  assert.equal(parseTime("-1"), null);
});

void test("B-frames come after the pictures that they are predicted from", () => {
  // I0 P4 B2 B1 B3 P5, as time stamps in the order of decoding.
  const places = inDisplayOrder([0, 4, 2, 1, 3, 5].map((picture) => ({ timestamp: 0.5 + picture / 30 })));
  assert.deepEqual(places, [0, 4, 2, 1, 3, 5]);
  const needed = packetsNeeded(places.map((picture) => ({ picture })));
  assert.deepEqual(needed, [1, 4, 4, 5, 5, 6]);
  assert.throws(() => inDisplayOrder([{ timestamp: 1 }, { timestamp: 1 }]), /same time/);
});
