/** From where a stream's splats can be looked at: docs/STREAM.md, "View range". */

import type { Vector } from "../stream/manifest.ts";

export interface ViewRange {
  /** The middle of the scene, world units. */
  readonly center: Vector;
  /** Unit vectors from there to the training cameras. */
  readonly directions: readonly Vector[];
  /** Degrees to the nearest direction up to which views are good. */
  readonly angle: number;
}

/** Degrees beyond the range in which the picture fades. */
export const FADE = 20;

/** How much of the picture to show from an eye's place: 1 within the range, 0 from FADE degrees beyond. */
export function visibility({ center, directions, angle }: ViewRange, eye: Vector): number {
  const towards = [0, 1, 2].map((k) => eye[k] - center[k]);
  const length = Math.hypot(...towards);
  if (!(length > 0)) return 1;
  let nearest = -1;
  for (const one of directions) nearest = Math.max(nearest, (one[0] * towards[0] + one[1] * towards[1] + one[2] * towards[2]) / length);
  const beyond = (Math.acos(Math.min(1, nearest)) * 180) / Math.PI - angle;
  return Math.max(0, Math.min(1, 1 - beyond / FADE));
}
