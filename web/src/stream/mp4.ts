/** The index of a video file: MP4 (ISO/IEC 14496-12) as docs/STREAM.md describes it, with one track and its index before its
 * data. A library would read any MP4 file, and be as large as the rest of the player. */

import { StreamError } from "./errors.ts";

export interface Sample {
  /** Place in the file. */
  readonly offset: number;
  readonly bytes: number;
  readonly key: boolean;
  /** Frame of the group that it decodes to: its place in the order of display. */
  readonly picture: number;
  /** Seconds, after the edit list. */
  readonly timestamp: number;
  readonly duration: number;
}

export interface VideoIndex {
  readonly config: VideoDecoderConfig & { readonly codedWidth: number; readonly codedHeight: number };
  /** The samples in the order of decoding, which differs from that of display where there are B-frames. */
  readonly samples: readonly Sample[];
}

const HEADER = 8;

/** A part of a file with other boxes or numbers in it; positions count from its beginning. */
class Box {
  constructor(private readonly view: DataView, private readonly start: number, private readonly end: number) {}

  private at(position: number, bytes: number): number {
    if (position < 0 || this.start + position + bytes > this.end) throw new StreamError("its index is damaged");
    return this.start + position;
  }

  u8(position: number): number {
    return this.view.getUint8(this.at(position, 1));
  }

  u16(position: number): number {
    return this.view.getUint16(this.at(position, 2));
  }

  u32(position: number): number {
    return this.view.getUint32(this.at(position, 4));
  }

  i32(position: number): number {
    return this.view.getInt32(this.at(position, 4));
  }

  u64(position: number): number {
    return this.u32(position) * 2 ** 32 + this.u32(position + 4);
  }

  name(position: number): string {
    return String.fromCharCode(...[0, 1, 2, 3].map((k) => this.u8(position + k)));
  }

  bytes(): Uint8Array<ArrayBuffer> {
    return new Uint8Array(this.view.buffer as ArrayBuffer, this.view.byteOffset + this.start, this.end - this.start).slice();
  }

  /** The boxes in it, by name; of several with the same name, the first. */
  children(position = 0): Map<string, Box> {
    const found = new Map<string, Box>();
    for (let at = position; this.start + at < this.end; ) {
      const size = this.u32(at);
      if (size < HEADER) throw new StreamError("its index is damaged");
      const start = this.at(at, size);
      const name = this.name(at + 4);
      if (!found.has(name)) found.set(name, new Box(this.view, start + HEADER, start + size));
      at += size;
    }
    return found;
  }

  /** A box in it by the names on the way there. */
  find(...names: readonly string[]): Box {
    return names.reduce<Box>((box, name) => {
      const found = box.children().get(name);
      if (found === undefined) throw new StreamError(`its index has no ${name}`);
      return found;
    }, this);
  }
}

/** Reads the index of a video file as soon as it has arrived. `prefix`: at least so many bytes from the beginning of the
 * file. `bytes`: the file's size. `most`: how many pictures it may have. StreamError: not such a file. */
export async function readVideoIndex(
  prefix: (count: number) => Promise<Uint8Array>,
  bytes: number,
  most: number,
): Promise<VideoIndex> {
  for (let at = 0; at + HEADER <= bytes; ) {
    const head = new Box(viewOf(await prefix(at + HEADER)), at, at + HEADER);
    const size = head.u32(0);
    const name = head.name(4);
    if (name === "mdat") throw new StreamError("its index comes after its data");
    if (size < HEADER || at + size > bytes) throw new StreamError("its boxes are damaged");
    if (name === "moov") return parseIndex(new Box(viewOf(await prefix(at + size)), at + HEADER, at + size), bytes, most);
    at += size;
  }
  throw new StreamError("it has no index");
}

const viewOf = (data: Uint8Array): DataView => new DataView(data.buffer, data.byteOffset, data.byteLength);

function parseIndex(moov: Box, bytes: number, most: number): VideoIndex {
  const track = moov.find("trak");
  const media = track.find("mdia");
  if (media.find("hdlr").name(8) !== "vide") throw new StreamError("it has no video track");
  const header = media.find("mdhd");
  const timescale = header.u32(header.u8(0) === 1 ? 20 : 12);
  if (timescale === 0) throw new StreamError("its index is damaged");
  const table = media.find("minf", "stbl");
  const sizes = sampleSizes(table.find("stsz"), most);
  const offsets = sampleOffsets(table, sizes);
  const durations = runs(table.find("stts"), sizes.length);
  const shifts = table.children().has("ctts") ? runs(table.find("ctts"), sizes.length) : sizes.map(() => 0);
  const keys = keySamples(table);
  const start = firstMediaTime(track);
  let time = 0;
  const timestamps = durations.map((duration, i) => {
    time += duration;
    return (time - duration + shifts[i] - start) / timescale;
  });
  const pictures = inDisplayOrder(timestamps);
  const samples = sizes.map((size, i) => {
    if (offsets[i] + size > bytes) throw new StreamError("its pictures lie beyond its end");
    const [timestamp, duration] = [timestamps[i], durations[i] / timescale];
    return { offset: offsets[i], bytes: size, key: keys?.has(i) ?? true, picture: pictures[i], timestamp, duration };
  });
  if (samples.length > 0 && !samples[0].key) throw new StreamError("its first picture needs others");
  if (samples.length > 0 && samples[0].picture !== 0) throw new StreamError("its first picture is not shown first");
  return { config: configOf(table.find("stsd")), samples };
}

