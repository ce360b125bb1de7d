/** Fetches complete files over HTTP, and retries after network failures. */

import { inTime, messageOf, StreamError } from "../stream/errors.ts";
import { HASHED } from "../stream/manifest.ts";
import type { EarlyPart, EarlyPorts } from "./messages.ts";
import type { Arrived, Source } from "./source.ts";

const ATTEMPTS = 10;
const FIRST_WAIT = 400;
const LONGEST_WAIT = 4000;
const FIRST_BYTES = 1 << 20; // memory for a file of unknown size at first
const INTERRUPTED = "The connection was interrupted.";
const STALL = 15_000; // milliseconds without data after which a request is aborted

type Take = (chunk: Uint8Array<ArrayBuffer>) => void;

export class HttpSource implements Source {
  private readonly ports: Map<string, MessagePort>;
  private readonly earlyTimes = new Map<string, number>();
  /** Files that are missing since the server or the connection fails, which is said once: until one of them arrives. */
  private readonly failing = new Set<string>();

  /** `received`: called to estimate the bandwidth. `early`: what the page has begun to fetch. */
  constructor(
    private readonly base: string,
    private readonly received: (bytes: number, milliseconds: number) => void,
    private readonly trouble: (message: string) => void,
    early: EarlyPorts,
  ) {
    this.ports = new Map(Object.entries(early));
  }

  async read(path: string, limit: number, signal: AbortSignal, arrived?: Arrived): Promise<Uint8Array<ArrayBuffer>> {
    const listed = HASHED.test(path); // in the manifest, with its size; the manifest itself may be read often, from a cache
    let out = new Uint8Array(Math.min(limit, FIRST_BYTES));
    let filled = 0;
    let tag: string | null = null;
    const add = (chunk: Uint8Array<ArrayBuffer>): void => {
      const end = filled + chunk.length;
      if (end > limit) throw new StreamError(`${path} is larger than ${limit} bytes.`);
      if (end > out.length) {
        const larger = new Uint8Array(Math.min(limit, 2 * end));
        larger.set(out);
        out = larger;
      }
      out.set(chunk, filled);
      filled = end;
      arrived?.(out, filled);
    };
    const early = await this.takeEarly(path, (chunk) => {
      // Of another size, it is an older file in a cache.
      if (filled + chunk.length <= limit) add(chunk);
      else filled = Infinity;
    });
    if (early !== null && (listed ? filled === limit : filled <= limit)) {
      this.earlyTimes.set(path, early);
      if (listed) this.received(filled, early);
      return out.subarray(0, filled);
    }
    filled = 0;
    return this.tryAgain(path, signal, async () => {
      // Continues where an earlier attempt ended, if the file is still the same.
      const headers = filled > 0 && tag !== null ? { Range: `bytes=${filled}-`, "If-Range": tag } : {};
      await this.request(path, headers, signal, async (response) => {
        if (response.status === 416) {
          // The connection broke after the last byte, or the file has changed: from the beginning.
          tag = null;
          throw new StreamError(INTERRUPTED, true);
        }
        if (response.status !== 206) filled = 0;
        const found = response.headers.get("ETag");
        tag = found?.startsWith("W/") === true ? null : found;
        await this.receive(response, add, listed);
      });
      // A broken connection raises an error in the reader; a body that ends normally is complete.
      return out.subarray(0, filled);
    });
  }

  async peek(path: string, signal: AbortSignal): Promise<Uint8Array<ArrayBuffer>> {
    return new Uint8Array(await (await fetch(new URL(path, this.base), { signal, cache: "no-cache" })).arrayBuffer());
  }

  early(path: string): number {
    return this.earlyTimes.get(path) ?? 0;
  }

  /** Hands over a file that the page has begun to fetch, once, chunk by chunk as it comes. Returns the milliseconds that it
   * took; null if the page does not fetch it, or could not fetch all of it. */
  private async takeEarly(path: string, take: Take): Promise<number | null> {
    const port = this.ports.get(path);
    this.ports.delete(path);
    if (port === undefined) return null;
    return new Promise((resolve) => {
      port.onmessage = ({ data: part }: MessageEvent<EarlyPart>) => {
        if (part instanceof ArrayBuffer) take(new Uint8Array(part));
        else {
          port.close();
          resolve(part);
        }
      };
    });
  }

