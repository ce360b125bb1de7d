/** The manifest and the pages of an opened stream, and whether another bake has replaced it. */

import { Rebaked, StreamError } from "../stream/errors.ts";
import {
  type GroupEntry,
  type IndexPage,
  type Manifest,
  MAX_MANIFEST_BYTES,
  parseManifest,
  parsePage,
  whatChanged,
} from "../stream/manifest.ts";
import { EARLY_MANIFEST, type EarlyFiles } from "./early_files.ts";
import { readChecked, sha256, type Source } from "./source.ts";

export class StreamFiles {
  /** Whether SHA-256 is verified: browsers provide it on secure pages only. */
  checked = false;

  /** @param name - of the manifest in the source */
  constructor(readonly source: Source, private readonly name: string, private readonly signal: AbortSignal) {}

  /** Reads the manifest, from what the page has begun to fetch if that is usable. StreamError: it is missing, damaged, or not
   * a manifest. */
  async manifest(early: EarlyFiles | null = null): Promise<Manifest> {
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

  /** @throws StreamError - the page of the index is missing or damaged */
  async page(page: IndexPage, manifest: Manifest): Promise<readonly GroupEntry[]> {
    const data = await readChecked(this.source, page, this.signal);
    return parsePage(new TextDecoder().decode(data), page, manifest);
  }

  /** Runs what reads files of the stream. Distinguishes damaged or missing files from another bake that has replaced it. */
  async sameBake<T>(manifest: Manifest, reads: () => Promise<T>): Promise<T> {
    try {
      return await reads();
    } catch (error) {
      if (error instanceof StreamError && !error.transient && (await this.replaced(manifest)))
        throw new Rebaked();
      throw error;
    }
  }

  /** Whether the stream has another manifest now, which does not only add groups. */
  private async replaced(old: Manifest): Promise<boolean> {
    try {
      const now = await this.manifest();
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
