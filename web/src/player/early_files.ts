/** Files that are fetched before the worker runs: the manifest, which the page requests before the player's script has arrived,
 * and those with which playback begins. These wait for the script, with which they would share the line. */

import { inTime } from "../stream/errors.ts";
import type { EarlyPorts } from "../worker/messages.ts";

/** Requests that the page leaves for the player. */
export interface EarlyFiles {
  /** The manifest's address, as in the player's `src`. */
  readonly address: string;
  /** The manifest; null if the request has failed. */
  readonly response: Promise<Response | null>;
  /** Addresses of the first files by their paths in the stream. */
  readonly files: Readonly<Record<string, string>>;
}

declare global {
  interface Window {
    v3Early?: EarlyFiles;
  }
}

const PATIENCE = 15_000; // milliseconds without data after which the worker fetches a file itself

/** Takes the early files of an address, by their paths in the stream; none if they are of another one. They are used once:
 * anyone who opens the stream again wants the newest manifest. `url`: whole address of the manifest. */
export function takeEarlyFiles(url: string): EarlyPorts {
  const early = window.v3Early;
  if (early === undefined || new URL(early.address, document.baseURI).href !== url) return {};
  delete window.v3Early;
  const manifest = new URL(url).pathname.split("/").at(-1)!;
  const files = Object.entries(early.files).map(([path, file]) => [path, fetch(file).catch(() => null)] as const);
  return Object.fromEntries([[manifest, early.response] as const, ...files].map(([path, response]) => {
    const { port1, port2 } = new MessageChannel();
    void send(port1, response);
    return [path, port2];
  }));
}

async function send(port: MessagePort, response: Promise<Response | null>): Promise<void> {
  const late = (): Error => new Error("late");
  let milliseconds: number | null = null;
  try {
    const got = await inTime(response, PATIENCE, late);
    const reader = got?.ok === true ? got.body?.getReader() : undefined;
    while (reader !== undefined && milliseconds === null) {
      const { done, value } = await inTime(reader.read(), PATIENCE, late);
      if (done) milliseconds = performance.getEntriesByName(got!.url)[0]?.duration ?? performance.now();
      else {
        const { buffer } = value.slice();
        port.postMessage(buffer, [buffer]);
      }
    }
  } catch {
    // the worker tries again
  }
  port.postMessage(milliseconds);
}
