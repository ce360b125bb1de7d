/** Files that lie in the page itself as base64: a page that is opened from the disk may fetch nothing. */

import { StreamError } from "../stream/errors.ts";
import type { Source } from "./source.ts";

/** Base64 by path. */
export type EmbeddedFiles = Readonly<Record<string, string>>;

export class EmbeddedSource implements Source {
  constructor(private readonly files: EmbeddedFiles) {}

  readAll(path: string, limit: number): Promise<Uint8Array<ArrayBuffer>> {
    return new Promise((resolve) => resolve(this.decode(path, limit)));
  }

  private decode(path: string, limit: number): Uint8Array<ArrayBuffer> {
    if (!Object.hasOwn(this.files, path)) throw new StreamError(`${path} is not in this page.`);
    let text: string;
    try {
      text = atob(this.files[path]);
    } catch {
      throw new StreamError(`${path} is damaged: what this page holds of it is not base64.`);
    }
    if (text.length > limit) throw new StreamError(`${path} is larger than ${limit} bytes.`);
    const data = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) data[i] = text.charCodeAt(i);
    return data;
  }
}
