/** Groups that are ready to be played: their side file is parsed, and their video is open in a decoder that works here. */

import { messageOf, StreamError } from "../stream/errors.ts";
import { pictureSize } from "../stream/layout.ts";
import type { Rendition } from "../stream/manifest.ts";
import { MotionTables } from "../stream/motion.ts";
import { readVideoIndex, type Sample, type VideoIndex } from "../stream/mp4.ts";
import { inflate, parseSideFile } from "../stream/side_file.ts";
import type { Arriving } from "./arriving.ts";
import type { DecodePath, Report } from "./messages.ts";
import { arrivingPictures, checkedPictures, type PictureSource, WebCodecsPictures } from "./pictures.ts";
import type { Pool } from "./pool.ts";
import type { Fetched, Files, GroupStore } from "./store.ts";
import { VideoElementPictures } from "./video_pictures.ts";

const KEPT = 3; // number of groups kept

export interface Prepared {
  readonly group: Rendition;
  readonly tables: MotionTables;
  readonly pictures: PictureSource;
  /** All files are there and verified; until then, there may be the first picture only. */
  readonly complete: Promise<void>;
  readonly milliseconds: number;
}

export class PreparedGroups {
  path: DecodePath;
  private readonly mayChangePath: boolean;
  private readonly groups = new Map<number, Promise<Prepared>>();

  constructor(
    private readonly store: GroupStore,
    private readonly report: Report,
    private readonly pool: Pool,
    path: DecodePath | "auto",
  ) {
    this.mayChangePath = path === "auto";
    this.path = path !== "auto" ? path : "VideoDecoder" in self ? "webcodecs" : "video";
  }

  has(index: number): boolean {
    return this.groups.has(index);
  }

  /** @throws StreamError - the group cannot be fetched, or is damaged */
  get(index: number): Promise<Prepared> {
    let prepared = this.groups.get(index);
    if (prepared === undefined) {
      prepared = this.read(index);
      prepared.catch(() => undefined);
    }
    // Most recently used last.
    this.groups.delete(index);
    this.groups.set(index, prepared);
    for (const old of [...this.groups.keys()].slice(0, -KEPT)) this.drop(old);
    return prepared;
  }

  drop(index: number): void {
    const prepared = this.groups.get(index);
    this.groups.delete(index);
    prepared?.then(({ pictures }) => pictures.close(), () => undefined);
  }

  dropAll(): void {
    for (const index of [...this.groups.keys()]) this.drop(index);
  }

  /** Switches to the next decode path, if there is one left. */
  changePath(): boolean {
    if (!this.mayChangePath) return false;
    if (this.path === "webcodecs") this.path = "webcodecs-software";
    else if (this.path === "webcodecs-software") this.path = "video";
    else return false;
    this.dropAll();
    return true;
  }

  private async read(index: number): Promise<Prepared> {
    return this.prepare(await this.store.get(index));
  }

  /** Opens a group whose files are there, or arriving. StreamError: it is damaged. */
  async prepare({ group, files, complete }: Fetched): Promise<Prepared> {
    const began = performance.now();
    const side = files.get(group.side.path)!;
    // While this thread reads the side file, others decompress and decode.
    const inflating = side.whole().then((data) => inflate(data, group.side.raw_bytes));
    inflating.catch(() => undefined);
    const pictures = await this.openVideo(files, group);
    if (this.path !== "video") pictures.warm();
    try {
      const tables = new MotionTables(group, parseSideFile(await inflating, group));
      return { group, tables, pictures, complete, milliseconds: performance.now() - began };
    } catch (error) {
      pictures.close();
      throw side.complete ? new StreamError(`${group.side.path} is damaged: ${messageOf(error)}.`) : error;
    }
  }

  private async openVideo(files: Files, group: Rendition): Promise<PictureSource> {
    const { path, checks } = group.video;
    const file = files.get(path)!;
    const size = pictureSize(group);
    const { config: stored, samples } = await checkedIndex(file, path, size, group.frame_count);
    let pictures: PictureSource;
    if (this.path === "video") pictures = new VideoElementPictures(this.report, await file.whole(), samples, size, this.pool);
    else {
      const hardwareAcceleration = this.path === "webcodecs" ? "no-preference" : "prefer-software";
      const config = { ...stored, optimizeForLatency: true, hardwareAcceleration } as const;
      const decode = (data: Uint8Array, some: readonly Sample[]): PictureSource =>
        new WebCodecsPictures(config, data, some, size, path, this.pool);
      const whole = async (): Promise<PictureSource> => decode(await file.whole(), samples);
      const [first] = samples;
      pictures = file.complete
        ? await whole()
        : arrivingPictures(decode(await file.prefix(first.offset + first.bytes), [first]), whole);
    }
    return checkedPictures(pictures, checks, path, this.pool);
  }
}

/** The index of a video file, before the rest of it has arrived. `name`: for messages. StreamError: not an MP4 file with one
 * H.264 video of that size and length. */
async function checkedIndex(
  file: Arriving,
  name: string,
  size: readonly [number, number],
  frames: number,
): Promise<VideoIndex> {
  try {
    const index = await readVideoIndex((count) => file.prefix(count), file.bytes, frames);
    const { codedWidth, codedHeight } = index.config;
    if (codedWidth !== size[0] || codedHeight !== size[1])
      throw new StreamError(`it has pictures of ${codedWidth}x${codedHeight}, but the manifest specifies ${size[0]}x${size[1]}`);
    if (index.samples.length < frames)
      throw new StreamError(`it has ${index.samples.length} frames, but the manifest specifies ${frames}`);
    return index;
  } catch (error) {
    if (file.failure !== null) throw error;
    throw new StreamError(`${name} cannot be read: ${messageOf(error)}.`);
  }
}
