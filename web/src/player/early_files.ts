/** What a page begins to fetch before the player's script has arrived: the manifest, and the files with which playback
 * begins. */

import { inTime } from "../stream/errors.ts";
import type { EarlyPart, EarlyPort } from "../worker/messages.ts";

/** What the page leaves for the player. */
export interface EarlyFiles {
  /** Of the manifest, as in the player's `src`. */
  readonly address: string;
  /** The manifest; null if the request has failed. */
  readonly response: Promise<Response | null>;
  /** Files of the stream by their paths in it. */
  readonly files?: Readonly<Record<string, Promise<Response | null>>>;
}

declare global {
  interface Window {
    v3Early?: EarlyFiles;
  }
}

const PATIENCE = 15_000; // milliseconds without data after which the worker fetches a file itself

/** Takes the early files of an address; null if there are none. They are used once: anyone who opens the stream again wants
 * the newest manifest. `url`: whole address of the manifest. */
export function takeEarlyFiles(url: string): EarlyPort | null {
  const early = window.v3Early;
  if (early === undefined || new URL(early.address, document.baseURI).href !== url) return null;
  delete window.v3Early;
  const { port1, port2 } = new MessageChannel();
  const files = Object.entries({ "": early.response, ...early.files });
  for (const [name, response] of files) void send(port1, name, response);
  return { port: port2, names: files.map(([name]) => name) };
}

async function send(port: MessagePort, name: string, response: Promise<Response | null>): Promise<void> {
  const post = (data: ArrayBuffer | null, milliseconds: number | null = null): void => {
    const part: EarlyPart = { name, data, milliseconds };
    port.postMessage(part, data === null ? [] : [data]);
  };
  const late = (): Error => new Error("late");
  let milliseconds: number | null = null;
  try {
    const got = await inTime(response, PATIENCE, late);
    const reader = got?.ok === true ? got.body?.getReader() : undefined;
    while (reader !== undefined && milliseconds === null) {
      const { done, value } = await inTime(reader.read(), PATIENCE, late);
      if (done) milliseconds = performance.getEntriesByName(got!.url)[0]?.duration ?? performance.now();
      else post(value.slice().buffer);
    }
  } catch {
    // the worker tries again
  }
  post(null, milliseconds);
}
