/** Streams in one file, and what a live stream may not change. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { RateRule } from "../src/worker/rate_rule.ts";
import { ArchiveSource, rangesOf } from "../src/worker/archive.ts";
import { readChecked } from "../src/worker/source.ts";

const signal = new AbortController().signal;

/** Written by Python's zipfile (tests/web/write_fixtures.py). */
const folder = process.env["V3_FIXTURES"] ?? join(import.meta.dirname, "build", "fixtures");
const archive = (name: string): Uint8Array<ArrayBuffer> => new Uint8Array(readFileSync(join(folder, `${name}.zip`)));

const FILES = {
  "manifest.json": new Uint8Array([1, 2, 3]),
  "files/a.bin": new Uint8Array(200_000).map((_, i) => i * 7),
  "files/b.mp4": new Uint8Array(0),
};

function open(data: Uint8Array<ArrayBuffer>): ArchiveSource {
  return new ArchiveSource(rangesOf(new Blob([data])), "a.v3s");
}

for (const kind of ["plain", "wide", "extra"])
  void test(`entries are read by ranges: ${kind}`, async () => {
    const source = open(archive(kind));
    for (const [name, data] of Object.entries(FILES))
      assert.deepEqual(await source.read(name, data.length, signal), data);
    const file = { path: "files/a.bin", bytes: 200_001, sha256: "" };
    await assert.rejects(source.read("files/c.bin", 1, signal), /does not contain/);
    await assert.rejects(source.read(file.path, 199_999, signal), /larger/);
    await assert.rejects(readChecked(source, file, signal), /200000 bytes/);
  });

void test("archives that are cut, compressed or something else are refused", async () => {
  const whole = archive("plain");
  for (const length of [0, 1, 40, 100_000, whole.length - 30, whole.length - 1])
    await assert.rejects(open(whole.slice(0, length)).read("manifest.json", 100, signal), /damaged|Offset/);
  await assert.rejects(open(archive("compressed")).read("manifest.json", 100, signal), /compressed/);
  await assert.rejects(open(archive("other")).read("manifest.json", 100, signal), /not a stream/);
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
