/** Servers, connections and files that fail. */

import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { type Mark, readMark } from "../src/review/api.ts";
import type { Rendition } from "../src/stream/manifest.ts";
import { ArchiveSource, rangesOf } from "../src/worker/archive.ts";
import { HttpSource } from "../src/worker/http.ts";
import { GroupStore } from "../src/worker/store.ts";
import type { StreamFiles } from "../src/worker/stream_files.ts";

const { signal } = new AbortController();
const NAME = `files/${"a".repeat(32)}.bin`;
const BASE = "https://elsewhere.org/stream/manifest.json";

/** A source whose server answers by `respond`, the notices that it gives, and the requests that it sends. */
function opened(respond: (init: RequestInit) => Response | Error): { source: HttpSource; notices: string[]; sent: RequestInit[] } {
  const notices: string[] = [];
  const sent: RequestInit[] = [];
  globalThis.fetch = (_url, init = {}): Promise<Response> => {
    sent.push(init);
    const answer = respond(init);
    return answer instanceof Error ? Promise.reject(answer) : Promise.resolve(answer);
  };
  return { source: new HttpSource(BASE, () => undefined, (message) => notices.push(message), {}), notices, sent };
}

/** Runs work to its end without waiting for its timers. */
async function atOnce<T>(work: () => Promise<T>): Promise<T> {
  mock.timers.enable({ apis: ["setTimeout"] });
  try {
    const settled = work();
    const ending = settled.then(() => true, () => true);
    while (!(await Promise.race([ending, new Promise<false>((resolve) => setImmediate(resolve, false))]))) mock.timers.tick(1000);
    return await settled;
  } finally {
    mock.timers.reset();
  }
}

const bytes = (...values: number[]): Uint8Array<ArrayBuffer> => new Uint8Array(values);

/** Bytes that arrive before the connection breaks. */
function broken(...values: number[]): ReadableStream<Uint8Array> {
  const parts = [bytes(...values)];
  return new ReadableStream({
    pull(controller): void {
      const part = parts.shift();
      if (part === undefined) controller.error(new Error("reset"));
      else controller.enqueue(part);
    },
  });
}

void test("a connection that breaks after the last byte loses nothing", async () => {
  for (const [name, limit] of [[NAME, 3], ["manifest.json", 100]] as const) {
    const answers = [
      new Response(broken(1, 2, 3), { headers: { ETag: '"x"' } }),
      new Response(null, { status: 416 }),
      new Response(bytes(1, 2, 3)),
    ];
    const { source } = opened(() => answers.shift()!);
    assert.deepEqual(await atOnce(() => source.read(name, limit, signal)), bytes(1, 2, 3));
  }
});

void test("a server without CORS headers is named at once", async () => {
  const { source, notices, sent } = opened(({ mode }) => (mode === "no-cors" ? new Response() : new TypeError("Failed to fetch")));
  await assert.rejects(source.read(NAME, 3, signal), /elsewhere\.org.*CORS/);
  assert.equal(sent.length, 2);
  assert.deepEqual(notices, []);
});

void test("an outage has one notice, whatever it is that fails", async () => {
  for (const failure of [(): Response => new Response(null, { status: 500 }), (): Error => new TypeError("Failed to fetch")]) {
    let failing = true;
    const { source, notices } = opened(() => (failing ? failure() : new Response(bytes(1))));
    const names = Array.from("bcdef", (letter) => `files/${letter.repeat(32)}.bin`);
    await atOnce(() => Promise.allSettled(names.slice(1).map((name) => source.read(name, 1, signal))));
    await assert.rejects(atOnce(() => source.read(names[0], 1, signal)));
    assert.equal(notices.length, 1, notices.join());
    failing = false;
    for (const name of names) await source.read(name, 1, signal);
    failing = true;
    await assert.rejects(atOnce(() => source.read(names[0], 1, signal)));
    assert.equal(notices.length, 2);
  }
});

void test("a file that is written again while it is read is refused, and not asked for again", async () => {
  const gone = new DOMException("could not be read", "NotReadableError");
  const blob = { size: 100, slice: () => ({ arrayBuffer: () => Promise.reject(gone) }) } as unknown as Blob;
  await assert.rejects(new ArchiveSource(rangesOf(blob), "a.v3s").read("manifest.json", 100, signal), /changed or removed/);

  const stop = new AbortController();
  let reads = 0;
  const group = { id: "a", bytes: 1, sh_degree: 0, splats: 1, tile: 16, columns: 1, rows: 1, side: {}, video: {} };
  const source = {
    read: (): Promise<never> => {
      if (++reads > 20) stop.abort();
      return Promise.reject(gone);
    },
  };
  const stream = {
    source,
    manifest: { fps: 25, live: false, renditions: [{ id: "a", bandwidth: 8e6 }], spans: [{ firstFrame: 0, frameCount: 5 }] },
    replaced: false,
    renditions: () => source.read().then(() => [group as unknown as Rendition]),
  };
  const store = new GroupStore(stream as unknown as StreamFiles, null, 0, 8192, () => undefined, () => undefined, stop.signal);
  store.beginAhead();
  await new Promise(setImmediate);
  assert.equal(reads, 1);
  await assert.rejects(store.get(0), /could not be read/);
});

void test("a mark's view is one that can be shown", () => {
  const view = { eye: [0, 0, 1], target: [0, 0, 0], fov: 40, camera: "", wipe: null, whole: false, place: null };
  const mark = { frame: 1, note: "", author: "", view };
  assert.deepEqual(readMark(mark as unknown as Mark), mark);
  for (const wrong of [{ eye: [1e308, 0, 0] }, { eye: view.target }, { target: ["0", 0, 0] }, { fov: 0 }, { place: [0, NaN, 0] }, { eye: undefined }])
    assert.equal(readMark({ ...mark, view: { ...view, ...wrong } } as unknown as Mark).view, null, JSON.stringify(wrong));
  assert.equal(readMark({ ...mark, view: null }).view, null);
});
