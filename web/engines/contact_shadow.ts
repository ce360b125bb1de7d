/** A soft shadow on the ground below splats that are near it. */

import { type Box3, DataTexture, LinearFilter, type Matrix4, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";
import type { Splats } from "../src/worker/messages.ts";

/** Pixels on a side. */
const SIDE = 64;
/** Height at which a splat's share has fallen to 1/e, as a fraction of the performer's. */
const REACH = 0.06;
/** Pixels by which the shadow is blurred to each side, twice. */
const BLUR = 2;
/** Above the ground, as a fraction of the performer's height, so that it does not flicker. */
const LIFT = 0.002;

export class ContactShadow extends Mesh<PlaneGeometry, MeshBasicMaterial> {
  private readonly pixels = new Uint8Array(4 * SIDE * SIDE);
  private readonly texture: DataTexture;
  private readonly corner: readonly [x: number, z: number];
  private readonly width: number;
  private readonly height: number;

  /**
   * @param box - of the whole take, in the coordinates of the parent, whose ground is at y = 0
   * @param strength - opacity of its darkest parts, 0 to 1
   */
  constructor({ min, max }: Box3, private readonly strength: number) {
    const width = 1.3 * Math.max(max.x - min.x, max.z - min.z);
    super(new PlaneGeometry(width, width).rotateX(-Math.PI / 2));
    this.width = width;
    this.height = max.y - min.y;
    const [x, z] = [(min.x + max.x) / 2, (min.z + max.z) / 2];
    this.position.set(x, LIFT * this.height, z);
    this.corner = [x - width / 2, z - width / 2];
    this.texture = new DataTexture(this.pixels, SIDE, SIDE);
    this.texture.magFilter = LinearFilter;
    this.texture.flipY = true; // rows go along +z, which a plane that lies has at its lower edge
    this.material = new MeshBasicMaterial({ map: this.texture, transparent: true, depthWrite: false });
    this.renderOrder = -1; // before the splats
  }

  /** @param matrix - from the splats' coordinates to the parent's */
  show({ means, scales, opacities, count }: Splats, { elements: m }: Matrix4): void {
    const cover = new Float32Array(SIDE * SIDE);
    const pixel = this.width / SIDE;
    for (let i = 0, p = 0; i < count; i++, p += 3) {
      const [x, y, z] = [means[p], means[p + 1], means[p + 2]];
      const height = m[1] * x + m[5] * y + m[9] * z + m[13];
      const column = Math.floor((m[0] * x + m[4] * y + m[8] * z + m[12] - this.corner[0]) / pixel);
      const row = Math.floor((m[2] * x + m[6] * y + m[10] * z + m[14] - this.corner[1]) / pixel);
      if (column < 0 || column >= SIDE || row < 0 || row >= SIDE) continue;
      const area = Math.PI * Math.max(scales[p] * scales[p + 1], scales[p + 1] * scales[p + 2], scales[p] * scales[p + 2]);
      cover[SIDE * row + column] += (opacities[i] * area * Math.exp(-Math.max(height, 0) / (REACH * this.height))) / pixel ** 2;
    }
    for (let pass = 0; pass < 2; pass++) {
      blur(cover, 1, SIDE);
      blur(cover, SIDE, 1);
    }
    for (let k = 0; k < cover.length; k++) this.pixels[4 * k + 3] = Math.round(255 * this.strength * (1 - Math.exp(-cover[k])));
    this.texture.needsUpdate = true;
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
