/** Cache of fetched groups: limited in size, fetched ahead of the playhead, one group at a time. */

import { StreamError } from "../stream/errors.ts";
import { pictureSize } from "../stream/layout.ts";
import { filesOf, type Rendition } from "../stream/manifest.ts";
import { Arriving } from "./arriving.ts";
import type { RateRule } from "./rate_rule.ts";
import { readChecked } from "./source.ts";
import type { StreamFiles } from "./stream_files.ts";

export type Files = ReadonlyMap<string, Arriving>;

/** A group in the rendition that was chosen for it, and its files while they arrive. */
export interface Fetched {
  readonly group: Rendition;
  readonly files: Files;
  /** All files are there and verified. */
  readonly complete: Promise<void>;
}

/** Bytes kept in memory: played groups are kept as long as they fit, so that loops do not fetch again. */
const KEPT_BYTES = 192 << 20;
const AHEAD_BYTES = 64 << 20; // maximum bytes fetched ahead of the playhead, at the rate of the largest group
const LANES = 6; // files that are fetched at a time

export class GroupStore {
  /** The group of the last requested frame, and whether the playhead moves. */
  playhead = 0;
  playing = false;
  /** Whether the first group follows the last one. */
  loop = true;
  /** Groups that this device gets no better than they are, with the rendition that was wanted. */
  private readonly settled = new Map<number, number>();
  /** Groups in memory. */
  readonly files = new Map<number, Fetched>();
  private readonly fetching = new Map<number, Promise<Fetched>>();
  private readonly failed = new Map<number, Error>();
  private bytes = 0; // number of bytes in memory
  private busy = false;
  private begun = false;

  /** `rule`: chooses one of a group's renditions; null for streams with a single one, and where one was chosen: `fixed`.
   * `maxTexture`: largest side of a picture that this device can draw. `changed`: called after a group was fetched.
   * `improved`: called after a group was fetched again in a better rendition. */
  constructor(
    private readonly stream: StreamFiles,
    private readonly rule: RateRule | null,
    private readonly fixed: number,
    private readonly maxTexture: number,
    private readonly changed: () => void,
    private readonly improved: (group: number) => void,
    private readonly signal: AbortSignal,
  ) {}

  /** Frames of a group were shown, or dropped since decoding was late. */
  played(group: number, shown: number, dropped: number): void {
    const rendition = this.renditionOf(group);
    if (rendition >= 0) this.rule?.played(rendition, shown, dropped);
  }

  /** Position of the rendition that a group is in memory in; -1 if it is not. */
  private renditionOf(group: number): number {
    return this.stream.manifest.renditions.findIndex(({ id }) => id === this.files.get(group)?.group.id);
  }

  /** Whether a group is in memory, or cannot be. */
  isDecided(group: number): boolean {
    return this.files.has(group) || this.failed.has(group);
  }

  /** The group `step` after the playhead; null at the end. Looping begins when a live stream is complete. */
  after(step: number): number | null {
    const { spans, live } = this.stream.manifest;
    const index = this.playhead + step;
    return index < spans.length ? index : this.loop && !live ? index % spans.length : null;
  }

