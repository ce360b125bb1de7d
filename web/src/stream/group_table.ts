/** The groups of a stream: those in the manifest, and those in pages, which are read when they are needed. */

import type { GroupEntry, IndexPage, Manifest, Rendition, Span } from "./manifest.ts";

export class GroupTable {
  spans: readonly Span[] = [];
  private inline: readonly GroupEntry[] = [];
  private pages: readonly IndexPage[] = [];
  /** By path, so that the unchanged pages of a live stream are not read again. */
  private readonly read = new Map<string, Promise<readonly GroupEntry[]>>();
  private readonly sizes = new Map<number, number>();
  private estimate: (span: Span) => number = () => 0;

  /** @param readPage - fetches, verifies and parses a page */
  constructor(manifest: Manifest, private readonly readPage: (page: IndexPage) => Promise<readonly GroupEntry[]>) {
    this.grow(manifest);
  }

  /** The manifest of a live stream with more groups. */
  grow(manifest: Manifest): void {
    this.spans = manifest.spans;
    this.inline = manifest.groups;
    this.pages = manifest.pages;
    const rate = manifest.renditions[0].bandwidth;
    this.estimate = ({ frameCount }): number => (rate * frameCount) / manifest.fps / 8;
    this.inline.forEach(({ renditions }, index) => this.sizes.set(index, renditions[0].bytes));
  }

  get length(): number {
    return this.spans.length;
  }

  /** Bytes of a group in its best rendition; an upper estimate where its page was not read. */
  bytes(index: number): number {
    return this.sizes.get(index) ?? this.estimate(this.spans[index]);
  }

  /** A group in all its renditions. StreamError: its page is missing or damaged. */
  async renditions(index: number): Promise<readonly Rendition[]> {
    if (index < this.inline.length) return this.inline[index].renditions;
    const page = this.pages.find(({ firstGroup, frames }) => index < firstGroup + frames.length)!;
    let reading = this.read.get(page.path);
    if (reading === undefined) {
      reading = this.readPage(page);
      this.read.set(page.path, reading);
      reading.then(
        (groups) => {
          groups.forEach(({ renditions }, i) => this.sizes.set(page.firstGroup + i, renditions[0].bytes));
        },
        () => this.read.delete(page.path),
      );
    }
    return (await reading)[index - page.firstGroup].renditions;
  }
}
