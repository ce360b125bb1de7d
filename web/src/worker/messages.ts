/** Messages between the page and the worker. */

import type { Rendition, Span } from "../stream/manifest.ts";
import type { Metadata, Vector } from "../stream/metadata.ts";
import type { EmbeddedFiles } from "./source.ts";

/** Ports at which files arrive that the page has begun to fetch, by their paths in the stream. */
export type EarlyPorts = Readonly<Record<string, MessagePort>>;

/** The next chunk of a file; at its end, the milliseconds that it took, or null if it is not complete: the worker is to try,
 * and to say what is wrong. */
export type EarlyPart = ArrayBuffer | number | null;

/** A splat's depth is axis · (x, y, z, 1). */
export type DepthAxis = readonly [number, number, number, number];

/** How images are decoded. */
export type DecodePath = "webcodecs" | "webcodecs-software" | "video";

/** A stream's URL, files that the page itself holds, or a stream in one file (`.v3s`) on this computer. */
export type StreamSource = string | EmbeddedFiles | File;

export interface StreamOptions {
  /** How to decode; by default, the first one that works. `video` needs a page. */
  readonly path?: DecodePath | "auto";
  /** Whether the first group follows the last one, when groups are fetched ahead. */
  readonly loop?: boolean;
  /** The id of the rendition to fetch; by default, each group in the one that the connection and the device sustain. */
  readonly rendition?: string | null;
}

export interface OpenRequest extends Required<StreamOptions> {
  readonly type: "open";
  /** The stream's number among those that were opened, which the worker's messages about it repeat. */
  readonly number: number;
  readonly source: StreamSource;
  readonly early: EarlyPorts;
  /** Largest side of a texture that the device can render from. */
  readonly maxTexture: number;
}

/** Requests of the page to an opened stream. */
export type SessionRequest =
  /** Decode a frame and sort it along the axis: the event `picture`; null for its splats as arrays. The latest request wins. */
  | { readonly type: "present"; readonly frame: number; readonly axis: DepthAxis | null; readonly seek: boolean }
  /** Sort one of the last two decoded frames along another axis: the event `order`. */
  | { readonly type: "sort"; readonly frame: number; readonly axis: DepthAxis }
  | { readonly type: "loop"; readonly loop: boolean }
  /** Whether the playhead moves: what is fetched ahead depends on it. */
  | { readonly type: "playing"; readonly playing: boolean }
  /** How many frames of a group were shown, and dropped since decoding was late, for the choice of renditions. */
  | { readonly type: "played"; readonly group: number; readonly shown: number; readonly dropped: number }
  /** Return buffers that are no longer needed. */
  | { readonly type: "recycle"; readonly buffers: ArrayBuffer[] }
  /** Whether the splats behind the performer are shown; they are fetched when they first are. */
  | { readonly type: "set"; readonly shown: boolean }
  /** Look whether another bake has replaced the stream. */
  | { readonly type: "look" }
  /** The graphics context was lost: send the next image with its group's setup. */
  | { readonly type: "forget-setup" };

export type ToWorker = OpenRequest | SessionRequest;

/** A video to decode with a <video> element, which only the page can have. */
export interface Video {
  readonly file: Blob;
  readonly width: number;
  readonly height: number;
  /** Takes one `VideoTime` after the other, and answers each with the luma, or with a message if that fails; null ends it. */
  readonly port: MessagePort;
}

/** The middle of a video's image, which is shown for `duration`; both in seconds. */
export interface VideoTime {
  readonly time: number;
  readonly duration: number;
}

export interface RenditionInfo {
  readonly id: string;
  /** Maximum number of splats of a frame. */
  readonly splats: number;
  readonly shDegree: number;
  /** Bits per second. */
  readonly bandwidth: number;
}

/** A stream's properties, for the player. */
export interface StreamInfo extends Metadata {
  readonly fps: number;
  readonly frameCount: number;
  readonly shDegree: number;
  /** Bytes of all files, in all renditions. */
  readonly totalBytes: number;
  readonly renditions: readonly RenditionInfo[];
  readonly groups: readonly Span[];
  readonly box: { readonly min: Vector; readonly max: Vector };
  /** Whether groups are still being added. */
  readonly live: boolean;
  readonly hasSound: boolean;
  /** Whether there are splats behind the performer. */
  readonly hasSet: boolean;
  /** Whether SHA-256 checksums of files are verified; browsers support that only on secure pages. */
  readonly checksums: boolean;
}

