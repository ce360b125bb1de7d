/** The manifest. It is checked against docs/stream.schema.json, and then for what a schema cannot say (docs/STREAM.md, "What
 * a reader must refuse"). Values keep their names in the file. */

import { definitions } from "stream-schema";
import { StreamError } from "./errors.ts";
import { check, wrong } from "./json_schema.ts";
import { channelNames, tileSide, valueBounds } from "./layout.ts";
import type * as stored from "./manifest_types.ts";
import { MAX_VALUE, type Metadata, readMetadata } from "./metadata.ts";

const FORMAT = "v3studio-stream";
export const MANIFEST_NAME = "manifest.json";
export const MAX_MANIFEST_BYTES = 64 << 20;
/** Files are named by the first digits of their SHA-256. */
export const HASHED = /^files\/([0-9a-f]{32})\.[a-z0-9]{1,8}$/;

const MAX_SPLATS = 4 << 20;
const MAX_GROUPS = 1_000_000;
const MAX_PICTURE = 16384; // pixels on a side
const MAX_BLOCK_SPAN = 1e6; // largest extent of the keyframe's lattice in units of the blocks' radius
const AUDIO_TOLERANCE = 0.1; // seconds by which sound may be longer than the frames

export type { AudioEntry, GroupEntry, LumaCheck, Rendition, VideoEntry } from "./manifest_types.ts";

/** A file of the stream; `path` is relative to the manifest. */
export type FileEntry = Pick<stored.VideoEntry, "path" | "bytes" | "sha256">;

/** A group's frames. */
export interface Span {
  readonly firstFrame: number;
  readonly frameCount: number;
}

/** A page of the index: a file with groups `firstGroup` and following. */
export interface IndexPage extends stored.PageEntry {
  readonly firstGroup: number;
  readonly firstFrame: number;
}

export interface Manifest extends Omit<stored.Manifest, "pages" | "metadata"> {
  readonly pages: readonly IndexPage[];
  readonly metadata: Metadata;
  /** All groups, also those in pages. */
  readonly spans: readonly Span[];
}

/** A rendition's files in the order in which a player needs them. */
export const filesOf = ({ side, video }: Pick<stored.Rendition, "side" | "video">): readonly FileEntry[] => [side, video];

function parseJson(text: string, problem: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    throw new StreamError(problem);
  }
}

/** Parses and validates a manifest. The checksum is verified elsewhere, since that requires crypto.subtle. `text`: the
 * content of the file. `bytes`: its size in bytes. StreamError: not a manifest, another version, or a value out of bounds. */
export function parseManifest(text: string, bytes: number): Manifest {
  const head = parseJson(text, "There is no stream at this address: its manifest is not readable JSON.");
  const { format, version } = (typeof head === "object" && head !== null ? head : {}) as Record<string, unknown>;
  if (format !== FORMAT)
    throw new StreamError(`There is no stream at this address: the file is not the manifest of a ${FORMAT}.`);
  const known = definitions["Manifest"].properties!["version"].const;
  if (version !== known)
    throw new StreamError(`The stream has format version ${String(version).slice(0, 20)}; this player plays version ${known}.`);
  check(head, definitions["Manifest"], definitions, "");
  const manifest = head as stored.Manifest;
  checkBox(manifest.bounding_box, "bounding_box");
  const ids = new Set(manifest.renditions.map(({ id }) => id));
  if (ids.size < manifest.renditions.length) throw wrong("renditions", "has an id twice");
  const frames = checkGroups(manifest.groups, manifest, 0, 0, "groups");
  const spans: Span[] = manifest.groups.map((group) => ({ firstFrame: group.first_frame, frameCount: group.frame_count }));
  const pages = indexPages(manifest, spans, frames);
  const last = spans[spans.length - 1];
  const count = last.firstFrame + last.frameCount;
  if (manifest.frame_count !== count) throw wrong("frame_count", `must be ${count}, as many as the groups have`, manifest.frame_count);
  manifest.set.forEach((part, i) => checkSetPart(part, i));
  if (manifest.set.reduce((total, { splats }) => total + splats, 0) > MAX_SPLATS) throw wrong("set", `has more than ${MAX_SPLATS} splats`);
  checkAudio(manifest);
  checkTotal(manifest, bytes);
  return { ...manifest, pages, spans, metadata: readMetadata(manifest.metadata ?? {}) };
}

