/** Extracts the packets of an MP4 file in memory. */

import { BufferSource, EncodedPacketSink, Input, MP4 } from "mediabunny";
import { messageOf, StreamError } from "../stream/errors.ts";
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
  /** In decoding order, which differs from display order where there are B-frames. */
  readonly packets: readonly Packet[];
}

const CODECS = { h264: "avc", hevc: "hevc", av1: "av1" } as const;

/**
 * Reads the packets of a video file.
 *
 * @param name - for messages
 * @throws StreamError - not an MP4 file with one video of that codec, size and length
 */
export async function demux(
  data: Uint8Array<ArrayBuffer>,
  name: string,
  codec: keyof typeof CODECS,
  size: readonly [number, number],
  frames: number,
): Promise<Demuxed> {
  const input = new Input({ formats: [MP4], source: new BufferSource(data) });
  try {
    const track = await input.getPrimaryVideoTrack();
    if (track === null) throw new StreamError("it has no video track");
    const found = [await track.getCodedWidth(), await track.getCodedHeight()] as const;
    const foundCodec = await track.getCodec();
    if (foundCodec !== CODECS[codec] || found[0] !== size[0] || found[1] !== size[1])
      throw new StreamError(
        `it contains ${foundCodec ?? "unknown"} video of ${found[0]}x${found[1]}, but the manifest specifies ${codec} of ${size[0]}x${size[1]}`,
      );
    const config = await track.getDecoderConfig();
    if (config === null) throw new StreamError("its decoder configuration is missing");
    const packets: Omit<Packet, "picture">[] = [];
    for await (const packet of new EncodedPacketSink(track).packets()) {
      if (packets.length === frames) throw new StreamError(`it has more than ${frames} frames`);
      packets.push({
        key: packet.type === "key",
        data: packet.data,
        timestamp: packet.timestamp,
        duration: packet.duration,
      });
    }
    if (packets.length < frames) throw new StreamError(`it has ${packets.length} frames, but the manifest specifies ${frames}`);
    return { config, packets: inDisplayOrder(packets).map((picture, at) => ({ ...packets[at], picture })) };
  } catch (error) {
    throw new StreamError(`${name} cannot be read: ${messageOf(error)}.`);
  } finally {
    input.dispose();
  }
}
