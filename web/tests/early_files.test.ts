/** The files that the page fetches for the player. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { type EarlyFiles as Left, takeEarlyFiles } from "../src/player/early_files.ts";
import { EARLY_MANIFEST, EarlyFiles } from "../src/worker/early_files.ts";
import { Arriving } from "../src/worker/arriving.ts";
import { HttpSource } from "../src/worker/http.ts";

const PAGE = "https://example.org/secret/take/";
const MANIFEST = `${PAGE}stream/manifest.json`;

function page(response: Promise<Response | null>, files: Record<string, Promise<Response | null>> = {}): void {
  const left: Left = { address: "stream/manifest.json", response, files };
  Object.assign(globalThis, { window: { v3Early: left }, document: { baseURI: PAGE } });
}

function taken(): EarlyFiles {
  const port = takeEarlyFiles(MANIFEST);
  assert.ok(port !== null);
  return new EarlyFiles(port);
}

/** What there is of a file, and whether that is all of it. */
async function textOf(early: EarlyFiles, name: string): Promise<string | null> {
  const parts: Uint8Array<ArrayBuffer>[] = [];
  const milliseconds = await early.take(name, (part) => parts.push(part));
  return milliseconds === null ? null : new Blob(parts).text();
}

const answer = (text: string): Promise<Response> => Promise.resolve(new Response(text));

void test("they arrive, once, and only for their own address", async () => {
  page(answer("{}"), { "files/a.bin": answer("abc"), "files/b.mp4": answer("defg") });
  assert.equal(takeEarlyFiles(`${PAGE}other/manifest.json`), null);
  const early = taken();
  assert.equal(await textOf(early, EARLY_MANIFEST), "{}");
  assert.equal(await textOf(early, "files/b.mp4"), "defg");
  assert.equal(await textOf(early, "files/b.mp4"), null);
  assert.equal(await textOf(early, "files/c.mp4"), null);
  assert.equal(takeEarlyFiles(MANIFEST), null);
});

void test("whatever fails is left to the worker", async () => {
  const broken = new ReadableStream({
    start(controller): void {
      controller.error(new Error("interrupted"));
    },
  });
  page(Promise.resolve(null), {
    busy: Promise.resolve(new Response("busy", { status: 503 })),
    broken: Promise.resolve(new Response(broken)),
  });
  const early = taken();
  for (const name of [EARLY_MANIFEST, "busy", "broken"]) assert.equal(await textOf(early, name), null, name);
});

void test("a file of another size than the manifest's is fetched again, and times are told", async () => {
  page(answer("{}"), { "files/a.bin": answer("abc"), "files/b.bin": answer("too long") });
  const before = globalThis.fetch;
  const fetched: string[] = [];
  globalThis.fetch = (url): Promise<Response> => {
    fetched.push((url as string).slice(PAGE.length));
    return answer("right");
  };
  try {
    const told: number[] = [];
    const source = new HttpSource(MANIFEST, (bytes) => told.push(bytes), () => undefined, taken());
    const { signal } = new AbortController();
    assert.equal(new TextDecoder().decode(await source.read("files/a.bin", 3, signal)), "abc");
    assert.equal(new TextDecoder().decode(await source.read("files/b.bin", 5, signal)), "right");
    assert.deepEqual(fetched, ["stream/files/b.bin"]);
    assert.deepEqual(told, [3, 5]);
    assert.ok(source.early("files/a.bin") > 0);
    assert.equal(source.early("files/b.bin"), 0);
  } finally {
    globalThis.fetch = before;
  }
});

void test("a file is handed over while it arrives", async () => {
  let stream: ReadableStreamDefaultController<Uint8Array> | null = null;
  const body = new ReadableStream<Uint8Array>({
    start(controller): void {
      stream = controller;
    },
  });
  page(Promise.resolve(null), { slow: Promise.resolve(new Response(body)) });
  const source = new HttpSource(MANIFEST, () => undefined, () => undefined, taken());
  const file = new Arriving(4);
  const reading = source.read("slow", 4, new AbortController().signal, file.arrived);
  stream!.enqueue(Uint8Array.of(1, 2));
  assert.deepEqual([...(await file.prefix(2)).subarray(0, 2)], [1, 2]);
  assert.equal(file.complete, false);
  stream!.enqueue(Uint8Array.of(3, 4));
  stream!.close();
  assert.deepEqual([...(await reading)], [1, 2, 3, 4]);
  file.finish(await reading);
  assert.equal(file.complete, true);
  assert.deepEqual([...(await file.whole())], [1, 2, 3, 4]);
});

void test("the last byte counts only when the file is verified", async () => {
  const file = new Arriving(2);
  file.arrived(Uint8Array.of(1, 2), 2);
  const all = [file.prefix(2), file.whole()];
  file.fail(new Error("damaged"));
  for (const one of [...all, file.prefix(1)]) await assert.rejects(one, /damaged/);
});
