/** The files that the page fetches for the player. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { type EarlyFiles as Left, takeEarlyFiles } from "../src/player/early_files.ts";
import { EARLY_MANIFEST, EarlyFiles } from "../src/worker/early_files.ts";
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

const answer = (text: string): Promise<Response> => Promise.resolve(new Response(text));

void test("they arrive, once, and only for their own address", async () => {
  page(answer("{}"), { "files/a.bin": answer("abc"), "files/b.mp4": answer("defg") });
  assert.equal(takeEarlyFiles(`${PAGE}other/manifest.json`), null);
  const early = taken();
  const manifest = await early.take(EARLY_MANIFEST);
  assert.equal(new TextDecoder().decode(manifest?.data), "{}");
  assert.equal(new TextDecoder().decode((await early.take("files/b.mp4"))?.data), "defg");
  assert.equal(await early.take("files/b.mp4"), null);
  assert.equal(await early.take("files/c.mp4"), null);
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
  for (const name of [EARLY_MANIFEST, "busy", "broken"]) assert.equal(await early.take(name), null, name);
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
