/** Extracts the packets of a video file, the first one before the others have arrived. */

import { messageOf, StreamError } from "../stream/errors.ts";
import { readVideoIndex, type VideoIndex } from "../stream/mp4.ts";
import type { Arriving } from "./arriving.ts";

export interface Packet {
  /** Frame of the group that it decodes to: its place in the order of display. */
  readonly picture: number;
  readonly key: boolean;
  readonly data: Uint8Array;
  /** Seconds. */
  readonly timestamp: number;
  readonly duration: number;
}

export interface Demuxed {
  readonly config: VideoDecoderConfig;
  /** The first packet, which is that of the first picture. */
  first(): Promise<Packet>;
  /** All packets in decoding order, which differs from display order where there are B-frames. */
  packets(): Promise<readonly Packet[]>;
}

/** Reads the index of a video file. `name`: for messages. StreamError: not an MP4 file with one video of that codec, size and
 * length. */
export async function demux(
  file: Arriving,
  name: string,
  codec: VideoIndex["codec"],
  size: readonly [number, number],
  frames: number,
): Promise<Demuxed> {
  let index: VideoIndex;
  let places: number[];
  try {
    index = await readVideoIndex((count) => file.prefix(count), file.bytes, frames);
    const { codedWidth, codedHeight } = index.config;
    if (index.codec !== codec || codedWidth !== size[0] || codedHeight !== size[1])
      throw new StreamError(
        `it contains ${index.codec} video of ${codedWidth}x${codedHeight}, but the manifest specifies ${codec} of ${size[0]}x${size[1]}`,
      );
    if (index.samples.length < frames)
      throw new StreamError(`it has ${index.samples.length} frames, but the manifest specifies ${frames}`);
    places = inDisplayOrder(index.samples);
    if (places[0] !== 0) throw new StreamError("its first picture is not shown first");
  } catch (error) {
    if (file.failure !== null) throw error;
    throw new StreamError(`${name} cannot be read: ${messageOf(error)}.`);
  }
  const { config, samples } = index;
  const packet = (data: Uint8Array, at: number): Packet => {
    const { offset, bytes, key, timestamp, duration } = samples[at];
    return { picture: places[at], key, data: data.subarray(offset, offset + bytes), timestamp, duration };
  };
  return {
    config,
    first: async () => packet(await file.prefix(samples[0].offset + samples[0].bytes), 0),
    packets: async () => {
      const data = await file.whole();
      return samples.map((_, at) => packet(data, at));
    },
  };
}

/** Place of each packet in the order of display, which is that of the time stamps. */
export function inDisplayOrder(packets: readonly { readonly timestamp: number }[]): number[] {
  const order = packets.map((_, at) => at).sort((a, b) => packets[a].timestamp - packets[b].timestamp);
  const places = new Array<number>(packets.length);
  order.forEach((at, picture) => {
    if (picture > 0 && packets[at].timestamp === packets[order[picture - 1]].timestamp)
      throw new StreamError("two of its pictures have the same time");
    places[at] = picture;
  });
  return places;
}

/** For each image: how many packets hold it and all images before it. B-frames need some that come later. */
export function packetsNeeded(packets: readonly { readonly picture: number }[]): number[] {
  const needed = new Array<number>(packets.length).fill(0);
  packets.forEach(({ picture }, at) => {
    needed[picture] = at + 1;
  });
  for (let picture = 1; picture < needed.length; picture++)
    needed[picture] = Math.max(needed[picture], needed[picture - 1]);
  return needed;
}
