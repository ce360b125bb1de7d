/** The manifest that the page fetches for the player. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { type EarlyManifest, takeEarlyManifest } from "../src/player/early_manifest.ts";

const PAGE = "https://example.org/secret/take/";

function page(response: Promise<Response | null>): void {
  const early: EarlyManifest = { address: "stream/manifest.json", response };
  Object.assign(globalThis, { window: { v3Manifest: early }, document: { baseURI: PAGE } });
}

async function taken(response: Promise<Response | null>): Promise<ArrayBuffer | null> {
  page(response);
  const port = takeEarlyManifest(`${PAGE}stream/manifest.json`);
  assert.ok(port !== null);
  return new Promise((resolve) => {
    port.onmessage = ({ data }: MessageEvent<ArrayBuffer | null>) => {
      port.close();
      resolve(data);
    };
  });
}

void test("its bytes arrive, once, and only for its own address", async () => {
  page(Promise.resolve(null));
  assert.equal(takeEarlyManifest(`${PAGE}other/manifest.json`), null);
  const data = await taken(Promise.resolve(new Response("{}")));
  assert.equal(new TextDecoder().decode(data ?? new ArrayBuffer(0)), "{}");
  assert.equal(takeEarlyManifest(`${PAGE}stream/manifest.json`), null);
});

void test("whatever fails is left to the worker", async () => {
  assert.equal(await taken(Promise.resolve(null)), null);
  assert.equal(await taken(Promise.resolve(new Response("busy", { status: 503 }))), null);
  const broken = new ReadableStream({
    start(controller): void {
      controller.error(new Error("interrupted"));
    },
  });
  assert.equal(await taken(Promise.resolve(new Response(broken))), null);
});
