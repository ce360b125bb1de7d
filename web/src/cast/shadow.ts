/** A soft shadow on the ground below splats that are near it. `pipelines/share/cast_ground.py` computes the same. */

import type { Box } from "../render/camera.ts";
import { placedAt, type Placement } from "../render/cast_renderer.ts";
import type { Splats } from "../worker/messages.ts";

const SIDE = 64; // pixels
const REACH = 0.06; // height at which a splat's share has fallen to 1/e, as a fraction of the performer's
const BLUR = 2; // pixels by which the shadow is blurred to each side, twice

export class ContactShadow {
  /** Its middle on the ground, and half its width. */
  readonly middle: readonly [x: number, z: number];
  readonly half: number;
  private readonly height: number;

  /** `box`: of the whole take, standing on y = 0. `strength`: opacity of its darkest parts, 0 to 1. */
  constructor({ min, max }: Box, private readonly strength: number) {
    this.half = 0.65 * Math.max(max[0] - min[0], max[2] - min[2]);
    this.height = max[1] - min[1];
    this.middle = [(min[0] + max[0]) / 2, (min[2] + max[2]) / 2];
  }

  /** Its opacities, rows along z; `standing`: from the splats' coordinates to those of the box. */
  of({ means, scales, opacities, count }: Splats, standing: Placement): Uint8Array<ArrayBuffer> {
    const cover = new Float32Array(SIDE * SIDE);
    const { half, middle } = this;
    const pixel = (2 * half) / SIDE;
    for (let i = 0, p = 0; i < count; i++, p += 3) {
      const [x, y, z] = placedAt(standing, [means[p], means[p + 1], means[p + 2]]);
      const column = Math.floor((x - middle[0] + half) / pixel);
      const row = Math.floor((z - middle[1] + half) / pixel);
      if (!(column >= 0 && column < SIDE && row >= 0 && row < SIDE)) continue;
      const area = Math.PI * Math.max(scales[p] * scales[p + 1], scales[p + 1] * scales[p + 2], scales[p] * scales[p + 2]);
      cover[SIDE * row + column] += (opacities[i] * area * Math.exp(-Math.max(y, 0) / (REACH * this.height))) / pixel ** 2;
    }
    for (let pass = 0; pass < 2; pass++) {
      blur(cover, 1, SIDE);
      blur(cover, SIDE, 1);
    }
    return Uint8Array.from(cover, (value) => Math.round(255 * this.strength * (1 - Math.exp(-value))));
  }
}

/** Averages along one direction: `step` from a value to the next, `jump` from a line to the next. */
function blur(values: Float32Array, step: number, jump: number): void {
  const line = new Float32Array(SIDE);
  for (let start = 0; start < SIDE; start++) {
    for (let k = 0; k < SIDE; k++) line[k] = values[start * jump + k * step];
    for (let k = 0; k < SIDE; k++) {
      let sum = 0;
      for (let d = -BLUR; d <= BLUR; d++) sum += line[k + d] ?? 0;
      values[start * jump + k * step] = sum / (2 * BLUR + 1);
    }
  }
}
