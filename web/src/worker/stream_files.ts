/** The manifest and the groups of an opened stream, and whether another bake has replaced it. Groups are in the manifest, or
 * in pages, which are read when they are needed. */

import { Rebaked, StreamError } from "../stream/errors.ts";
import {
  type GroupEntry,
  type Manifest,
  MAX_MANIFEST_BYTES,
  parseManifest,
  parsePage,
  type Rendition,
  whatChanged,
} from "../stream/manifest.ts";
import { EARLY_MANIFEST, type EarlyFiles } from "./early_files.ts";
import { readChecked, sha256, type Source } from "./source.ts";

export class StreamFiles {
  /** Whether SHA-256 is verified: browsers provide it on secure pages only. */
  checked = false;
  /** That of the last `use`. */
  manifest!: Manifest;
  /** By path, so that the unchanged pages of a live stream are not read again. */
  private readonly pages = new Map<string, Promise<readonly GroupEntry[]>>();
  /** Of groups in their best rendition, bytes. */
  private readonly sizes = new Map<number, number>();

  /** `name`: of the manifest in the source. `rebaked`: called when another bake has replaced the stream. */
  constructor(
    readonly source: Source,
    private readonly name: string,
    private readonly rebaked: () => void,
    private readonly signal: AbortSignal,
  ) {}

  /** Reads the manifest, from what the page has begun to fetch if that is usable. StreamError: it is missing, damaged, or not
   * a manifest. */
  async read(early: EarlyFiles | null = null): Promise<Manifest> {
    const given = early === null ? null : await earlyManifest(early);
    const data = given ?? (await this.source.readAll(this.name, MAX_MANIFEST_BYTES, this.signal));
    this.signal.throwIfAborted();
    const text = new TextDecoder().decode(data);
    const manifest = parseManifest(text, data.length);
    const blanked = new TextEncoder().encode(text.replaceAll(manifest.manifest_sha256, "0".repeat(64)));
    const digest = await sha256(blanked);
    if (digest !== null && digest !== manifest.manifest_sha256)
      throw new StreamError("The stream's manifest is damaged: its content does not match its own SHA-256.");
    this.checked = digest !== null;
    return manifest;
  }

  /** Takes a manifest: the first one, or that of a live stream with more groups. */
  use(manifest: Manifest): void {
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
      reading.then(
        (found) => found.forEach(({ renditions }, i) => this.sizes.set(page.firstGroup + i, renditions[0].bytes)),
        () => this.pages.delete(page.path),
      );
    }
    return (await reading)[index - page.firstGroup].renditions;
  }

  /** Runs what reads files of the stream. Distinguishes damaged or missing files from another bake that has replaced it. */
  async sameBake<T>(reads: () => Promise<T>): Promise<T> {
    try {
      return await reads();
    } catch (error) {
      if (!(error instanceof StreamError) || error.transient || !(await this.replaced())) throw error;
      this.rebaked();
      throw new Rebaked();
    }
  }

  /** Whether the stream has another manifest now, which does not only add groups. */
  private async replaced(): Promise<boolean> {
    const old = this.manifest;
    try {
      const now = await this.read();
      return now.manifest_sha256 !== old.manifest_sha256 && !(old.live && whatChanged(old, now) === null);
    } catch {
      return false; // nothing that could be opened instead
    }
  }
}

/** The manifest that the page has fetched; null if it could not, or it is too large. */
async function earlyManifest(early: EarlyFiles): Promise<Uint8Array<ArrayBuffer> | null> {
  const parts: Uint8Array<ArrayBuffer>[] = [];
  const milliseconds = await early.take(EARLY_MANIFEST, (chunk) => parts.push(chunk));
  const size = parts.reduce((sum, { length }) => sum + length, 0);
  return milliseconds === null || size > MAX_MANIFEST_BYTES ? null : new Uint8Array(await new Blob(parts).arrayBuffer());
}
