/** The manifest and the groups of an opened stream, and whether another bake has replaced it. Groups are in the manifest, or
 * in pages, which are read when they are needed. */

import { Rebaked, StreamError } from "../stream/errors.ts";
import {
  type GroupEntry, type Manifest, MAX_MANIFEST_BYTES, onlyGrows, parseManifest, parsePage, type Rendition,
} from "../stream/manifest.ts";
import { readChecked, sha256, type Source } from "./source.ts";

export class StreamFiles {
  /** Whether another bake has replaced the stream: no more of it can be fetched. */
  replaced = false;
  private told = false;
  /** Set once it was read, and again when a live stream has more groups. */
  manifest!: Manifest;
  /** Pages by path, so that the unchanged pages of a live stream are not read again. */
  private readonly pages = new Map<string, Promise<readonly GroupEntry[]>>();

  /** `name`: of the manifest in the source. `rebaked`: called when another bake has replaced the stream. */
  constructor(
    readonly source: Source,
    private readonly name: string,
    private readonly rebaked: () => void,
    private readonly signal: AbortSignal,
  ) {}

  /** Reads the manifest. StreamError: it is missing, damaged, or not a manifest. */
  async read(): Promise<Manifest> {
    return this.parse(await this.fetch());
  }

  private fetch(): Promise<Uint8Array<ArrayBuffer>> {
    return this.source.read(this.name, MAX_MANIFEST_BYTES, this.signal);
  }

  private async parse(data: Uint8Array<ArrayBuffer>): Promise<Manifest> {
    this.signal.throwIfAborted();
    const text = new TextDecoder().decode(data);
    const manifest = parseManifest(text, data.length);
    const blanked = new TextEncoder().encode(text.replaceAll(manifest.manifest_sha256, "0".repeat(64)));
    const digest = await sha256(blanked);
    if (digest !== null && digest !== manifest.manifest_sha256)
      throw new StreamError("The stream's manifest is damaged: its content does not match its own SHA-256.");
    return manifest;
  }

  /** A group in all its renditions. StreamError: its page is missing or damaged. */
  async renditions(index: number): Promise<readonly Rendition[]> {
    const { manifest } = this;
    if (index < manifest.groups.length) return manifest.groups[index].renditions;
    const page = manifest.pages.find(({ firstGroup, frames }) => index < firstGroup + frames.length)!;
    let reading = this.pages.get(page.path);
    if (reading === undefined) {
      reading = this.sameBake(async () => {
        const data = await readChecked(this.source, page, this.signal);
        return parsePage(new TextDecoder().decode(data), page, manifest);
      });
      this.pages.set(page.path, reading);
      reading.catch(() => this.pages.delete(page.path));
    }
    return (await reading)[index - page.firstGroup].renditions;
  }

  /** Runs what reads files of the stream. Distinguishes damaged or missing files from another bake that has replaced it. */
  async sameBake<T>(reads: () => Promise<T>): Promise<T> {
    try {
      return await reads();
    } catch (error) {
      if (!(error instanceof StreamError) || error.transient || !(await this.isReplaced(() => this.fetch()))) throw error;
      this.replace();
      throw new Rebaked();
    }
  }

  /** Another bake has replaced the stream. */
  replace(): void {
    this.tell();
    this.replaced = true;
  }

  private tell(): void {
    if (!this.told) this.rebaked();
    this.told = true;
  }

  /** Looks whether another bake has replaced the stream. A live stream's manifest is read again and again anyway. */
  async look(): Promise<void> {
    const { source, name, signal } = this;
    if (this.told || this.manifest.live || source.peek === undefined || !(await this.isReplaced(() => source.peek!(name, signal)))) return;
    this.tell(); // files of the old one may still be there
  }

  /** Whether the stream has another manifest now, which does not only add groups. */
  private async isReplaced(read: () => Promise<Uint8Array<ArrayBuffer>>): Promise<boolean> {
    const old = this.manifest;
    try {
      const data = await read();
      // A manifest contains its own SHA-256. The same one is not validated again: this thread also decodes.
      if (new TextDecoder().decode(data).includes(old.manifest_sha256)) return false;
      return !(old.live && onlyGrows(old, await this.parse(data)));
    } catch {
      return false; // nothing that could be opened instead
    }
  }
}
