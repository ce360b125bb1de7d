/**
 * The manifest: types, and the checks of docs/STREAM.md ("What a reader must refuse").
 *
 * Reads versions 1 (`planes`), 2 and 3. Additions of later versions are parsed only here.
 */

import type { ViewRange } from "../render/view_range.ts";
import { StreamError } from "./errors.ts";

export const FORMAT = "v3studio-stream";
export const NEWEST_VERSION = 3;
const PAGE_FORMAT = "v3studio-stream-page";
export const MANIFEST_NAME = "manifest.json";

const MAX_SPLATS = 4 << 20;
const MAX_GROUP_FRAMES = 10_000;
const MAX_DIRECTIONS = 256;
const MAX_FRAMES = 100_000_000;
const MAX_GROUPS = 1_000_000;
const MAX_FILE_BYTES = 2 ** 30;
export const MAX_MANIFEST_BYTES = 64 << 20;
const MAX_SIDE_BYTES = 2 ** 28;
const MAX_PICTURE = 16384;
const MAX_VALUE = 1e9;
const MAX_LOG_SCALE = Math.log(MAX_VALUE);
/** Largest extent of the keyframe's lattice in units of the blocks' radius. */
const MAX_BLOCK_SPAN = 1e6;
/** Of groups that give none, and its bounds, as in studio.gaussians. */
const DILATION = 0.3;
const MIN_DILATION = 0.001;
const MAX_DILATION = 1;

/** Bounds of a component's or channel's values, so that all that is drawn is finite: scales end where positions do. */
export function valueBounds(name: string): readonly [low: number, high: number] {
  return [-MAX_VALUE, name.startsWith("log_scale") ? MAX_LOG_SCALE : MAX_VALUE];
}
const PATH = /^[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}(\/[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}){0,7}$/;
/** Version 3: files are named by the first digits of their SHA-256. */
export const HASHED = /^files\/([0-9a-f]{32})\.[a-z0-9]{1,8}$/;
const MAX_RENDITIONS = 16;
const MAX_PAGE_BYTES = 1 << 24;
const MAX_PAGE_GROUPS = 4096;
const MAX_AUDIO_BYTES = 2 ** 28;
const MAX_AUDIO_SAMPLES = 2 ** 32;
/** Seconds by which sound may be longer than the frames. */
const AUDIO_TOLERANCE = 0.1;
const RENDITION = /^[a-z0-9-]{1,32}$/;
const SHA256 = /^[0-9a-f]{64}$/;

export type Vector = readonly [number, number, number];

export interface Box {
  readonly min: Vector;
  readonly max: Vector;
}

/** A file of a group; `path` is relative to the manifest. */
export interface FileEntry {
  readonly path: string;
  readonly bytes: number;
  readonly sha256: string;
}

export interface SideEntry extends FileEntry {
  /** Decompressed size. */
  readonly rawBytes: number;
}

/** CRC-32 of the decoded luma of one picture of a video. */
export interface LumaCheck {
  readonly picture: number;
  readonly crc32: number;
}

export interface VideoEntry extends FileEntry {
  /** Empty in versions 1 and 2. */
  readonly checks: readonly LumaCheck[];
}

/** The sound: AAC in an MP4 file. */
export interface AudioEntry extends FileEntry {
  /** Seconds from the first frame to the first sample. */
  readonly start: number;
  /** Seconds of sound. */
  readonly length: number;
}

/** A group's frames. */
export interface Span {
  readonly firstFrame: number;
  readonly frameCount: number;
}

/** A rendition of the whole stream. */
export interface Rendition {
  readonly id: string;
  readonly splats: number;
  readonly shDegree: number;
  readonly bytes: number;
  /** Bits per second. */
  readonly bandwidth: number;
}

/** A page of the index: a file with groups `firstGroup` and following. */
export interface PageEntry extends FileEntry {
  readonly firstGroup: number;
  readonly firstFrame: number;
  /** Frames of each of its groups. */
  readonly frames: readonly number[];
}

interface GroupCommon {
  /** Its rendition's id; empty in versions 1 and 2. */
  readonly rendition: string;
  readonly index: number;
  readonly firstFrame: number;
  readonly frameCount: number;
  readonly splats: number;
  readonly shDegree: number;
  /** Added to the diagonal of every projected covariance, in square pixels. */
  readonly dilation: number;
  readonly boundingBox: Box;
  readonly bytes: number;
  /** All files in the order in which a player needs them. */
  readonly files: readonly FileEntry[];
}