/** Parses and validates a page of the index. StreamError: it does not hold the groups that the manifest promises. */
export function parsePage(text: string, page: IndexPage, manifest: Manifest): readonly stored.GroupEntry[] {
  const head = parseJson(text, `${page.path} is damaged: it is not readable JSON.`);
  check(head, definitions["Page"], definitions, page.path);
  const { groups } = head as stored.Page;
  if (groups.length !== page.frames.length) throw wrong(`${page.path}.groups`, `must be ${page.frames.length}`, groups.length);
  groups.forEach(({ frame_count: count }, i) => {
    if (count !== page.frames[i]) throw wrong(`${page.path}.groups.${i}.frame_count`, `must be ${page.frames[i]}`, count);
  });
  checkGroups(groups, manifest, page.firstGroup, page.firstFrame, `${page.path}.groups`);
  return groups;
}

/** Adds the groups of the pages to `spans`. */
function indexPages(manifest: stored.Manifest, spans: Span[], firstFrame: number): IndexPage[] {
  let frame = firstFrame;
  return manifest.pages.map((entry, number) => {
    checkFile(entry, `pages.${number}`);
    const page = { ...entry, firstGroup: spans.length, firstFrame: frame };
    for (const frameCount of entry.frames) {
      spans.push({ firstFrame: frame, frameCount });
      frame += frameCount;
    }
    if (spans.length > MAX_GROUPS) throw wrong("pages", `have more than ${MAX_GROUPS} groups`);
    return page;
  });
}

/** Checks groups that begin with group `number` and a frame; returns the frame after them. */
function checkGroups(
  groups: readonly stored.GroupEntry[],
  { renditions }: Pick<Manifest, "renditions">,
  number: number,
  frame: number,
  place: string,
): number {
  for (const [i, group] of groups.entries()) {
    if (group.index !== number) throw wrong(`${place}.${i}.index`, `must be ${number}`, group.index);
    if (group.first_frame !== frame) throw wrong(`${place}.${i}.first_frame`, `must be ${frame}`, group.first_frame);
    if (group.renditions.length !== renditions.length)
      throw wrong(`${place}.${i}.renditions`, `must be ${renditions.length}`, group.renditions.length);
    group.renditions.forEach((one, k) => {
      const where = `${place}.${i}.renditions.${k}`;
      for (const key of ["index", "first_frame", "frame_count"] as const)
        if (one[key] !== group[key]) throw wrong(`${where}.${key}`, `must be ${group[key]}`, one[key]);
      for (const key of ["id", "sh_degree"] as const)
        if (one[key] !== renditions[k][key]) throw wrong(`${where}.${key}`, `must be ${renditions[k][key]}`, one[key]);
      if (one.splats > renditions[k].splats) throw wrong(`${where}.splats`, `must be at most ${renditions[k].splats}`, one.splats);
      checkRendition(one, where);
    });
    number += 1;
    frame += group.frame_count;
  }
  return frame;
}

/** Parts of the set are groups of one frame, whose color is the same from all sides. */
function checkSetPart(part: stored.Rendition, index: number): void {
  for (const [key, wanted] of [["index", index], ["first_frame", 0], ["frame_count", 1], ["sh_degree", 0]] as const)
    if (part[key] !== wanted) throw wrong(`set.${index}.${key}`, `must be ${wanted}`, part[key]);
  checkRendition(part, `set.${index}`);
}

function checkRendition(one: stored.Rendition, place: string): void {
  checkBox(one.bounding_box, `${place}.bounding_box`);
  const sum = filesOf(one).reduce((total, file) => total + file.bytes, 0);
  if (one.bytes !== sum) throw wrong(`${place}.bytes`, "is not the sum of its file sizes", one.bytes);
  checkFile(one.side, `${place}.side`);
  checkFile(one.video, `${place}.video`);
  checkLumaChecks(one.video, one.frame_count, `${place}.video`);
  checkTables(one, place);
}

