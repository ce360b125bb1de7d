/** What the renderer needs of a group, besides its images. */

import { isMotion, type Rendition } from "../stream/manifest.ts";
import type { MotionTables } from "../stream/motion.ts";
import { planesLayout, planeUnits } from "../stream/planes.ts";
import type { GroupSetup } from "./messages.ts";

/** `tables`: of a group of the profile `motion`, else null. `prepare`: milliseconds that it took to prepare the group. */
export function setupOf(group: Rendition, tables: MotionTables | null, prepare: number): GroupSetup {
  const common = {
    group: group.index,
    rendition: group.id,
    bytes: group.bytes,
    frames: group.frame_count,
    prepare,
    splats: group.splats,
    shDegree: group.sh_degree,
    dilation: group.dilation,
  };
  if (!isMotion(group))
    return {
      ...common,
      ...planesLayout(group),
      profile: "planes",
      units: planeUnits(group),
      statics: null,
      blocks: 0,
      lattice: null,
      mirrored: group.components.slice(0, 3).map((entry) => entry.planes[1].part === "low_mirrored"),
    };
  const { tile, columns, rows, positions, blocks } = group;
  return {
    ...common,
    profile: "motion",
    tile,
    columns,
    rows,
    units: Float32Array.from(group.channels.flatMap(({ offset, step }) => [offset - 128 * step, step])),
    statics: tables!.statics(),
    blocks: blocks.count,
    lattice: { min: positions.min, step: positions.step, ratio: positions.step / blocks.radius },
    mirrored: [],
  };
}

/** Width and height of the image that holds all of a group's numbers of one frame. */
export function pictureSize(group: Rendition): [number, number] {
  const { tile, columns, rows } = isMotion(group) ? group : planesLayout(group);
  return [columns * tile, rows * tile];
}