/** A group of the profile `motion`; names as in docs/STREAM.md. */
export interface MotionGroup extends GroupCommon {
  readonly profile: "motion";
  readonly tile: number;
  readonly columns: number;
  readonly rows: number;
  readonly positions: { readonly bits: number; readonly min: Vector; readonly step: number };
  readonly blocks: {
    readonly count: number;
    readonly radius: number;
    readonly step: number;
    readonly rotationStep: number;
  };
  readonly channels: readonly { readonly name: string; readonly offset: number; readonly step: number }[];
  readonly side: SideEntry;
  readonly video: VideoEntry;
}

export type Part = "all" | "high" | "low" | "low_mirrored";

export interface PlaneEntry extends VideoEntry {
  readonly part: Part;
}

export interface ComponentEntry {
  readonly name: string;
  readonly min: number;
  readonly max: number;
  readonly planes: readonly PlaneEntry[];
}

/** A group of the profile `planes`. */
export interface PlanesGroup extends GroupCommon {
  readonly profile: "planes";
  readonly side: number;
  readonly components: readonly ComponentEntry[];
}

export type Group = MotionGroup | PlanesGroup;

export type CodecName = "h264" | "hevc" | "av1";

/** A pinhole camera, OpenCV axes; pixels from the outer corner of the top-left pixel. */
export interface Camera {
  readonly width: number;
  readonly height: number;
  readonly K: readonly (readonly number[])[];
  readonly worldToCamera: readonly (readonly number[])[];
}

export interface Manifest {
  readonly version: number;
  readonly profile: "motion" | "planes";
  readonly fps: number;
  readonly frameCount: number;
  /** Of the best rendition. */
  readonly shDegree: number;
  readonly codec: CodecName;
  readonly boundingBox: Box;
  /** The best first; empty in versions 1 and 2. */
  readonly renditions: readonly Rendition[];
  /** All groups. */
  readonly spans: readonly Span[];
  /** The first groups, each in all its renditions; in versions 1 and 2 all groups in one. */
  readonly groups: readonly (readonly Group[])[];
  /** Where the other groups are. */
  readonly pages: readonly PageEntry[];
  readonly audio: AudioEntry | null;
  readonly totalBytes: number;
  readonly sha256: string;
  /** Metadata for players; each value only if it is present and well-formed. */
  readonly camera: Camera | null;
  readonly up: Vector | null;
  readonly background: Vector | null;
  readonly viewRange: ViewRange | null;
  readonly title: string | null;
  /** Whether groups are still being added. */
  readonly live: boolean;
}

type Values = Record<string, unknown>;

/** Reads values from JSON; every message names the position in the file. */
class Reader {
  private readonly values: Values;
  private readonly place: string;

  constructor(value: unknown, place: string) {
    if (typeof value !== "object" || value === null || Array.isArray(value)) throw wrong(place, "is not an object", value);
    this.values = value as Values;
    this.place = place;
  }

  private at(key: string): string {
    return this.place === "" ? key : `${this.place}.${key}`;
  }

  /** Returns a finite number within bounds. */
  number(key: string, low: number, high: number): number {
    const value = this.values[key];
    if (typeof value !== "number" || !Number.isFinite(value) || value < low || value > high)
      throw wrong(this.at(key), `must be a number from ${low} to ${high}`, value);
    return value;
  }

  /** The same, or `absent` if there is no such key. */
  numberOr(key: string, low: number, high: number, absent: number): number {
    return this.values[key] === undefined ? absent : this.number(key, low, high);
  }

  /** Returns a number above zero. */
  step(key: string): number {
    const value = this.number(key, 0, MAX_VALUE);
    if (!(value > 0)) throw wrong(this.at(key), "must be above 0", value);
    return value;
  }

  integer(key: string, low: number, high: number): number {
    const value = this.number(key, low, high);
    if (!Number.isInteger(value)) throw wrong(this.at(key), "must be an integer", value);
    return value;
  }

  text(key: string, pattern: RegExp): string {
    const value = this.values[key];
    if (typeof value !== "string" || !pattern.test(value)) throw wrong(this.at(key), "is not valid", value);
    return value;
  }

  oneOf<T extends string>(key: string, choices: readonly T[]): T {
    const value = this.values[key];
    const found = choices.find((choice) => choice === value);
    if (found === undefined) throw wrong(this.at(key), `must be ${choices.join(" or ")}`, value);
    return found;
  }

