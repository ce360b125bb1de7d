/** The manifest that a page begins to fetch before the player's script has arrived. */

/** What the page leaves for the player. */
export interface EarlyManifest {
  /** As in the player's `src`. */
  readonly address: string;
  /** Null if the request has failed. */
  readonly response: Promise<Response | null>;
}

declare global {
  interface Window {
    v3Manifest?: EarlyManifest;
  }
}

/** Milliseconds after which the worker fetches the manifest itself. */
const PATIENCE = 15_000;

/**
 * Takes the early manifest of an address; null if there is none. It is used once: whoever opens the stream again wants
 * the newest manifest.
 *
 * @param url - whole address of the manifest
 * @returns where one message will arrive: the manifest's bytes, or null if the worker is to fetch it, and say what is wrong
 */
export function takeEarlyManifest(url: string): MessagePort | null {
  const early = window.v3Manifest;
  if (early === undefined || new URL(early.address, document.baseURI).href !== url) return null;
  delete window.v3Manifest;
  const { port1, port2 } = new MessageChannel();
  let late: ReturnType<typeof setTimeout> | undefined;
  const none = new Promise<null>((resolve) => {
    late = setTimeout(resolve, PATIENCE, null);
  });
  const read = early.response.then((response) => (response?.ok === true ? response.arrayBuffer() : null));
  void Promise.race([read.catch(() => null), none]).then((data) => {
    clearTimeout(late);
    port1.postMessage(data, data === null ? [] : [data]);
  });
  return port2;
}