/** Place of each sample in the order of display, which is that of the time stamps. */
export function inDisplayOrder(timestamps: readonly number[]): number[] {
  const order = timestamps.map((_, at) => at).sort((a, b) => timestamps[a] - timestamps[b]);
  const places = new Array<number>(timestamps.length);
  order.forEach((at, picture) => {
    if (picture > 0 && timestamps[at] === timestamps[order[picture - 1]]) throw new StreamError("two of its pictures have the same time");
    places[at] = picture;
  });
  return places;
}

/** Number of samples that hold an image and all before it, for each. B-frames need some that come later. */
export function samplesNeeded(samples: readonly Pick<Sample, "picture">[]): number[] {
  const needed = new Array<number>(samples.length).fill(0);
  samples.forEach(({ picture }, at) => {
    needed[picture] = at + 1;
  });
  for (let picture = 1; picture < needed.length; picture++)
    needed[picture] = Math.max(needed[picture], needed[picture - 1]);
  return needed;
}

function sampleSizes(box: Box, most: number): number[] {
  const [same, count] = [box.u32(4), box.u32(8)];
  if (count > most) throw new StreamError(`it has more than ${most} frames`);
  return Array.from({ length: count }, (_, i) => same || box.u32(12 + 4 * i));
}

/** The place of each sample: samples lie one after the other in chunks. */
function sampleOffsets(table: Box, sizes: readonly number[]): number[] {
  const boxes = table.children();
  const wide = !boxes.has("stco");
  const chunks = table.find(wide ? "co64" : "stco");
  const perChunk = table.find("stsc");
  const offsets: number[] = [];
  for (let chunk = 0, entry = 0; chunk < chunks.u32(4) && offsets.length < sizes.length; chunk++) {
    while (entry + 1 < perChunk.u32(4) && perChunk.u32(8 + 12 * (entry + 1)) <= chunk + 1) entry++;
    let at = wide ? chunks.u64(8 + 8 * chunk) : chunks.u32(8 + 4 * chunk);
    const count = Math.min(perChunk.u32(12 + 12 * entry), sizes.length - offsets.length);
    for (let i = 0; i < count; i++) {
      offsets.push(at);
      at += sizes[offsets.length - 1];
    }
  }
  if (offsets.length < sizes.length) throw new StreamError("its index is damaged");
  return offsets;
}

/** The values of a table of (count, value), one for each sample. */
function runs(box: Box, count: number): number[] {
  const values: number[] = [];
  for (let entry = 0; entry < box.u32(4) && values.length < count; entry++) {
    const repeated = Math.min(box.u32(8 + 8 * entry), count - values.length);
    const value = box.i32(12 + 8 * entry);
    for (let i = 0; i < repeated; i++) values.push(value);
  }
  if (values.length < count) throw new StreamError("its index is damaged");
  return values;
}

/** The samples that need no others; null if none does. */
function keySamples(table: Box): Set<number> | null {
  const box = table.children().get("stss");
  return box === undefined ? null : new Set(Array.from({ length: Math.min(box.u32(4), 10_000) }, (_, i) => box.u32(8 + 4 * i) - 1));
}

/** The time that the edit list skips, in the media's units. */
function firstMediaTime(track: Box): number {
  const list = track.children().get("edts")?.children().get("elst");
  if (list === undefined || list.u32(4) === 0) return 0;
  const time = list.u8(0) === 1 ? list.i32(20) : list.i32(12);
  return Math.max(time, 0);
}

const hex = (value: number): string => value.toString(16).toUpperCase().padStart(2, "0");

/** Codec, size and what a decoder must know, from the sample description. */
function configOf(list: Box): VideoIndex["config"] {
  const [name, entry] = list.children(8).entries().next().value ?? ["", list];
  const size = { codedWidth: entry.u16(24), codedHeight: entry.u16(26) };
  const inside = entry.children(78);
  const avc = inside.get("avcC");
  if (name !== "avc1" || avc === undefined) throw new StreamError(`it contains ${JSON.stringify(name)}, not H.264`);
  return { codec: `avc1.${hex(avc.u8(1))}${hex(avc.u8(2))}${hex(avc.u8(3))}`, ...size, description: avc.bytes() };
}