function checkFile({ path, sha256 }: FileEntry, place: string): void {
  if (HASHED.exec(path)?.[1] !== sha256.slice(0, 32)) throw wrong(`${place}.path`, "is not named by the file's SHA-256", path);
}

function checkBox({ min, max }: stored.Box, place: string): void {
  if (min.some((low, i) => low > max[i])) throw wrong(place, "has a minimum above its maximum");
}

/** The first check is of the first image, another one of a later image. */
function checkLumaChecks({ checks }: Pick<stored.VideoEntry, "checks">, frames: number, place: string): void {
  checks.forEach(({ picture }, i) => {
    const fits = i === 0 ? picture === 0 : picture > checks[i - 1].picture && picture < frames;
    if (!fits) throw wrong(`${place}.checks.${i}.picture`, `is not one of ${frames} pictures in order, from 0 on`, picture);
  });
}

function checkTables(one: stored.Rendition, place: string): void {
  const { tile, columns, rows, channels, blocks, positions, splats } = one;
  if (tile !== tileSide(splats)) throw wrong(`${place}.tile`, `does not fit ${splats} splats`, tile);
  const names = channelNames(one.sh_degree);
  if (channels.length !== names.length || channels.some(({ name }, i) => name !== names[i]))
    throw wrong(`${place}.channels`, `do not match SH degree ${one.sh_degree}`);
  if (columns * rows < channels.length) throw wrong(place, `has ${columns} x ${rows} tiles for ${channels.length} channels`);
  if (Math.max(columns, rows) * tile > MAX_PICTURE) throw wrong(place, `has a picture larger than ${MAX_PICTURE} pixels on a side`);
  if (blocks.count > splats) throw wrong(place, `has ${blocks.count} blocks for ${splats} splats`);
  const extent = positions.step * 2 ** positions.bits;
  if (extent > 2 * MAX_VALUE) throw wrong(place, `has positions beyond ${MAX_VALUE}`);
  if (extent > MAX_BLOCK_SPAN * blocks.radius)
    throw wrong(`${place}.blocks.radius`, "is less than a millionth of the positions' extent", blocks.radius);
  for (const { name, offset, step } of channels) {
    const [low, high] = valueBounds(name);
    if (offset - 128 * step < low || offset + 127 * step > high)
      throw wrong(place, `has values of ${name} beyond ${low} to ${high}`);
  }
}

function checkAudio({ audio, frame_count: frames, fps }: stored.Manifest): void {
  if (audio === null) return;
  checkFile(audio, "audio");
  const end = audio.start + audio.samples / audio.sample_rate;
  if (end > frames / fps + AUDIO_TOLERANCE)
    throw wrong("audio", `ends after the frames, which end at ${(frames / fps).toFixed(3)} s`, end);
}

/** `total_bytes` counts each file once, and the manifest; the sizes of files in pages are not known here. */
function checkTotal(manifest: stored.Manifest, bytes: number): void {
  const sizes = new Map<string, number>();
  for (const { renditions } of manifest.groups)
    for (const file of renditions.flatMap(filesOf)) sizes.set(file.path, file.bytes);
  for (const file of manifest.set.flatMap(filesOf)) sizes.set(file.path, file.bytes);
  if (manifest.audio !== null) sizes.set(manifest.audio.path, manifest.audio.bytes);
  const known = [...sizes.values()].reduce((total, size) => total + size, bytes);
  if (manifest.pages.length === 0 && manifest.total_bytes < known)
    throw wrong("total_bytes", `must be at least ${known}`, manifest.total_bytes);
}

/** Whether a live stream's new manifest only adds groups (docs/STREAM.md, "Live streams"). */
export function onlyGrows(old: Manifest, now: Manifest): boolean {
  const head = ({ fps, renditions }: Manifest): string => [fps, ...renditions.map(({ id }) => id)].join();
  const paths = ({ renditions }: stored.GroupEntry): string => renditions.flatMap((one) => filesOf(one).map(({ path }) => path)).join();
  return head(old) === head(now) &&
    old.spans.every(({ frameCount }, i) => frameCount === now.spans[i]?.frameCount) &&
    old.groups.every((group, i) => i >= now.groups.length || paths(group) === paths(now.groups[i]));
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
