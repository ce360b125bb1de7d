/** Pictures of a video that is still arriving: the first one is decoded from its own packet, before the others are there. */

import { Closed, type Luma, type PictureSource } from "./pictures.ts";

export class ArrivingPictures implements PictureSource {
  private rest: Promise<PictureSource> | null = null;
  private closed = false;

  /** `first`: has the first picture only. `open`: called once, when another picture is needed; has all pictures, also the
   * first. */
  constructor(private readonly first: PictureSource, private readonly open: () => Promise<PictureSource>) {}

  async get(index: number): Promise<Luma> {
    if (this.closed) throw new Closed();
    if (index === 0 && this.rest === null) return this.first.get(0);
    this.rest ??= this.open();
    const rest = await this.rest;
    this.first.close();
    return rest.get(index);
  }

  warm(): void {
    this.first.warm();
  }

  close(): void {
    this.closed = true;
    this.first.close();
    this.rest?.then((rest) => rest.close(), () => undefined);
  }
}
