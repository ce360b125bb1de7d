/** The splats behind the performer: fetched and decoded once, in parts, of which the coarsest comes first. */

import { messageOf } from "../stream/errors.ts";
import { filesOf, type Rendition } from "../stream/manifest.ts";
import { SortedSet } from "../stream/sort.ts";
import { Arriving } from "./arriving.ts";
import type { Report, SplatArrays } from "./messages.ts";
import type { Pool } from "./pool.ts";
import type { PreparedGroups } from "./prepared_groups.ts";
import { readChecked } from "./source.ts";
import { splatsOf } from "./splats.ts";
import type { StreamFiles } from "./stream_files.ts";

/** The order of the arrays, and the numbers of a splat of SH degree 0. */
const ORDER = ["means", "quats", "scales", "opacities", "sh"] as const;
const NUMBERS = 14;

export class SetOfStream {
  shown = false;
  /** What has arrived. */
  private sorted: SortedSet | null = null;
  private brought = ""; // the files that were, or are being, fetched

  constructor(
    private readonly files: StreamFiles,
    private readonly groups: PreparedGroups,
    private readonly report: Report,
    private readonly pool: Pool,
    private readonly signal: AbortSignal,
  ) {}

  /** For orders; null while there is nothing, or it is not shown. */
  get visible(): SortedSet | null {
    return this.shown ? this.sorted : null;
  }

  /** Fetches the set of the manifest, unless that has been done or it is not shown. A failure is a notice to the viewer. */
  async bring(): Promise<void> {
    const { set } = this.files.manifest;
    const wanted = set.map(({ video }) => video.path).join();
    if (!this.shown || wanted === this.brought) return;
    this.brought = wanted;
    const parts: SplatArrays[] = [];
    try {
      for (const part of set) {
        parts.push(await this.read(part));
        if (this.signal.aborted || wanted !== this.brought) return;
        const arrays = ORDER.flatMap((name) => parts.map((one) => one[name]));
        const splats = new Float32Array(arrays.reduce((size, { length }) => size + length, 0));
        let at = 0;
        for (const array of arrays) {
          splats.set(array, at);
          at += array.length;
        }
        const count = splats.length / NUMBERS;
        this.sorted = new SortedSet(splats.subarray(0, 3 * count));
        this.report("set", { splats, count, dilation: part.dilation });
      }
    } catch (error) {
      if (!this.signal.aborted) this.report("notice", `The stream plays without its set: ${messageOf(error)}`);
    }
  }

  private async read(part: Rendition): Promise<SplatArrays> {
    const { source } = this.files;
    const entries = filesOf(part);
    const files = new Map(entries.map(({ path, bytes }) => [path, new Arriving(bytes)] as const));
    for (const entry of entries) files.get(entry.path)!.finish(await readChecked(source, entry, this.signal));
    const { tables, pictures } = await this.groups.prepare({ group: part, files, complete: Promise.resolve() });
    try {
      const { data: luma } = await pictures.get(0);
      return splatsOf(tables, 0, luma, this.pool);
    } finally {
      pictures.close();
    }
  }
}
