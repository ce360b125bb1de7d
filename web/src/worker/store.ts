/** Cache of fetched groups: limited in size, fetched ahead of the playhead, one group at a time. */

import { StreamError } from "../stream/errors.ts";
import type { RateRule } from "../player/rate_rule.ts";
import type { GroupTable } from "../stream/group_table.ts";
import type { Group } from "../stream/manifest.ts";
import { type Source, sha256 } from "./http.ts";

export type Files = ReadonlyMap<string, Uint8Array<ArrayBuffer>>;

/** A group in the rendition that was chosen for it, and its files. */
export interface Fetched {
  readonly group: Group;
  readonly files: Files;
}

/** Picks one of a group's renditions; `rule` is null for streams with a single one. */
export interface Choice {
  readonly rule: RateRule | null;
  readonly fps: number;
  /** Whether this device can draw it. */
  readonly fits: (group: Group) => boolean;
}

/** Bytes kept in memory: played groups are kept as long as they fit, so that loops do not fetch again. */
const KEPT_BYTES = 192 << 20;
/** Maximum bytes fetched ahead of the playhead. */
const AHEAD_BYTES = 64 << 20;

export class GroupStore {
  private readonly groups: GroupTable;
  private readonly choice: Choice;
  private readonly source: Source;
  private readonly changed: () => void;
  private readonly files = new Map<number, Fetched>();
  private readonly fetching = new Map<number, Promise<Fetched>>();
  private readonly failed = new Map<number, StreamError>();
  private readonly stop = new AbortController();
  /** Number of bytes in memory. */
  bytes = 0;
  private playhead = 0;
  private loop = true;
  private busy = false;

  constructor(groups: GroupTable, choice: Choice, source: Source, changed: () => void) {
    this.groups = groups;
    this.choice = choice;
    this.source = source;
    this.changed = changed;
  }

  /** Groups in memory. */
  get present(): number[] {
    return [...this.files.keys()];
  }

  /** Clears failures, so that these groups are fetched again. */
  forgive(): void {
    this.failed.clear();
  }

  close(): void {
    this.stop.abort();
  }

  /** Sets the playback position; the groups that follow are fetched unless something more urgent is. */
  follow(group: number, loop: boolean): void {
    this.playhead = group;
    this.loop = loop;
    void this.fetchAhead();
  }

  /**
   * Returns a group and its verified files.
   *
   * @throws StreamError - a file is missing or does not match the manifest
   */
  get(group: number): Promise<Fetched> {
    const kept = this.files.get(group);
    if (kept !== undefined) {
      // Most recently used last.
      this.files.delete(group);
      this.files.set(group, kept);
      return Promise.resolve(kept);
    }
    const failed = this.failed.get(group);
    if (failed !== undefined) return Promise.reject(failed);
    let fetching = this.fetching.get(group);
    if (fetching === undefined) {
      fetching = this.fetch(group).finally(() => this.fetching.delete(group));
      this.fetching.set(group, fetching);
    }
    return fetching;
  }

  /** The rendition to fetch: what the rule chooses, or the best below it that this device can draw. */
  private async choose(index: number): Promise<Group> {
    const renditions = await this.groups.renditions(index);
    const { rule, fps, fits } = this.choice;
    const { spans } = this.groups;
    const ahead = spans[index].firstFrame - spans[this.playhead].firstFrame;
    const wanted = rule === null ? 0 : rule.choose(Math.max(ahead, 0) / fps);
    const found = fits(renditions[wanted])
      ? renditions[wanted]
      : renditions.filter(fits).sort((a, b) => b.bytes - a.bytes)[0];
    if ((found as Group | undefined) === undefined)
      throw new StreamError(`Group ${index} has larger pictures than this device's GPU supports.`);
    return found;
  }

  private async fetch(index: number): Promise<Fetched> {
    try {
      const group = await this.choose(index);
      const began = performance.now();
      const files = new Map<string, Uint8Array<ArrayBuffer>>();
      const contents = await inTurns(group.files, 6, async (file) => {
        const data = await this.source.read(file.path, file.bytes, this.stop.signal);
        const digest = await sha256(data);
        if (digest !== null && digest !== file.sha256)
          throw new StreamError(`${file.path} is damaged: its SHA-256 does not match the manifest.`);
        return data;
      });
      group.files.forEach((file, i) => files.set(file.path, contents[i]));
      this.choice.rule?.fetched(group.bytes, (performance.now() - began) / 1000);
      const fetched = { group, files };
      this.files.set(index, fetched);
      this.bytes += group.bytes;
      this.dropOldest(index);
      this.changed();
      return fetched;
    } catch (error) {
      if (error instanceof StreamError && !this.stop.signal.aborted) this.failed.set(index, error);
      throw error;
    }
  }

  private dropOldest(except: number): void {
    for (const [index, { group }] of this.files) {
      if (this.bytes <= KEPT_BYTES) return;
      if (index === except || index === this.playhead) continue;
      this.files.delete(index);
      this.bytes -= group.bytes;
    }
  }

  private async fetchAhead(): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    try {
      for (;;) {
        const next = this.nextToFetch();
        if (next === null || this.stop.signal.aborted) return;
        await this.get(next).catch(() => undefined); // reported when it is due to be played
      }
    } finally {
      this.busy = false;
    }
  }

  private nextToFetch(): number | null {
    let ahead = 0;
    let frames = 0;
    const most = (this.choice.rule?.target ?? Infinity) * this.choice.fps;
    for (let step = 0; step < this.groups.length; step++) {
      let index = this.playhead + step;
      if (index >= this.groups.length) {
        if (!this.loop) return null;
        index -= this.groups.length;
      }
      ahead += this.groups.bytes(index);
      if (step > 1 && (ahead > AHEAD_BYTES || frames > most)) return null;
      frames += this.groups.spans[index].frameCount;
      if (!this.files.has(index) && !this.failed.has(index)) return index;
    }
    return null;
  }
}

/** Maps items with an asynchronous function, at most `lanes` at a time; results are in order. */
async function inTurns<T, R>(items: readonly T[], lanes: number, map: (item: T) => Promise<R>): Promise<R[]> {
  const results = new Array<R>(items.length);
  let next = 0;
  await Promise.all(
    Array.from({ length: Math.min(lanes, items.length) }, async () => {
      while (next < items.length) {
        const at = next++;
        results[at] = await map(items[at]);
      }
    }),
  );
  return results;
}