  /** A group, whose files may still be arriving. StreamError: its page of the index is damaged, this device cannot draw it,
   * or it has failed before. */
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
      fetching = this.choose(group, null).then((rendition) => this.fetch(group, rendition));
      this.fetching.set(group, fetching);
      fetching.then(({ complete }) => complete).catch((error: unknown) => {
        // Whatever it was: what is not noted would be asked for again at once.
        if (!this.signal.aborted) this.failed.set(group, error as Error);
      }).finally(() => this.fetching.delete(group));
    }
    return fetching;
  }

  /** The rendition to fetch: what the rule chooses, or the best below it that this device can draw. */
  private async choose(index: number, better: number | null): Promise<Rendition> {
    const renditions = await this.stream.renditions(index);
    const { fps, spans } = this.stream.manifest;
    const ahead = spans[index].firstFrame - spans[this.playhead].firstFrame;
    const wanted = better ?? this.rule?.choose(Math.max(ahead, 0) / fps) ?? this.fixed;
    const fits = (group: Rendition): boolean => Math.max(...pictureSize(group)) <= this.maxTexture;
    const found = fits(renditions[wanted])
      ? renditions[wanted]
      : renditions.filter(fits).sort((a, b) => b.bytes - a.bytes)[0];
    if ((found as Rendition | undefined) === undefined)
      throw new StreamError(
        `Pictures of group ${index} are ${pictureSize(renditions[0]).join("x")}, but this device's GPU supports at most ${this.maxTexture} pixels on a side.`,
      );
    return found;
  }

  private fetch(index: number, group: Rendition): Fetched {
    const began = performance.now();
    const entries = filesOf(group);
    const files = new Map(entries.map(({ path, bytes }) => [path, new Arriving(bytes)] as const));
    const waiting = entries.values();
    const lane = async (): Promise<void> => {
      for (const file of waiting) {
        const arriving = files.get(file.path)!;
        arriving.finish(await readChecked(this.stream.source, file, this.signal, arriving.arrived));
      }
    };
    const reading = this.stream.sameBake(() => Promise.all(Array.from({ length: LANES }, lane)));
    const complete = reading.then(
      () => {
        const early = entries.map(({ path }) => this.stream.source.early?.(path) ?? 0);
        this.rule?.fetched(group.bytes, Math.max(performance.now() - began, ...early) / 1000);
        this.bytes += group.bytes - (this.files.get(index)?.group.bytes ?? 0);
        this.files.set(index, fetched);
        this.dropOldest(index);
        this.changed();
      },
      (error: unknown) => {
        for (const arriving of files.values()) arriving.fail(error as Error);
        throw error;
      },
    );
    complete.catch(() => undefined);
    const fetched = { group, files, complete };
    return fetched;
  }

  /** Fetches a group again in a better rendition; a failure leaves it as it is. `wanted`: position of the rendition. */
  private async improve(index: number, wanted: number): Promise<void> {
    try {
      const group = await this.choose(index, wanted);
      const kept = this.files.get(index)?.group;
      if (kept === undefined) return;
      if (group.bytes <= kept.bytes) {
        this.settled.set(index, wanted);
        return;
      }
      await this.fetch(index, group).complete;
      this.improved(index);
    } catch {
      this.settled.set(index, wanted);
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

  /** There is an image to look at, so that other groups may be fetched, too. */
  beginAhead(): void {
    this.begun = true;
    void this.fetchAhead();
  }

  /** Fetches what follows the playhead, unless something more urgent is fetched. */
  async fetchAhead(): Promise<void> {
    if (this.busy || !this.begun) return;
    this.busy = true;
    try {
      for (;;) {
        if (this.signal.aborted || this.stream.replaced) return;
        const next = this.nextToFetch();
        if (next === null) {
          const better = this.nextToImprove();
          if (better === null) return;
          await this.improve(...better);
        } else {
          // What fails is reported when it is due to be played.
          await this.get(next).then(({ complete }) => complete).catch(() => undefined);
        }
      }
    } finally {
      this.busy = false;
    }
  }

  private nextToFetch(): number | null {
    let frames = 0;
    const { fps, renditions, spans } = this.stream.manifest;
    const most = Math.min(this.rule?.target ?? Infinity, (8 * AHEAD_BYTES) / renditions[0].bandwidth) * fps;
    for (let step = 0; step < spans.length; step++) {
      const index = this.after(step);
      if (index === null || (step > 1 && frames > most)) return null;
      frames += spans[index].frameCount;
      if (!this.files.has(index) && !this.failed.has(index)) return index;
    }
    return null;
  }

  /** Once enough is fetched: a group that playback began with in a low rendition, and the rendition for it. While paused, the
   * group on the screen in the best one; in a loop that is in memory as a whole, every group in the best one; else groups
   * that are not due soon, in what the connection sustains. */
  private nextToImprove(): readonly [group: number, rendition: number] | null {
    const { rule } = this;
    const { renditions, fps, spans } = this.stream.manifest;
    if (rule === null || savesData()) return null;
    const improvable = (index: number, wanted: number): boolean => {
      const kept = this.renditionOf(index);
      return kept >= 0 && renditions[kept].bandwidth < renditions[wanted].bandwidth && this.settled.get(index) !== wanted;
    };
    const best = rule.best();
    if (!this.playing) return improvable(this.playhead, best) ? [this.playhead, best] : null;
    const whole = this.after(spans.length) !== null && this.files.size === spans.length;
    const wanted = whole ? best : rule.affordable();
    let frames = 0;
    for (let step = 1; step < spans.length; step++) {
      const group = this.after(step);
      if (group === null) return null;
      if (step > 1 && improvable(group, wanted)) return [group, wanted];
      frames += spans[group].frameCount;
      if (!whole && frames > rule.target * fps) return null;
    }
    return null;
  }
}

/** Whether the user asked the browser to save data. */
function savesData(): boolean {
  return (navigator as { readonly connection?: { readonly saveData?: boolean } }).connection?.saveData === true;
}
