/** The groups of a stream: those in the manifest, and those in pages, which are read when they are needed. */

import { type Group, type Manifest, type PageEntry, type Span } from "./manifest.ts";

export class GroupTable {
  readonly spans: readonly Span[];
  private readonly inline: readonly (readonly Group[])[];
  private readonly pages: readonly PageEntry[];
  private readonly readPage: (page: PageEntry) => Promise<readonly (readonly Group[])[]>;
  private readonly read = new Map<PageEntry, Promise<readonly (readonly Group[])[]>>();
  private readonly sizes = new Map<number, number>();
  private readonly estimate: (span: Span) => number;

  /** @param readPage - fetches, verifies and parses a page */
  constructor(manifest: Manifest, readPage: (page: PageEntry) => Promise<readonly (readonly Group[])[]>) {
    this.spans = manifest.spans;
    this.inline = manifest.groups;
    this.pages = manifest.pages;
    this.readPage = readPage;
    const rate = manifest.renditions[0]?.bandwidth ?? 0;
    this.estimate = ({ frameCount }): number => (rate * frameCount) / manifest.fps / 8;
    this.inline.forEach((renditions, index) => this.sizes.set(index, renditions[0].bytes));
  }

  get length(): number {
    return this.spans.length;
  }

  /** Bytes of a group in its best rendition; an upper estimate where its page was not read. */
  bytes(index: number): number {
    return this.sizes.get(index) ?? this.estimate(this.spans[index]);
  }

  /**
   * A group in all its renditions.
   *
   * @throws StreamError - its page is missing or damaged
   */
  async renditions(index: number): Promise<readonly Group[]> {
    if (index < this.inline.length) return this.inline[index];
    const page = this.pages.find(({ firstGroup, frames }) => index < firstGroup + frames.length)!;
    let reading = this.read.get(page);
    if (reading === undefined) {
      reading = this.readPage(page);
      this.read.set(page, reading);
      reading.then(
        (groups) => {
          groups.forEach((renditions, i) => this.sizes.set(page.firstGroup + i, renditions[0].bytes));
        },
        () => this.read.delete(page),
      );
    }
    return (await reading)[index - page.firstGroup];
  }
}
