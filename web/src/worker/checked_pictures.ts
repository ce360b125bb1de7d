/** Compares decoded images with their CRC-32 in the manifest: a decoder is exact, or it cannot be used. */

import { crc32 } from "../stream/crc32.ts";
import type { LumaCheck } from "../stream/manifest.ts";
import { type Luma, PathFailed, type PictureSource } from "./pictures.ts";
import type { Pool } from "./pool.ts";

export class CheckedPictures implements PictureSource {
  private begun = false;

  constructor(
    private readonly pictures: PictureSource,
    private readonly checks: readonly LumaCheck[],
    private readonly name: string,
    private readonly pool: Pool,
  ) {}

  async get(index: number): Promise<Luma> {
    // Nothing is drawn before the first image was compared, also where playing or seeking begins after it.
    if (!this.begun && index > 0) this.pool.give((await this.checked(0)).data);
    return this.checked(index);
  }

  private async checked(index: number): Promise<Luma> {
    const luma = await this.pictures.get(index);
    for (const check of this.checks)
      if (check.picture === index && crc32(luma.data) !== check.crc32)
        throw new PathFailed(`${this.name}: this device decodes picture ${index} inexactly.`);
    this.begun = true;
    return luma;
  }

  warm(): void {
    this.pictures.warm();
  }

  close(): void {
    this.pictures.close();
  }
}
