/** The files that the page fetches for the player. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { type EarlyFiles, takeEarlyFiles } from "../src/player/early_files.ts";
import { Arriving } from "../src/worker/arriving.ts";
import { HttpSource } from "../src/worker/http.ts";

const PAGE = "https://example.org/secret/take/";
const MANIFEST = `${PAGE}stream/manifest.json`;

/** Answers to the page's own requests of files, by address. */
let answers = new Map<string, Promise<Response | null>>();

function page(response: Promise<Response | null>, files: Record<string, Promise<Response | null>> = {}): void {
  answers = new Map(Object.entries(files).map(([path, found]) => [`early ${path}`, found]));
  const addresses = Object.fromEntries(Object.keys(files).map((path) => [path, `early ${path}`]));
  const left: EarlyFiles = { address: "stream/manifest.json", response, files: addresses };
  Object.assign(globalThis, { window: { v3Early: left }, document: { baseURI: PAGE } });
}

const answer = (text: string): Promise<Response> => Promise.resolve(new Response(text));

/** Paths that the worker fetches itself. */
const fetched: string[] = [];
globalThis.fetch = (url): Promise<Response> => {
  const early = answers.get(url as string);
  if (early !== undefined) return early as Promise<Response>;
  fetched.push((url as string).slice(PAGE.length));
  return answer("right");
};

function opened(received: (bytes: number) => void = () => undefined): HttpSource {
  fetched.length = 0;
  return new HttpSource(MANIFEST, received, () => undefined, takeEarlyFiles(MANIFEST));
}

const { signal } = new AbortController();

async function textOf(source: HttpSource, name: string, most = 100): Promise<string> {
  return new TextDecoder().decode(await source.read(name, most, signal));
}

void test("they arrive, once, and only for their own address", async () => {
  page(answer("{}"), { "files/a.bin": answer("abc"), "files/b.mp4": answer("defg") });
  assert.deepEqual(takeEarlyFiles(`${PAGE}other/manifest.json`), {});
  const source = opened();
  assert.equal(await textOf(source, "manifest.json"), "{}");
  assert.equal(await textOf(source, "files/b.mp4"), "defg");
  assert.deepEqual(fetched, []);
  for (const name of ["files/b.mp4", "files/c.mp4"]) assert.equal(await textOf(source, name), "right");
  assert.deepEqual(takeEarlyFiles(MANIFEST), {});
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
    large: answer("too large"),
  });
  const source = opened();
  for (const name of ["manifest.json", "busy", "broken", "large"]) assert.equal(await textOf(source, name, 5), "right", name);
});

void test("a file of another size than the manifest's is fetched again, and its files' times are told", async () => {
  const [right, long, short] = ["a", "b", "c"].map((digit) => `files/${digit.repeat(32)}.bin`);
  const manifest = "x".repeat(3 << 20);
  page(answer(manifest), { [right]: answer("abc"), [long]: answer("too long"), [short]: answer("few") });
  const told: number[] = [];
  const source = opened((bytes) => told.push(bytes));
  assert.equal(await textOf(source, "manifest.json", 1 << 23), manifest);
  assert.equal(await textOf(source, right, 3), "abc");
  for (const name of [long, short]) assert.equal(await textOf(source, name, 5), "right");
  assert.deepEqual(fetched, [`stream/${long}`, `stream/${short}`]);
  assert.equal(await textOf(source, "manifest.json"), "right"); // as in live streams, again and again
  assert.deepEqual(told, [3, 5, 5]);
  assert.ok(source.early(right) > 0);
  assert.equal(source.early(long), 0);
});

void test("a file is handed over while it arrives", async () => {
  let stream: ReadableStreamDefaultController<Uint8Array> | null = null;
  const body = new ReadableStream<Uint8Array>({
    start(controller): void {
      stream = controller;
    },
  });
  page(Promise.resolve(null), { slow: Promise.resolve(new Response(body)) });
  const file = new Arriving(4);
  const reading = opened().read("slow", 4, signal, file.arrived);
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