  has(key: string): boolean {
    return this.values[key] !== undefined && this.values[key] !== null;
  }

  object(key: string): Reader {
    return new Reader(this.values[key], this.at(key));
  }

  list(key: string, low: number, high: number): Reader[] {
    const value = this.values[key];
    if (!Array.isArray(value) || value.length < low || value.length > high)
      throw wrong(this.at(key), `must be a list of ${low} to ${high} entries`, value);
    return value.map((item, i) => new Reader(item, `${this.at(key)}.${i}`));
  }

  vector(key: string): Vector {
    const value = this.values[key];
    if (
      !Array.isArray(value) ||
      value.length !== 3 ||
      !value.every((v) => typeof v === "number" && Math.abs(v) <= MAX_VALUE)
    )
      throw wrong(this.at(key), "must be three numbers", value);
    return value as unknown as Vector;
  }

  box(key: string): Box {
    const box = this.object(key);
    const [min, max] = [box.vector("min"), box.vector("max")];
    if (min.some((low, i) => low > max[i])) throw wrong(this.at(key), "has a minimum above its maximum", null);
    return { min, max };
  }

  file(key: string | null): FileEntry {
    const from = key === null ? this : this.object(key);
    return {
      path: from.text("path", PATH),
      bytes: from.integer("bytes", 1, MAX_FILE_BYTES),
      sha256: from.text("sha256", SHA256),
    };
  }

  video(key: string | null, frames: number, version: number): VideoEntry {
    const from = key === null ? this : this.object(key);
    if (version < 3) return { ...from.file(null), checks: [] };
    let least = 0;
    const checks = from.list("checks", 1, 2).map((entry, i): LumaCheck => {
      const picture = entry.integer("picture", least, i === 0 ? 0 : frames - 1);
      least = picture + 1;
      return { picture, crc32: entry.integer("crc32", 0, 2 ** 32 - 1) };
    });
    return { ...from.file(null), checks };
  }

  numbers(key: string, low: number, high: number, least: number, most: number): number[] {
    const value = this.values[key];
    if (!Array.isArray(value) || value.length < low || value.length > high)
      throw wrong(this.at(key), `must be a list of ${low} to ${high} numbers`, value);
    if (!value.every((item) => Number.isInteger(item) && (item as number) >= least && (item as number) <= most))
      throw wrong(this.at(key), `must be integers from ${least} to ${most}`, null);
    return value as number[];
  }
}

function wrong(place: string, what: string, value: unknown): StreamError {
  const found = value === null ? "" : `; found ${(value === undefined ? "nothing" : JSON.stringify(value)).slice(0, 80)}`;
  return new StreamError(`The stream's manifest is damaged: ${place} ${what}${found}.`);
}

/** Channels of the profile `motion`, in order: 10 + 3 (degree + 1)^2. */
export function channelNames(shDegree: number): string[] {
  const names = ["residual_x", "residual_y", "residual_z", "rotation_0", "rotation_1", "rotation_2"];
  names.push("log_scale_0", "log_scale_1", "log_scale_2", "opacity");
  for (let k = 0; k < (shDegree + 1) ** 2; k++) for (const part of ["y", "co", "cg"]) names.push(`sh_${k}_${part}`);
  return names;
}

/** Components of the profile `planes`, in order: 11 + 3 (degree + 1)^2. */
export function componentNames(shDegree: number): string[] {
  const names = ["mean_x", "mean_y", "mean_z"];
  for (let k = 0; k < (shDegree + 1) ** 2; k++) for (const color of "rgb") names.push(`sh_${k}_${color}`);
  names.push("opacity", "log_scale_0", "log_scale_1", "log_scale_2", "quat_w", "quat_x", "quat_y", "quat_z");
  return names;
}

/** Side of the smallest square that fits `splats` pixels, rounded up to a multiple of `multiple`. */
export function squareSide(splats: number, multiple: number): number {
  let side = multiple * Math.max(1, Math.floor(Math.sqrt(splats) / multiple));
  while (side * side < splats) side += multiple;
  return side;
}

function sameNames(found: readonly { readonly name: string }[], wanted: readonly string[]): boolean {
  return found.length === wanted.length && found.every((entry, i) => entry.name === wanted[i]);
}