  /** A part of a file: its bytes and the size of the whole file. */
  async readRange(
    path: string,
    start: number,
    count: number,
    signal: AbortSignal,
  ): Promise<{ data: Uint8Array<ArrayBuffer>; size: number }> {
    return this.tryAgain(path, signal, async () => {
      const out = new Uint8Array(count);
      let filled = 0;
      let size = 0;
      await this.request(path, { Range: `bytes=${start}-${start + count - 1}` }, signal, async (response) => {
        const range = /^bytes (\d+)-\d+\/(\d+)$/.exec(response.headers.get("Content-Range") ?? "");
        if (response.status !== 206 || range === null || Number(range[1]) !== start)
          throw new StreamError(
            `${path} cannot be read: the server does not answer range requests, which a stream in one file needs, or does not ` +
              "expose Content-Range to other websites (CORS).",
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

  private async tryAgain<T>(path: string, signal: AbortSignal, attempt: () => Promise<T>): Promise<T> {
    for (let n = 1; ; n++) {
      try {
        const done = await attempt();
        if (this.failing.has(path)) this.failing.clear();
        return done;
      } catch (error) {
        if (signal.aborted) throw error;
        const transient = error instanceof StreamError ? error.transient : true;
        if (!transient || n === ATTEMPTS)
          throw error instanceof StreamError ? error : new StreamError(messageOf(error), true);
        if (this.failing.size === 0) this.trouble(`${messageOf(error).replace(/\.$/, "")}; trying again.`);
        this.failing.add(path);
        await new Promise((resolve) => setTimeout(resolve, Math.min(FIRST_WAIT * 2 ** (n - 1), LONGEST_WAIT)));
      }
    }
  }

  /** Takes in a body chunk by chunk, and reports how fast it came if that is `measured`; fails if no data arrives for too
   * long. */
  private async receive(response: Response, take: Take, measured = true): Promise<void> {
    const reader = response.body?.getReader();
    const began = performance.now();
    let bytes = 0;
    try {
      while (reader !== undefined) {
        const { done, value } = await inTime(reader.read(), STALL, () => new StreamError("The connection timed out.", true));
        if (done) break;
        take(value);
        bytes += value.length;
      }
    } catch (error) {
      reader?.cancel().catch(() => undefined);
      throw error instanceof StreamError ? error : new StreamError(INTERRUPTED, true);
    }
    if (measured) this.received(bytes, performance.now() - began);
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
        const held = !stop.signal.aborted && (await withholds(url, stop.signal));
        const { host, origin } = new URL(url);
        if (forbidden.has(origin))
          throw new StreamError(`This page may not fetch the stream: its Content-Security-Policy must have connect-src ${origin}.`);
        if (held)
          throw new StreamError(
            `The server ${host} does not let other websites read the stream: it must send the header ` +
              "Access-Control-Allow-Origin (CORS).",
          );
        // The browser's own words, such as "Failed to fetch", help nobody.
        throw new StreamError(stop.signal.aborted ? "The server does not respond." : "The server cannot be reached.", true);
      } finally {
        clearTimeout(waiting);
      }
      if (!response.ok && response.status !== 416) {
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

/** Origins from which the page's Content-Security-Policy lets nothing be fetched. */
const forbidden = new Set<string>();
if ("addEventListener" in globalThis)
  addEventListener("securitypolicyviolation", ({ blockedURI }) => {
    if (URL.canParse(blockedURI)) forbidden.add(new URL(blockedURI).origin);
  });

/** Whether a server of another website answers, but without the headers that would let this page read the answer. */
async function withholds(url: string, signal: AbortSignal): Promise<boolean> {
  await new Promise((resolve) => setTimeout(resolve)); // in which a violation is reported
  if (new URL(url).origin === globalThis.origin || forbidden.has(new URL(url).origin)) return false;
  try {
    await fetch(url, { mode: "no-cors", signal, cache: "no-store" });
    return true;
  } catch {
    return false;
  }
}
