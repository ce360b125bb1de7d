/** Fetches complete files of a known size over HTTP, and retries after network failures. */

import { inTime, messageOf, StreamError } from "../stream/errors.ts";
import { HASHED } from "../stream/manifest.ts";
import type { EarlyFiles } from "./early_files.ts";
import type { Arrived, Source } from "./source.ts";

const ATTEMPTS = 10;
const FIRST_WAIT = 400;
const LONGEST_WAIT = 4000;
const STALL = 15_000; // milliseconds without data after which a request is aborted

export class HttpSource implements Source {
  private readonly earlyTimes = new Map<string, number>();

  /** `received`: called to estimate the bandwidth. `earlyFiles`: what the page has begun to fetch. */
  constructor(
    private readonly base: string,
    private readonly received: (bytes: number, milliseconds: number) => void,
    private readonly trouble: (message: string) => void,
    private readonly earlyFiles: EarlyFiles | null = null,
  ) {}

  async read(path: string, bytes: number, signal: AbortSignal, arrived?: Arrived): Promise<Uint8Array<ArrayBuffer>> {
    const out = new Uint8Array(bytes);
    let filled = 0;
    let tag: string | null = null;
    const add = (chunk: Uint8Array<ArrayBuffer>): void => {
      if (filled + chunk.length > bytes)
        throw new StreamError(`${path} is larger than the manifest specifies (${bytes} bytes).`);
      out.set(chunk, filled);
      filled += chunk.length;
      arrived?.(out, filled);
    };
    const early = await this.earlyFiles?.take(path, (chunk) => {
      // Of another size, it is an older file in a cache.
      if (filled + chunk.length <= bytes) add(chunk);
      else filled = Infinity;
    });
    if (early !== undefined && early !== null && filled === bytes) {
      this.earlyTimes.set(path, early);
      this.received(bytes, early);
      return out;
    }
    filled = 0;
    return this.tryAgain(signal, async () => {
      // Continues where an earlier attempt ended, if the file is still the same.
      const headers = filled > 0 && tag !== null ? { Range: `bytes=${filled}-`, "If-Range": tag } : {};
      await this.request(path, headers, signal, async (response) => {
        if (response.status !== 206) filled = 0;
        const found = response.headers.get("ETag");
        tag = found?.startsWith("W/") === true ? null : found;
        await this.receive(response, add);
      });
      // A broken connection raises an error in the reader; a body that ends normally is complete.
      if (filled !== bytes) throw new StreamError(`${path} has ${filled} bytes, but the manifest specifies ${bytes}.`);
      return out;
    });
  }

  early(path: string): number {
    return this.earlyTimes.get(path) ?? 0;
  }

  async readAll(path: string, limit: number, signal: AbortSignal): Promise<Uint8Array<ArrayBuffer>> {
    return this.tryAgain(signal, async () => {
      const parts: Uint8Array<ArrayBuffer>[] = [];
      let size = 0;
      await this.request(path, {}, signal, (response) =>
        consume(response, (chunk) => {
          parts.push(chunk);
          size += chunk.length;
          if (size > limit) throw new StreamError(`${path} is larger than ${limit} bytes.`);
        }),
      );
      return new Uint8Array(await new Blob(parts).arrayBuffer());
    });
  }

  /** A part of a file: its bytes and the size of the whole file. */
  async readRange(
    path: string,
    start: number,
    count: number,
    signal: AbortSignal,
  ): Promise<{ data: Uint8Array<ArrayBuffer>; size: number }> {
    return this.tryAgain(signal, async () => {
      const out = new Uint8Array(count);
      let filled = 0;
      let size = 0;
      await this.request(path, { Range: `bytes=${start}-${start + count - 1}` }, signal, async (response) => {
        const range = /^bytes (\d+)-\d+\/(\d+)$/.exec(response.headers.get("Content-Range") ?? "");
        if (response.status !== 206 || range === null || Number(range[1]) !== start)
          throw new StreamError(
            `${path} cannot be read: the server does not answer range requests, which a stream in one file needs.`,
          );
        size = Number(range[2]);
        await this.receive(response, (chunk) => {
          if (filled + chunk.length > count) throw new StreamError(`${path}: the server sent more than was requested.`);
          out.set(chunk, filled);
          filled += chunk.length;
        });
      });
      if (filled !== Math.min(count, size - start)) throw new StreamError("The connection ended early.", true);
      return { data: out.subarray(0, filled), size };
    });
  }

  private async tryAgain<T>(signal: AbortSignal, attempt: () => Promise<T>): Promise<T> {
    for (let n = 1; ; n++) {
      try {
        return await attempt();
      } catch (error) {
        if (signal.aborted) throw error;
        const transient = error instanceof StreamError ? error.transient : true;
        if (!transient || n === ATTEMPTS)
          throw error instanceof StreamError ? error : new StreamError(messageOf(error), true);
        this.trouble("The connection was interrupted; trying again.");
        await new Promise((resolve) => setTimeout(resolve, Math.min(FIRST_WAIT * 2 ** (n - 1), LONGEST_WAIT)));
      }
    }
  }

  /** Takes in a body, and reports how fast it came. */
  private async receive(response: Response, take: (chunk: Uint8Array<ArrayBuffer>) => void): Promise<void> {
    const began = performance.now();
    let bytes = 0;
    await consume(response, (chunk) => {
      take(chunk);
      bytes += chunk.length;
    });
    this.received(bytes, performance.now() - began);
  }

  private async request(
    path: string,
    headers: Record<string, string>,
    signal: AbortSignal,
    use: (response: Response) => Promise<void>,
  ): Promise<void> {
    const stop = new AbortController();
    const abort = (): void => stop.abort();
    signal.addEventListener("abort", abort);
    try {
      const url = new URL(path, this.base).href;
      const waiting = setTimeout(abort, STALL);
      let response: Response;
      try {
        // If the browser's cache contained the first part, it would request other ranges.
        const cache = "Range" in headers ? "no-store" : HASHED.test(path) ? "default" : "no-cache";
        response = await fetch(url, { headers, signal: stop.signal, cache });
      } catch {
        // The browser's own words, such as "Failed to fetch", help nobody.
        const why = stop.signal.aborted ? "The server does not respond" : "The server cannot be reached";
        throw new StreamError(`${why}; check the connection.`, true);
      } finally {
        clearTimeout(waiting);
      }
      if (!response.ok) {
        const again = response.status >= 500 || response.status === 429 || response.status === 408;
        throw new StreamError(`${path} cannot be fetched: the server returned status ${response.status}.`, again);
      }
      await use(response);
    } finally {
      signal.removeEventListener("abort", abort);
      stop.abort();
    }
  }
}

/** Yields a body chunk by chunk; fails if no data arrives for too long. */
async function consume(response: Response, take: (chunk: Uint8Array<ArrayBuffer>) => void): Promise<void> {
  const reader = response.body?.getReader();
  if (reader === undefined) return;
  try {
    for (;;) {
      const { done, value } = await inTime(reader.read(), STALL, () => new StreamError("The connection timed out.", true));
      if (done) return;
      take(value);
    }
  } catch (error) {
    reader.cancel().catch(() => undefined);
    throw error instanceof StreamError ? error : new StreamError("The connection was interrupted.", true);
  }
}
