/** Receives the files that the page has begun to fetch. */

import type { EarlyFile, EarlyPort } from "./messages.ts";

/** Name of the manifest. */
export const EARLY_MANIFEST = "";

export class EarlyFiles {
  private readonly coming = new Map<string, Promise<EarlyFile>>();

  constructor({ port, names }: EarlyPort) {
    const receivers = new Map<string, (file: EarlyFile) => void>();
    for (const name of names) this.coming.set(name, new Promise((resolve) => receivers.set(name, resolve)));
    port.onmessage = ({ data }: MessageEvent<EarlyFile>) => {
      receivers.get(data.name)?.(data);
      receivers.delete(data.name);
      if (receivers.size === 0) port.close();
    };
  }

  /** A file, once; null if the page does not fetch it, or cannot. */
  async take(name: string): Promise<{ data: Uint8Array<ArrayBuffer>; milliseconds: number } | null> {
    const coming = this.coming.get(name);
    if (coming === undefined) return null;
    this.coming.delete(name);
    const { data, milliseconds } = await coming;
    return data === null ? null : { data: new Uint8Array(data), milliseconds };
  }
}
