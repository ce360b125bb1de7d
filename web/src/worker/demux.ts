/** Extracts the packets of a video file, the first one before the others have arrived. */

import { messageOf, StreamError } from "../stream/errors.ts";
import { readVideoIndex, type VideoIndex } from "../stream/mp4.ts";
import type { Arriving } from "./arriving.ts";
import { inDisplayOrder } from "./order.ts";

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
    if (file.hasFailed) throw error;
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
