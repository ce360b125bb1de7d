/** Compares decoded pictures with their CRC-32 in the manifest: a decoder is exact, or it cannot be used. */

import { crc32 } from "../stream/crc32.ts";
import type { LumaCheck } from "../stream/manifest.ts";
import { type Luma, PathFailed, type PictureSource } from "./pictures.ts";

export class CheckedPictures implements PictureSource {
  private readonly pictures: PictureSource;
  private readonly checks: readonly LumaCheck[];
  private readonly name: string;

  constructor(pictures: PictureSource, checks: readonly LumaCheck[], name: string) {
    this.pictures = pictures;
    this.checks = checks;
    this.name = name;
  }

  async get(index: number): Promise<Luma> {
    const luma = await this.pictures.get(index);
    for (const check of this.checks)
      if (check.picture === index && crc32(luma.data) !== check.crc32)
        throw new PathFailed(`${this.name}: this device decodes picture ${index} inexactly.`);
    return luma;
  }

  warm(): void {
    this.pictures.warm();
  }

  close(): void {
    this.pictures.close();
  }
}
