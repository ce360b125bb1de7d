/** A stream in one file (`.v3s`): a ZIP archive of stored entries, read by ranges of a URL or of a file on this computer. See
 * docs/STREAM.md, "One file". */

import { StreamError } from "../stream/errors.ts";
import { MANIFEST_NAME } from "../stream/manifest.ts";
import type { Source } from "./source.ts";

/** Bytes of a range, fewer at the end of the file, and the size of the file. */
export type ReadRange = (start: number, count: number, signal: AbortSignal) => Promise<{ data: Uint8Array<ArrayBuffer>; size: number }>;

const ENDS = 65_536;
const LOCAL_BYTES = 30;
const END_BYTES = 22;
const WIDE_LOCATOR_BYTES = 20;
const WIDE_END_BYTES = 56;
const MOST_ENTRIES = 1 << 20;
const MOST_DIRECTORY = 256 << 20;
/** Names are short and entries have no extra fields: what is read beyond an entry, to need no request for its header. */
const MARGIN = 256;
const WIDE = 0xffff_ffff;

interface Entry {
  readonly offset: number;
  readonly size: number;
}

export class ArchiveSource implements Source {
  private directory: Promise<Map<string, Entry>> | null = null;
  /** The beginning of the file, which has the manifest and usually the first group. */
  private head: Uint8Array<ArrayBuffer> = new Uint8Array(0);

  constructor(private readonly readRange: ReadRange, private readonly name: string) {}

  async read(path: string, limit: number, signal: AbortSignal): Promise<Uint8Array<ArrayBuffer>> {
    this.directory ??= this.open(signal);
    const entry = (await this.directory).get(path);
    if (entry === undefined) throw new StreamError(`${this.name} does not contain ${path}.`);
    if (entry.size > limit) throw new StreamError(`${path} is larger than ${limit} bytes.`);
    const most = LOCAL_BYTES + MARGIN + entry.size;
    let part = await this.range(entry.offset, most, signal);
    const view = new DataView(part.buffer, part.byteOffset, part.byteLength);
    if (part.length < LOCAL_BYTES || view.getUint32(0, true) !== 0x0403_4b50) throw this.damaged();
    const start = LOCAL_BYTES + view.getUint16(26, true) + view.getUint16(28, true);
    if (start + entry.size > part.length && start > LOCAL_BYTES + MARGIN)
      part = await this.range(entry.offset, start + entry.size, signal);
    if (start + entry.size > part.length) throw this.damaged();
    return part.slice(start, start + entry.size);
  }

  private damaged(): StreamError {
    return new StreamError(`${this.name} is damaged or incomplete: it is not a ZIP archive as a stream in one file is.`);
  }

  private async range(start: number, count: number, signal: AbortSignal): Promise<Uint8Array<ArrayBuffer>> {
    if (start + count <= this.head.length) return this.head.subarray(start, start + count);
    return (await this.readRange(start, count, signal)).data;
  }

  private async open(signal: AbortSignal): Promise<Map<string, Entry>> {
    const { data: head, size } = await this.readRange(0, ENDS, signal);
    this.head = head;
    const tailStart = Math.max(0, size - ENDS);
    const tail = size <= head.length ? head : (await this.readRange(tailStart, size - tailStart, signal)).data;
    const view = new DataView(tail.buffer, tail.byteOffset, tail.byteLength);
    let at = tail.length - END_BYTES;
    while (at >= 0 && view.getUint32(at, true) !== 0x0605_4b50) at--;
    if (at < 0) throw this.damaged();
    let count = view.getUint16(at + 10, true);
    let bytes = view.getUint32(at + 12, true);
    let offset = view.getUint32(at + 16, true);
    const locator = at - WIDE_LOCATOR_BYTES;
    if (locator >= 0 && view.getUint32(locator, true) === 0x0706_4b50) {
      const place = Number(view.getBigUint64(locator + 8, true));
      const wide = await this.range(place, WIDE_END_BYTES, signal);
      if (wide.length < WIDE_END_BYTES) throw this.damaged();
      const end = new DataView(wide.buffer, wide.byteOffset, wide.byteLength);
      count = Number(end.getBigUint64(32, true));
      bytes = Number(end.getBigUint64(40, true));
      offset = Number(end.getBigUint64(48, true));
    }
    if (count > MOST_ENTRIES || bytes > MOST_DIRECTORY || offset + bytes > size) throw this.damaged();
    const directory =
      offset >= tailStart ? tail.subarray(offset - tailStart, offset - tailStart + bytes) : await this.range(offset, bytes, signal);
    return this.entries(directory, count, size);
  }

  private entries(data: Uint8Array, count: number, size: number): Map<string, Entry> {
    const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
    const text = new TextDecoder();
    const found = new Map<string, Entry>();
    let at = 0;
    for (let i = 0; i < count; i++) {
      if (at + 46 > data.length || view.getUint32(at, true) !== 0x0201_4b50) throw this.damaged();
      if ((view.getUint16(at + 8, true) & 1) !== 0 || view.getUint16(at + 10, true) !== 0)
        throw new StreamError(`${this.name} is compressed or encrypted; the files of a stream in one file are stored as they are.`);
      const [names, extras, comments] = [28, 30, 32].map((field) => view.getUint16(at + field, true));
      const end = at + 46 + names + extras + comments;
      if (end > data.length) throw this.damaged();
      const name = text.decode(data.subarray(at + 46, at + 46 + names));
      const entry = {
        size: view.getUint32(at + 24, true),
        offset: view.getUint32(at + 42, true),
        ...(extras > 0 ? wideFields(view, at, at + 46 + names, extras) : {}),
      };
      if (entry.offset + entry.size > size) throw this.damaged();
      if (i === 0 && name !== MANIFEST_NAME) throw new StreamError(`${this.name} is not a stream: its first file is not ${MANIFEST_NAME}.`);
      found.set(name, entry);
      at = end;
    }
    return found;
  }
}

/** Size and offset from the ZIP64 extra field, as far as they do not fit into 32 bits. */
function wideFields(view: DataView, entry: number, start: number, length: number): Partial<Entry> {
  for (let at = start; at + 4 <= start + length; at += 4 + view.getUint16(at + 2, true)) {
    if (view.getUint16(at, true) !== 1) continue;
    const found: { size?: number; offset?: number } = {};
    let next = at + 4;
    const take = (): number => {
      next += 8;
      return next <= start + length ? Number(view.getBigUint64(next - 8, true)) : NaN;
    };
    if (view.getUint32(entry + 24, true) === WIDE) found.size = take();
    if (view.getUint32(entry + 20, true) === WIDE) take();
    if (view.getUint32(entry + 42, true) === WIDE) found.offset = take();
    return found;
  }
  return {};
}

/** Ranges of a file on this computer, such as one that was dropped onto the page. Browsers refuse to read one that has changed
 * since then. */
export function rangesOf(file: Blob): ReadRange {
  return async (start, count) => {
    try {
      return { data: new Uint8Array(await file.slice(start, start + count).arrayBuffer()), size: file.size };
    } catch {
      throw new StreamError("The file was changed or removed on this computer; open it again.");
    }
  };
}
