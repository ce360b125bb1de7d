/** Luma of the profile `planes`: a group's many small videos are decoded one after another and assembled as tiles of one
 * image per frame. Devices have few decoders, so only one is used, and a group is decoded completely before it plays. */

import { StreamError } from "../stream/errors.ts";
import { tileCorner } from "../stream/layout.ts";
import { filesOf, type PlanesRendition } from "../stream/manifest.ts";
import { layoutOf } from "../stream/picture.ts";
import { Closed, type Luma, type PictureSource } from "./pictures.ts";
import type { Pool } from "./pool.ts";

const MAX_GROUP_BYTES = 512 << 20; // maximum bytes of a group's images

export class PlanesPictures implements PictureSource {
  private readonly pictures: Promise<Uint8Array[]>;
  private decode = 0;
  private current: PictureSource | null = null;
  private closed = false;

  /** `open`: opens the video of plane p. StreamError: the group does not fit in memory. */
  constructor(
    private readonly group: PlanesRendition,
    open: (plane: number) => Promise<PictureSource>,
    private readonly pool: Pool,
  ) {
    const { tile, columns, rows } = layoutOf(group);
    const bytes = tile * tile * columns * rows * group.frame_count;
    if (bytes > MAX_GROUP_BYTES)
      throw new StreamError(
        `This stream cannot be played here: with its profile planes, a group takes ${Math.round(bytes / 2 ** 20)} MiB of memory; bake it with the profile motion.`,
      );
    this.pictures = this.readAll(open);
    this.pictures.catch(() => undefined);
  }

  async get(index: number): Promise<Luma> {
    const picture = (await this.pictures)[index];
    const data = this.pool.take(picture.length);
    data.set(picture);
    return { data, decode: this.decode / this.group.frame_count };
  }

  warm(): void {
    // The constructor has started decoding.
  }

  close(): void {
    this.closed = true;
    this.current?.close();
  }

  private async readAll(open: (plane: number) => Promise<PictureSource>): Promise<Uint8Array[]> {
    const layout = layoutOf(this.group);
    const { tile, columns, rows } = layout;
    const width = tile * columns;
    const pictures = Array.from({ length: this.group.frame_count }, () => new Uint8Array(width * tile * rows));
    for (let plane = 0; plane < filesOf(this.group).length; plane++) {
      const source = (this.current = await open(plane));
      try {
        for (const [index, picture] of pictures.entries()) {
          if (this.closed) throw new Closed();
          const { data, decode } = await source.get(index);
          this.decode += decode;
          const first = tileCorner(layout, plane);
          for (let row = 0; row < tile; row++)
            picture.set(data.subarray(row * tile, (row + 1) * tile), first + row * width);
          this.pool.give(data);
        }
      } finally {
        source.close();
      }
    }
    return pictures;
  }
}
