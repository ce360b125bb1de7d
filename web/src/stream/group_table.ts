/** The groups of a stream: those in the manifest, and those in pages, which are read when they are needed. */

import type { GroupEntry, IndexPage, Manifest, Rendition } from "./manifest.ts";

export class GroupTable {
  /** By path, so that the unchanged pages of a live stream are not read again. */
  private readonly read = new Map<string, Promise<readonly GroupEntry[]>>();
  private readonly sizes = new Map<number, number>();

  /** @param readPage - fetches, verifies and parses a page */
  constructor(public manifest: Manifest, private readonly readPage: (page: IndexPage) => Promise<readonly GroupEntry[]>) {
    this.grow(manifest);
  }

  /** The manifest of a live stream with more groups. */
  grow(manifest: Manifest): void {
    this.manifest = manifest;
    manifest.groups.forEach(({ renditions }, index) => this.sizes.set(index, renditions[0].bytes));
  }

  /** Bytes of a group in its best rendition; an upper estimate where its page was not read. */
  bytes(index: number): number {
    const { renditions, fps, spans } = this.manifest;
    return this.sizes.get(index) ?? (renditions[0].bandwidth * spans[index].frameCount) / fps / 8;
  }

  /** A group in all its renditions. StreamError: its page is missing or damaged. */
  async renditions(index: number): Promise<readonly Rendition[]> {
    const { groups, pages } = this.manifest;
    if (index < groups.length) return groups[index].renditions;
    const page = pages.find(({ firstGroup, frames }) => index < firstGroup + frames.length)!;
    let reading = this.read.get(page.path);
    if (reading === undefined) {
      reading = this.readPage(page);
      this.read.set(page.path, reading);
      reading.then(
        (found) => found.forEach(({ renditions }, i) => this.sizes.set(page.firstGroup + i, renditions[0].bytes)),
        () => this.read.delete(page.path),
      );
    }
    return (await reading)[index - page.firstGroup].renditions;
  }
}
