/** Messages between the page and the worker. */

import type { Span } from "../stream/manifest.ts";
import type { SplatArrays } from "../stream/manifest_types.ts";
import type { Metadata, Vector } from "../stream/metadata.ts";
import type { EmbeddedFiles } from "./source.ts";

/** Where the files of `names` arrive, chunk by chunk; the manifest's name is empty. */
export interface EarlyPort {
  readonly port: MessagePort;
  readonly names: readonly string[];
}

export interface EarlyPart {
  readonly name: string;
  /** The next chunk; null at the end. */
  readonly data: ArrayBuffer | null;
  /** At the end, what the file took; null if it is not complete: the worker is to try, and to say what is wrong. */
  readonly milliseconds: number | null;
}

/** A splat's depth is axis · (x, y, z, 1). */
export type DepthAxis = readonly [number, number, number, number];

/** How images are decoded. */
export type DecodePath = "webcodecs" | "webcodecs-software" | "video";

export interface OpenRequest {
  readonly type: "open";
  readonly url: string;
  /** The stream's files if the page holds them, else null. */
  readonly files: EmbeddedFiles | null;
  /** A stream in one file (`.v3s`) on this computer, else null. */
  readonly archive: File | null;
  /** Where files arrive that the page has begun to fetch; null if there are none. */
  readonly early: EarlyPort | null;
  readonly path: DecodePath | "auto";
  /** Largest side of a texture that the device can render from. */
  readonly maxTexture: number;
  readonly loop: boolean;
  /** Id of the rendition to fetch; null for each group in the one that suits. */
  readonly rendition: string | null;
}

/** What the page asks of an opened stream. */
export type SessionRequest =
  /** Decode a frame and sort it along the axis: the event `picture`; null for its splats as arrays. The latest request wins. */
  | { readonly type: "present"; readonly frame: number; readonly axis: DepthAxis | null; readonly seek: boolean }
  /** Sort one of the last two decoded frames along another axis: the event `order`, with `request`. */
  | { readonly type: "sort"; readonly request: number; readonly frame: number; readonly axis: DepthAxis }
  | { readonly type: "loop"; readonly loop: boolean }
  /** Whether the playhead moves: what is fetched ahead depends on it. */
  | { readonly type: "playing"; readonly playing: boolean }
  /** How many frames of a group were shown, and dropped since decoding was late, for the choice of renditions. */
  | { readonly type: "played"; readonly group: number; readonly shown: number; readonly dropped: number }
  /** Return buffers that are no longer needed. */
  | { readonly type: "recycle"; readonly buffers: ArrayBuffer[] }
  /** The graphics context was lost: send the next image with its group's setup. */
  | { readonly type: "forget-setup" };

export type ToWorker = OpenRequest | SessionRequest | VideoReply;

/** Replies of the page, since only the page can have <video> elements. */
export type VideoReply =
  | { readonly type: "video-frame"; readonly request: number; readonly luma: ArrayBuffer }
  | { readonly type: "video-error"; readonly request: number; readonly message: string };

export type VideoRequest =
  | {
      readonly type: "video-open";
      readonly request: number;
      readonly source: number;
      readonly file: Blob;
      readonly width: number;
      readonly height: number;
    }
  /** `time` is the middle of the requested image, which is shown for `duration`; both in seconds. */
  | {
      readonly type: "video-read";
      readonly request: number;
      readonly source: number;
      readonly time: number;
      readonly duration: number;
    }
  | { readonly type: "video-close"; readonly source: number };

export interface RenditionInfo {
  readonly id: string;
  /** Maximum number of splats of a frame. */
  readonly splats: number;
  readonly shDegree: number;
  /** Bits per second. */
  readonly bandwidth: number;
}

/** What the player needs to know about a stream. */
export interface StreamInfo extends Metadata {
  readonly profile: "motion" | "planes";
  readonly codec: string;
  readonly fps: number;
  readonly frameCount: number;
  readonly shDegree: number;
  /** Of all files, in all renditions. */
  readonly totalBytes: number;
  readonly renditions: readonly RenditionInfo[];
  readonly groups: readonly Span[];
  readonly box: { readonly min: Vector; readonly max: Vector };
  /** Whether groups are still being added. */
  readonly live: boolean;
  readonly hasSound: boolean;
  /** Whether SHA-256 checksums of files are verified; browsers support that only on secure pages. */
  readonly checksums: boolean;
}

/** Data shared by all frames of a group, for the renderer. */
export interface GroupSetup {
  readonly group: number;
  /** Id of the rendition that the group's data are from; empty in streams of a single one. */
  readonly rendition: string;
  /** Size of the group's files in this rendition, and how many frames they hold. */
  readonly bytes: number;
  readonly frames: number;
  /** Milliseconds from the group's files to the first packet and the tables of its splats. */
  readonly prepare: number;
  readonly profile: "motion" | "planes";
  readonly splats: number;
  readonly shDegree: number;
  /** Added to the diagonal of every projected covariance, in square pixels, as in studio.rasterizer. */
  readonly dilation: number;
  readonly tile: number;
  readonly columns: number;
  readonly rows: number;
  /** (C, 2) base and step of each channel or plane: value = base + code * step. */
  readonly units: Float32Array<ArrayBuffer>;
  /** (tile, tile, 4), see MotionTables.statics; null in `planes`. */
  readonly statics: Uint32Array<ArrayBuffer> | null;
  readonly blocks: number;
  readonly lattice: { readonly min: Vector; readonly step: number; readonly ratio: number } | null;
  /** `planes`: whether each position's low byte is mirrored. */
  readonly mirrored: readonly boolean[];
}

export interface Picture {
  readonly frame: number;
  readonly group: number;
  /** Sent with an image if the page does not have its group's setup. */
  readonly setup: GroupSetup | null;
  readonly luma: Uint8Array<ArrayBuffer>;
  readonly blocks: Float32Array<ArrayBuffer> | null;
  readonly escapes: Int32Array<ArrayBuffer> | null;
  readonly order: Uint32Array<ArrayBuffer>;
  /** How many entries of `order` to draw. */
  readonly count: number;
  /** Milliseconds for this frame: video decoding (wall-clock service time of one image), dequantizing positions, sorting. */
  readonly timings: { readonly decode: number; readonly dequantize: number; readonly sort: number };
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

/** What the worker reports of a stream, by name; also the events of `V3Stream`. */
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
  order: Pick<Picture, "frame" | "order" | "count"> & { readonly request: number; readonly sort: number };
  splats: Splats;
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

/** Reports an event from the worker, with what to transfer. */
export type Report = <K extends keyof StreamEvents>(type: K, value: StreamEvents[K], transfer?: Transferable[]) => void;

export type FromWorker =
  | { [K in keyof StreamEvents]: { readonly type: K; readonly value: StreamEvents[K] } }[keyof StreamEvents]
  | VideoRequest;
