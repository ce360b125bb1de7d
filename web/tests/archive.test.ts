/** Streams in one file, and what a live stream may not change. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { RateRule } from "../src/worker/rate_rule.ts";
import { ArchiveSource, rangesOf } from "../src/worker/archive.ts";
import { readChecked } from "../src/worker/source.ts";

const signal = new AbortController().signal;

/** A ZIP archive of stored entries, as PKWARE's APPNOTE describes it; `wide`: with ZIP64 records. */
function archive(files: Record<string, Uint8Array>, { method = 0, wide = false, extra = 0 } = {}): Uint8Array<ArrayBuffer> {
  const parts: Buffer[] = [];
  const directory: Buffer[] = [];
  let offset = 0;
  for (const [name, data] of Object.entries(files)) {
    const local = Buffer.alloc(30 + name.length + extra);
    local.writeUInt32LE(0x04034b50, 0);
    local.writeUInt16LE(name.length, 26);
    local.writeUInt16LE(extra, 28);
    local.write(name, 30);
    const field = Buffer.alloc(wide ? 28 : 0);
    if (wide) {
      field.writeUInt16LE(1, 0);
      field.writeUInt16LE(24, 2);
      [data.length, data.length, offset].forEach((value, i) => field.writeBigUInt64LE(BigInt(value), 4 + 8 * i));
    }
    const entry = Buffer.alloc(46 + name.length);
    entry.writeUInt32LE(0x02014b50, 0);
    entry.writeUInt16LE(method, 10);
    entry.writeUInt32LE(wide ? 0xffffffff : data.length, 20);
    entry.writeUInt32LE(wide ? 0xffffffff : data.length, 24);
    entry.writeUInt16LE(name.length, 28);
    entry.writeUInt16LE(field.length, 30);
    entry.writeUInt32LE(wide ? 0xffffffff : offset, 42);
    entry.write(name, 46);
    parts.push(local, Buffer.from(data));
    directory.push(entry, field);
    offset += local.length + data.length;
  }
  const central = Buffer.concat(directory);
  const count = Object.keys(files).length;
  const end = Buffer.alloc((wide ? 76 : 0) + 22);
  if (wide) {
    end.writeUInt32LE(0x06064b50, 0);
    [count, central.length, offset].forEach((value, i) => end.writeBigUInt64LE(BigInt(value), 32 + 8 * i));
    end.writeUInt32LE(0x07064b50, 56);
    end.writeBigUInt64LE(BigInt(offset + central.length), 64);
  }
  const last = end.length - 22;
  end.writeUInt32LE(0x06054b50, last);
  end.writeUInt16LE(wide ? 0xffff : count, last + 10);
  end.writeUInt32LE(wide ? 0xffffffff : central.length, last + 12);
  end.writeUInt32LE(wide ? 0xffffffff : offset, last + 16);
  return new Uint8Array(Buffer.concat([...parts, central, end]));
}

const FILES = {
  "manifest.json": new Uint8Array([1, 2, 3]),
  "files/a.bin": new Uint8Array(200_000).map((_, i) => i * 7),
  "files/b.mp4": new Uint8Array(0),
};

function open(data: Uint8Array<ArrayBuffer>): ArchiveSource {
  return new ArchiveSource(rangesOf(new Blob([data])), "a.v3s");
}

for (const options of [{}, { wide: true }, { extra: 400 }])
  void test(`entries are read by ranges: ${JSON.stringify(options)}`, async () => {
    const source = open(archive(FILES, options));
    for (const [name, data] of Object.entries(FILES))
      assert.deepEqual(await source.readAll(name, data.length, signal), data);
    const file = { path: "files/a.bin", bytes: 200_001, sha256: "" };
    await assert.rejects(source.readAll("files/c.bin", 1, signal), /does not contain/);
    await assert.rejects(source.readAll(file.path, 199_999, signal), /larger/);
    await assert.rejects(readChecked(source, file, signal), /200000 bytes/);
  });

void test("archives that are cut, compressed or something else are refused", async () => {
  const whole = archive(FILES);
  for (const length of [0, 1, 40, 100_000, whole.length - 30, whole.length - 1])
    await assert.rejects(open(whole.slice(0, length)).readAll("manifest.json", 100, signal), /damaged|Offset/);
  await assert.rejects(open(archive(FILES, { method: 8 })).readAll("manifest.json", 100, signal), /compressed/);
  const others = { "other.txt": FILES["manifest.json"], ...FILES };
  await assert.rejects(open(archive(others)).readAll("manifest.json", 100, signal), /not a stream/);
});

void test("a rendition that is decoded too slowly is not chosen again", () => {
  const rule = new RateRule([30e6, 10e6, 3e6]);
  rule.fetched(20e6, 1);
  assert.equal(rule.affordable(), 0);
  rule.played(0, 60, 40);
  assert.equal(rule.best(), 1);
  assert.equal(rule.affordable(), 1);
  assert.notEqual(rule.choose(10), 0);
  rule.played(2, 0, 200); // nothing is below it
  assert.equal(rule.best(), 1);
});