function readMotion(group: Reader, common: GroupCommon, place: string, version: number): MotionGroup {
  const side: SideEntry = {
    ...group.file("side"),
    rawBytes: group.object("side").integer("raw_bytes", 1, MAX_SIDE_BYTES),
  };
  const video = group.video("video", common.frameCount, version);
  const positions = group.object("positions");
  const blocks = group.object("blocks");
  const result: MotionGroup = {
    ...common,
    profile: "motion",
    tile: group.integer("tile", 16, MAX_PICTURE),
    columns: group.integer("columns", 1, 64),
    rows: group.integer("rows", 1, 64),
    positions: { bits: positions.integer("bits", 1, 16), min: positions.vector("min"), step: positions.step("step") },
    blocks: {
      count: blocks.integer("count", 1, 32767),
      radius: blocks.step("radius"),
      step: blocks.step("step"),
      rotationStep: blocks.step("rotation_step"),
    },
    channels: group.list("channels", 1, 64).map((entry) => ({
      name: entry.text("name", /^[a-z0-9_]{1,20}$/),
      offset: entry.number("offset", -MAX_VALUE, MAX_VALUE),
      step: entry.step("step"),
    })),
    side,
    video,
    files: [side, video],
  };
  if (result.tile !== squareSide(result.splats, 16))
    throw wrong(`${place}.tile`, `does not fit ${result.splats} splats`, result.tile);
  if (!sameNames(result.channels, channelNames(result.shDegree)))
    throw wrong(`${place}.channels`, `do not match SH degree ${result.shDegree}`, null);
  if (result.columns * result.rows < result.channels.length)
    throw wrong(place, `has ${result.columns} x ${result.rows} tiles for ${result.channels.length} channels`, null);
  if (Math.max(result.columns, result.rows) * result.tile > MAX_PICTURE)
    throw wrong(place, `has a picture larger than ${MAX_PICTURE} pixels on a side`, null);
  if (result.blocks.count > result.splats)
    throw wrong(place, `has ${result.blocks.count} blocks for ${result.splats} splats`, null);
  if (result.positions.step * 2 ** result.positions.bits > 2 * MAX_VALUE)
    throw wrong(place, `has positions beyond ${MAX_VALUE}`, null);
  if (result.positions.step * 2 ** result.positions.bits > MAX_BLOCK_SPAN * result.blocks.radius)
    throw wrong(`${place}.blocks.radius`, "is less than a millionth of the positions' extent", result.blocks.radius);
  for (const { name, offset, step } of result.channels) {
    const [low, high] = valueBounds(name);
    if (offset - 128 * step < low || offset + 127 * step > high)
      throw wrong(place, `has values of ${name} beyond ${low} to ${high}`, null);
  }
  return result;
}

function readPlanes(group: Reader, common: GroupCommon, place: string, version: number): PlanesGroup {
  const components = group.list("components", 1, 64).map((entry): ComponentEntry => {
    const component = {
      name: entry.text("name", /^[a-z0-9_]{1,20}$/),
      min: entry.number("min", -MAX_VALUE, MAX_VALUE),
      max: entry.number("max", -MAX_VALUE, MAX_VALUE),
      planes: entry.list("planes", 1, 2).map((plane) => ({
        ...plane.video(null, common.frameCount, version),
        part: plane.oneOf("part", ["all", "high", "low", "low_mirrored"]),
      })),
    };
    const parts = component.planes.map((plane) => plane.part).join(" ");
    const allowed = component.name.startsWith("mean_") ? ["high low", "high low_mirrored"] : ["all"];
    if (component.min > component.max || component.max > valueBounds(component.name)[1] || !allowed.includes(parts))
      throw wrong(place, `has an invalid component ${component.name}`, null);
    return component;
  });
  const side = group.integer("side", 8, MAX_PICTURE);
  if (side !== squareSide(common.splats, 8)) throw wrong(`${place}.side`, `does not fit ${common.splats} splats`, side);
  if (!sameNames(components, componentNames(common.shDegree)))
    throw wrong(`${place}.components`, `do not match SH degree ${common.shDegree}`, null);
  return { ...common, profile: "planes", side, components, files: components.flatMap((entry) => [...entry.planes]) };
}

/** Metadata is optional: values that are not well-formed are ignored. */
function optional<T>(read: () => T): T | null {
  try {
    return read();
  } catch {
    return null;
  }
}