/** Data shared by all frames of a group, for the renderer. */
export interface GroupSetup {
  /** The group in the rendition that was chosen for it. */
  readonly group: Rendition;
  /** Milliseconds from the group's files to the first packet and the tables of its splats. */
  readonly prepare: number;
  /** (tile, tile, 4), see MotionTables.statics. */
  readonly statics: Uint32Array<ArrayBuffer>;
}

export interface Picture {
  readonly frame: number;
  readonly group: number;
  /** Sent with an image if the page does not have its group's setup. */
  readonly setup: GroupSetup | null;
  readonly luma: Uint8Array<ArrayBuffer>;
  readonly blocks: Float32Array<ArrayBuffer>;
  readonly escapes: Int32Array<ArrayBuffer> | null;
  readonly order: Uint32Array<ArrayBuffer>;
  /** How many entries of `order` to draw. */
  readonly count: number;
  /** Milliseconds for this frame: video decoding (wall-clock service time of one image), dequantizing positions, sorting. */
  readonly timings: { readonly decode: number; readonly dequantize: number; readonly sort: number };
}

/** The numbers of splats, float32. */
export interface SplatArrays {
  /** (N, 3) centers in world units. */
  readonly means: Float32Array<ArrayBuffer>;
  /** (N, 4) unit quaternions, wxyz. */
  readonly quats: Float32Array<ArrayBuffer>;
  /** (N, 3) standard deviations along the axes in world units. */
  readonly scales: Float32Array<ArrayBuffer>;
  /** (N) 0 to 1. */
  readonly opacities: Float32Array<ArrayBuffer>;
  /** (N, (degree + 1)^2, 3) coefficients of RGB: color = 0.5 + sum of basis * coefficient, in 3DGS' order and signs. */
  readonly sh: Float32Array<ArrayBuffer>;
}

/** A frame's splats: float32, in one buffer. Values are those of docs/STREAM.md, "Splats". */
export interface Splats extends SplatArrays {
  readonly frame: number;
  readonly group: number;
  /** Id of the rendition that they are from. */
  readonly rendition: string;
  readonly count: number;
  readonly shDegree: number;
  /** Added to the diagonal of every projected covariance, in square pixels. */
  readonly dilation: number;
}

/** The splats behind the performer: `count` of SH degree 0, as means, quats, scales, opacities and sh, one after the other. */
export interface StreamSet {
  readonly splats: Float32Array<ArrayBuffer>;
  readonly count: number;
  readonly dilation: number;
}

/** Reports of the worker about a stream, by name; also the events of `V3Stream`. */
export interface StreamEvents {
  /** The manifest has been read. */
  opened: StreamInfo;
  /** A live stream has more frames, or is complete. */
  grown: StreamInfo;
  /** Other groups are in memory. `bytes`: received so far. `bandwidth`: Mbit/s, 0 while it is not known. */
  fetched: { readonly groups: readonly number[]; readonly bytes: number; readonly bandwidth: number };
  /** A group was fetched again in a better rendition. */
  improved: { readonly group: number };
  /** A group cannot be played; asking for its frames fails. */
  leftOut: { readonly group: number; readonly message: string };
  /** Answers to `present` and `sort`; `order.sort` in milliseconds. */
  picture: Picture;
  order: Pick<Picture, "frame" | "order" | "count"> & { readonly sort: number };
  splats: Splats;
  /** What has arrived of the set. */
  set: StreamSet;
  /** The sound's file; `start` and `length` in seconds. */
  sound: { readonly file: Blob; readonly start: number; readonly length: number };
  path: DecodePath;
  /** Another bake has taken the stream's place: what is not in memory can no longer be played. Open it again to see that one. */
  updated: undefined;
  /** A message for the viewer; playback continues. */
  notice: string;
  /** Nothing can be played. */
  failed: string;
}

interface Reports extends StreamEvents {
  video: Video;
}

/** Reports an event from the worker, with what to transfer. */
export type Report = <K extends keyof Reports>(type: K, value: Reports[K], transfer?: Transferable[]) => void;

export type FromWorker = {
  [K in keyof Reports]: { readonly number: number; readonly type: K; readonly value: Reports[K] }
}[keyof Reports];
