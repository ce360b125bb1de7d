/** The image that holds all of a frame's numbers, as tiles. In the profile `planes`, it is assembled from the planes, so that
 * both profiles are rendered in the same way. */

import { tileCorner, tilesOf } from "./layout.ts";
import { filesOf, isMotion, type PlanesRendition, type Rendition } from "./manifest.ts";

const COLUMNS = 8; // tiles per row of the image that contains a frame's planes

export interface PictureLayout {
  /** Side of a tile in pixels. */
  readonly tile: number;
  /** Tiles in a row, and rows. Tile c is at column c % columns, row c / columns. */
  readonly columns: number;
  readonly rows: number;
}

export function layoutOf(group: Rendition): PictureLayout {
  if (isMotion(group)) return group;
  const planes = filesOf(group).length;
  const columns = Math.min(COLUMNS, planes);
  return { tile: group.side, columns, rows: Math.ceil(planes / columns) };
}

/** Width and height. */
export function pictureSize(group: Rendition): [number, number] {
  const { tile, columns, rows } = layoutOf(group);
  return [columns * tile, rows * tile];
}

/** (C, 2) float32 base and step of each channel or plane, in order, with value = base + code * step. Of the two planes of a
 * position, the high one has the base, and 256 times the step of the low one. */
export function unitsOf(group: Rendition): Float32Array<ArrayBuffer> {
  if (isMotion(group)) return Float32Array.from(group.channels.flatMap(({ offset, step }) => [offset - 128 * step, step]));
  const units = group.components.flatMap(({ min, max, planes }) =>
    planes.length === 1 ? [min, (max - min) / 255] : [min, (256 * (max - min)) / 65535, 0, (max - min) / 65535],
  );
  return Float32Array.from(units);
}

/** Whether the low bytes of each position are mirrored where the high ones are odd. */
export function mirroredAxes({ components, sh_degree: shDegree }: PlanesRendition): boolean[] {
  const { means } = tilesOf("planes", shDegree);
  return components.slice(means, means + 3).map(({ planes }) => planes[1].part === "low_mirrored");
}

/** Centers of all splats, (N, 3) float32 into `out`; `picture` is laid out as `layoutOf` says. */
export function planePositions(group: PlanesRendition, picture: Uint8Array, out: Float32Array): void {
  const layout = layoutOf(group);
  const { tile } = layout;
  const width = tile * layout.columns;
  const mirroring = mirroredAxes(group);
  const { means } = tilesOf("planes", group.sh_degree);
  group.components.slice(means, means + 3).forEach((component, axis) => {
    const scale = (component.max - component.min) / 65535;
    const mirrored = mirroring[axis];
    const [high, low] = [means + 2 * axis, means + 2 * axis + 1].map((plane) => tileCorner(layout, plane));
    for (let i = 0, row = 0, column = 0; i < group.splats; i++) {
      const at = row * width + column;
      const h = picture[high + at];
      const l = picture[low + at];
      out[3 * i + axis] = component.min + (256 * h + (mirrored && h & 1 ? 255 - l : l)) * scale;
      if (++column === tile) {
        column = 0;
        row++;
      }
    }
  });
}
