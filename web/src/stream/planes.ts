/** The profile `planes`: its planes as tiles of one image, so that both profiles are rendered in the same way. */

import { filesOf, type PlanesRendition } from "./manifest.ts";

const COLUMNS = 8; // tiles per row of the image that contains a frame's planes

/** Layout of the planes: plane p is at column p % columns, row p / columns. */
export function planesLayout(group: PlanesRendition): { tile: number; columns: number; rows: number } {
  const planes = filesOf(group).length;
  const columns = Math.min(COLUMNS, planes);
  return { tile: group.side, columns, rows: Math.ceil(planes / columns) };
}

/** (planes, 2) float32 offset and step of each plane, in order, with value = offset + code * step. Of the two planes of a
 * position, the high one has the offset, and 256 times the step of the low one. */
export function planeUnits(group: PlanesRendition): Float32Array<ArrayBuffer> {
  const units: number[] = [];
  for (const { min, max, planes } of group.components) {
    if (planes.length === 1) units.push(min, (max - min) / 255);
    else units.push(min, (256 * (max - min)) / 65535, 0, (max - min) / 65535);
  }
  return Float32Array.from(units);
}

/** Centers of all splats, (N, 3) float32 into `out`; `picture` is laid out as `planesLayout` says. */
export function planePositions(group: PlanesRendition, picture: Uint8Array, out: Float32Array): void {
  const { tile, columns } = planesLayout(group);
  const width = tile * columns;
  group.components.slice(0, 3).forEach((component, axis) => {
    const scale = (component.max - component.min) / 65535;
    const mirrored = component.planes[1].part === "low_mirrored";
    const [high, low] = [2 * axis, 2 * axis + 1].map(
      (plane) => Math.floor(plane / columns) * tile * width + (plane % columns) * tile,
    ) as [number, number];
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