function readCamera(metadata: Values): Camera | null {
  return optional(() => {
    const camera = new Reader(metadata["suggested_camera"], "suggested_camera");
    const values = metadata["suggested_camera"] as Values;
    const matrix = (key: string, rows: number, columns: number): number[][] => {
      const value = values[key] as number[][];
      if (value.length !== rows || !value.every((row) => row.length === columns && row.every(Number.isFinite)))
        throw new StreamError(key);
      return value;
    };
    const K = matrix("K", 3, 3);
    if (!(K[0][0] > 0 && K[1][1] > 0)) throw new StreamError("K");
    return {
      width: camera.integer("width", 1, 1e6),
      height: camera.integer("height", 1, 1e6),
      K,
      worldToCamera: matrix("world_to_camera", 4, 4),
    };
  });
}

function readViewRange(metadata: Values): ViewRange | null {
  return optional(() => {
    const range = new Reader(metadata["view_range"], "view_range");
    const values = metadata["view_range"] as Values;
    const list = values["directions"] as unknown[];
    if (!Array.isArray(list) || list.length < 1 || list.length > MAX_DIRECTIONS) throw new StreamError("directions");
    const directions = list.map((value) => {
      const [x, y, z] = new Reader({ value }, "directions").vector("value");
      const length = Math.hypot(x, y, z);
      if (!(length > 0.5)) throw new StreamError("directions");
      return [x / length, y / length, z / length] as const;
    });
    const angle = range.number("angle", 0, 180);
    if (!(angle > 0)) throw new StreamError("angle");
    return { center: range.vector("center"), directions, angle };
  });
}

type Profile = "motion" | "planes";
type Content = Pick<Manifest, "frameCount" | "shDegree" | "renditions" | "spans" | "groups" | "pages" | "audio" | "totalBytes">;

/** One group in one rendition, of any version. */
function readGroup(
  entry: Reader,
  place: string,
  profile: Profile,
  version: number,
  index: number,
  firstFrame: number,
  frames: readonly [number, number],
  shDegree: number,
  maxSplats: number,
  rendition: string,
): Group {
  const common: GroupCommon = {
    rendition,
    index: entry.integer("index", index, index),
    firstFrame: entry.integer("first_frame", firstFrame, firstFrame),
    frameCount: entry.integer("frame_count", frames[0], frames[1]),
    splats: entry.integer("splats", 1, maxSplats),
    shDegree: entry.integer("sh_degree", shDegree, shDegree),
    dilation: entry.numberOr("dilation", MIN_DILATION, MAX_DILATION, DILATION),
    boundingBox: entry.box("bounding_box"),
    bytes: entry.integer("bytes", 1, Number.MAX_SAFE_INTEGER),
    files: [],
  };
  const group =
    profile === "motion" ? readMotion(entry, common, place, version) : readPlanes(entry, common, place, version);
  if (group.files.reduce((sum, file) => sum + file.bytes, 0) !== group.bytes)
    throw wrong(`${place}.bytes`, "is not the sum of its file sizes", group.bytes);
  return group;
}

/** The groups of versions 1 and 2. */
function readGroups(root: Reader, profile: Profile, version: number, bytes: number): Content {
  const shDegree = root.integer("sh_degree", 0, 3);
  const paths = new Set([MANIFEST_NAME]);
  let frame = 0;
  let files = 0;
  const groups = root.list("groups", 1, MAX_GROUPS).map((entry, number): Group => {
    const place = `groups.${number}`;
    const group = readGroup(
      entry, place, profile, version, number, frame, [1, MAX_GROUP_FRAMES], shDegree, MAX_SPLATS, "",
    );
    for (const file of group.files) {
      if (paths.has(file.path)) throw wrong(place, "uses the same path twice", file.path);
      paths.add(file.path);
    }
    frame += group.frameCount;
    files += group.bytes;
    return group;
  });
  return {
    frameCount: root.integer("frame_count", frame, Math.min(frame, MAX_FRAMES)),
    shDegree,
    renditions: [],
    spans: groups,
    groups: groups.map((group) => [group]),
    pages: [],
    audio: null,
    totalBytes: root.integer("total_bytes", files + bytes, files + bytes),
  };
}

function checkHashed(file: FileEntry, place: string): void {
  if (HASHED.exec(file.path)?.[1] !== file.sha256.slice(0, 32))
    throw wrong(place, "is not named by the file's SHA-256", file.path);
}

