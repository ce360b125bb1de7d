/**
 * What a page begins to fetch before the player's script has arrived: the manifest, and the files with which playback
 * begins.
 */

import type { EarlyFile, EarlyPort } from "../worker/messages.ts";

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

/** Milliseconds after which the worker fetches a file itself. */
const PATIENCE = 15_000;

/**
 * Takes the early files of an address; null if there are none. They are used once: anyone who opens the stream again wants
 * the newest manifest.
 *
 * @param url - whole address of the manifest
 */
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
  let late: ReturnType<typeof setTimeout> | undefined;
  const none = new Promise<null>((resolve) => {
    late = setTimeout(resolve, PATIENCE, null);
  });
  let milliseconds = 0;
  const read = async (): Promise<ArrayBuffer | null> => {
    const got = await response;
    if (got?.ok !== true) return null;
    const data = await got.arrayBuffer();
    milliseconds = performance.getEntriesByName(got.url)[0]?.duration ?? performance.now();
    return data;
  };
  const data = await Promise.race([read().catch(() => null), none]);
  clearTimeout(late);
  const message: EarlyFile = { name, data, milliseconds };
  port.postMessage(message, data === null ? [] : [data]);
}
