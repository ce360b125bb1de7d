/** Sources of a stream's files, and their verification. */

import { StreamError } from "../stream/errors.ts";
import type { FileEntry } from "../stream/manifest.ts";

/** Called while a file arrives: the first `filled` bytes of `data` are there. */
export type Arrived = (data: Uint8Array<ArrayBuffer>, filled: number) => void;

export interface Source {
  /** Fetches a file of at most `limit` bytes. A source that gets it piece by piece calls `arrived`. */
  read(path: string, limit: number, signal: AbortSignal, arrived?: Arrived): Promise<Uint8Array<ArrayBuffer>>;
  /** The file as it is now, in one attempt of which nobody is told; only where files may change. */
  peek?(path: string, signal: AbortSignal): Promise<Uint8Array<ArrayBuffer>>;
  /** Milliseconds that a file took which was on its way before it was read; 0 for others. */
  early?(path: string): number;
}

/** SHA-256 as lowercase hexadecimal digits; null on insecure pages, where browsers do not provide it. */
export async function sha256(data: Uint8Array<ArrayBuffer>): Promise<string | null> {
  // In an insecure context `subtle` is undefined, despite its type.
  const subtle = crypto.subtle as SubtleCrypto | undefined;
  if (subtle === undefined) return null;
  const digest = new Uint8Array(await subtle.digest("SHA-256", data));
  return Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** A file of the stream, verified where the browser provides SHA-256. StreamError: it is missing or does not match the
 * manifest. */
export async function readChecked(
  source: Source,
  file: FileEntry,
  signal: AbortSignal,
  arrived?: Arrived,
): Promise<Uint8Array<ArrayBuffer>> {
  const { path, bytes } = file;
  const data = await source.read(path, bytes, signal, arrived);
  if (data.length !== bytes) throw new StreamError(`${path} has ${data.length} bytes, but the manifest specifies ${bytes}.`);
  const digest = await sha256(data);
  if (digest !== null && digest !== file.sha256)
    throw new StreamError(`${path} is damaged: its SHA-256 does not match the manifest.`);
  return data;
}

/** Files that lie in the page itself: base64 by path. A page that is opened from the disk may fetch nothing. */
export type EmbeddedFiles = Readonly<Record<string, string>>;

export class EmbeddedSource implements Source {
  constructor(private readonly files: EmbeddedFiles) {}

  read(path: string, limit: number): Promise<Uint8Array<ArrayBuffer>> {
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