/** A group of version 3 in all its renditions. `frames`: what the manifest promises for a group in a page. */
function readRenditions(
  entry: Reader,
  place: string,
  profile: Profile,
  renditions: readonly Rendition[],
  index: number,
  firstFrame: number,
  frames: number | null,
): Group[] {
  entry.integer("index", index, index);
  entry.integer("first_frame", firstFrame, firstFrame);
  const count = entry.integer("frame_count", frames ?? 1, frames ?? MAX_GROUP_FRAMES);
  return entry.list("renditions", renditions.length, renditions.length).map((one, i) => {
    const { id, shDegree, splats } = renditions[i];
    const where = `${place}.renditions.${i}`;
    one.oneOf("id", [id]);
    const group = readGroup(one, where, profile, 3, index, firstFrame, [count, count], shDegree, splats, id);
    for (const file of group.files) checkHashed(file, where);
    return group;
  });
}

function readAudio(root: Reader, seconds: number): AudioEntry | null {
  if (!root.has("audio")) return null;
  const entry = root.object("audio");
  const file = { ...entry.file(null), bytes: entry.integer("bytes", 1, MAX_AUDIO_BYTES) };
  checkHashed(file, "audio");
  entry.oneOf("codec", ["aac"]);
  entry.integer("channels", 1, 2);
  const length = entry.integer("samples", 1, MAX_AUDIO_SAMPLES) / entry.integer("sample_rate", 8000, 96_000);
  const start = entry.number("start", 0, MAX_FRAMES);
  if (start + length > seconds + AUDIO_TOLERANCE)
    throw wrong("audio", `ends after the frames, which end at ${seconds.toFixed(3)} s`, start + length);
  return { ...file, start, length };
}

/** What version 3 has instead of the groups of version 2. */
function readLadder(root: Reader, profile: Profile, bytes: number, fps: number): Content {
  const renditions = root.list("renditions", 1, MAX_RENDITIONS).map(
    (entry): Rendition => ({
      id: entry.text("id", RENDITION),
      splats: entry.integer("splats", 1, MAX_SPLATS),
      shDegree: entry.integer("sh_degree", 0, 3),
      bytes: entry.integer("bytes", 1, Number.MAX_SAFE_INTEGER),
      bandwidth: entry.integer("bandwidth", 1, Number.MAX_SAFE_INTEGER),
    }),
  );
  if (new Set(renditions.map(({ id }) => id)).size < renditions.length) throw wrong("renditions", "has an id twice", null);
  const spans: Span[] = [];
  let frame = 0;
  const groups = root.list("groups", 1, MAX_GROUPS).map((entry, number) => {
    const found = readRenditions(entry, `groups.${number}`, profile, renditions, number, frame, null);
    spans.push({ firstFrame: frame, frameCount: found[0].frameCount });
    frame += found[0].frameCount;
    return found;
  });
  const pages = root.list("pages", 0, MAX_GROUPS).map((entry, number): PageEntry => {
    const page = {
      ...entry.file(null),
      bytes: entry.integer("bytes", 1, MAX_PAGE_BYTES),
      firstGroup: spans.length,
      firstFrame: frame,
      frames: entry.numbers("frames", 1, MAX_PAGE_GROUPS, 1, MAX_GROUP_FRAMES),
    };
    checkHashed(page, `pages.${number}`);
    for (const frameCount of page.frames) {
      spans.push({ firstFrame: frame, frameCount });
      frame += frameCount;
    }
    if (spans.length > MAX_GROUPS) throw wrong("pages", `have more than ${MAX_GROUPS} groups`, null);
    return page;
  });
  const files = new Map<string, number>();
  for (const group of groups) for (const { files: own } of group) for (const file of own) files.set(file.path, file.bytes);
  const frameCount = root.integer("frame_count", frame, Math.min(frame, MAX_FRAMES));
  const audio = readAudio(root, frameCount / fps);
  if (audio !== null) files.set(audio.path, audio.bytes);
  let total = bytes;
  for (const size of files.values()) total += size;
  const least = pages.length > 0 ? 1 : total;
  return {
    frameCount,
    shDegree: renditions[0].shDegree,
    renditions,
    spans,
    groups,
    pages,
    audio,
    // Pages are files of their own.
    totalBytes: root.integer("total_bytes", least, Number.MAX_SAFE_INTEGER),
  };
}

/**
 * Parses and validates a page of the index of a stream of version 3.
 *
 * @throws StreamError - it does not hold the groups that the manifest promises
 */
