/** Receives the files that the page has begun to fetch. */

import type { EarlyPart, EarlyPort } from "./messages.ts";

/** Name of the manifest. */
export const EARLY_MANIFEST = "";

type Take = (chunk: Uint8Array<ArrayBuffer>) => void;

/** A file on its way: what has come of it, until somebody takes it. */
class Coming {
  private take: Take | null = null;
  private readonly chunks: Uint8Array<ArrayBuffer>[] = [];
  private end: (milliseconds: number | null) => void = () => undefined;
  private readonly ended = new Promise<number | null>((resolve) => {
    this.end = resolve;
  });

  receive({ data, milliseconds }: EarlyPart): void {
    if (data === null) this.end(milliseconds);
    else if (this.take === null) this.chunks.push(new Uint8Array(data));
    else this.take(new Uint8Array(data));
  }

  hand(take: Take): Promise<number | null> {
    this.chunks.forEach(take);
    this.take = take;
    return this.ended;
  }
}

export class EarlyFiles {
  private readonly coming: Map<string, Coming>;

  constructor({ port, names }: EarlyPort) {
    const files = new Map(names.map((name) => [name, new Coming()]));
    this.coming = new Map(files);
    port.onmessage = ({ data: part }: MessageEvent<EarlyPart>) => {
      files.get(part.name)?.receive(part);
      if (part.data === null) files.delete(part.name);
      if (files.size === 0) port.close();
    };
  }

  /** Hands over a file, once, chunk by chunk as it comes. Returns the milliseconds that it took; null if the page does not
   * fetch it, or could not fetch all of it. */
  async take(name: string, take: Take): Promise<number | null> {
    const coming = this.coming.get(name);
    this.coming.delete(name);
    return coming === undefined ? null : coming.hand(take);
  }
}