export function parsePage(text: string, page: PageEntry, manifest: Manifest): Group[][] {
  let head: unknown;
  try {
    head = JSON.parse(text);
  } catch {
    throw new StreamError(`${page.path} is damaged: it is not readable JSON.`);
  }
  const root = new Reader(head, page.path);
  root.oneOf("format", [PAGE_FORMAT]);
  let frame = page.firstFrame;
  return root.list("groups", page.frames.length, page.frames.length).map((entry, i) => {
    const place = `${page.path}.groups.${i}`;
    const index = page.firstGroup + i;
    const found = readRenditions(entry, place, manifest.profile, manifest.renditions, index, frame, page.frames[i]);
    frame += page.frames[i];
    return found;
  });
}

/**
 * Parses and validates a manifest. The checksum is verified elsewhere, since that requires crypto.subtle.
 *
 * @param text - the content of the file
 * @param bytes - its size in bytes
 * @throws StreamError - not a manifest, a newer version, or a value out of bounds
 */
export function parseManifest(text: string, bytes: number): Manifest {
  let head: unknown;
  try {
    head = JSON.parse(text);
  } catch {
    throw new StreamError("There is no stream at this address: its manifest is not readable JSON.");
  }
  if (typeof head !== "object" || head === null || (head as Values)["format"] !== FORMAT)
    throw new StreamError(`There is no stream at this address: the file is not the manifest of a ${FORMAT}.`);
  const values = head as Values;
  const found = values["version"];
  if (typeof found === "number" && found > NEWEST_VERSION)
    throw new StreamError(`The stream has format version ${found}, but this player supports versions up to ${NEWEST_VERSION}; update the player.`);
  const root = new Reader(head, "");
  const version = root.integer("version", 1, NEWEST_VERSION);
  const profile = root.oneOf("profile", version === 1 ? ["planes"] : ["motion", "planes"]);
  root.oneOf("scan", [profile === "motion" ? "morton" : "rows"]);
  const codecValues = root.object("codec");
  const codec = codecValues.oneOf("name", profile === "motion" ? ["h264", "hevc", "av1"] : ["h264"]);
  codecValues.oneOf("pixel_format", ["yuv420p"]);
  codecValues.oneOf("color_range", ["full"]);
  const fps = root.number("fps", 0, 1000);
  if (!(fps > 0)) throw wrong("fps", "must be above 0", fps);
  const content = version < 3 ? readGroups(root, profile, version, bytes) : readLadder(root, profile, bytes, fps);
  const metadata = (typeof values["metadata"] === "object" && values["metadata"] !== null ? values["metadata"] : {}) as Values;
  const extras = new Reader(metadata, "metadata");
  const background = optional(() => extras.vector("background"));
  const up = optional(() => extras.vector("up"));
  return {
    version,
    profile,
    fps,
    codec,
    boundingBox: root.box("bounding_box"),
    ...content,
    sha256: root.text("manifest_sha256", SHA256),
    camera: readCamera(metadata),
    up: up !== null && up.some((value) => value !== 0) ? up : null,
    background: background?.every((value) => value >= 0 && value <= 1) === true ? background : null,
    viewRange: readViewRange(metadata),
    live: version >= 3 && values["live"] === true,
    title: typeof metadata["title"] === "string" ? metadata["title"].slice(0, 200) : null,
  };
}

/** What a live stream's new manifest changed that may not change, or null. See docs/STREAM.md, "Live streams". */
export function whatChanged(old: Manifest, now: Manifest): string | null {
  for (const key of ["version", "profile", "fps", "codec"] as const) if (old[key] !== now[key]) return key;
  const ids = (manifest: Manifest): string => manifest.renditions.map(({ id }) => id).join();
  if (ids(old) !== ids(now)) return "renditions";
  if (!old.spans.every(({ frameCount }, i) => frameCount === now.spans[i]?.frameCount)) return "groups";
  const paths = (renditions: readonly Group[]): string => renditions.flatMap(({ files }) => files.map(({ path }) => path)).join();
  if (old.groups.some((group, i) => i < now.groups.length && paths(group) !== paths(now.groups[i]))) return "groups";
  return null;
}

/** The group that contains a frame, by bisection; `frame` must be within the stream. */
export function groupOfFrame(groups: readonly { readonly firstFrame: number }[], frame: number): number {
  let low = 0;
  let high = groups.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (groups[middle].firstFrame <= frame) low = middle;
    else high = middle - 1;
  }
  return low;
}
