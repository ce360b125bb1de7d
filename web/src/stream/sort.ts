/** Sorts splats back to front: a counting sort of 16-bit depths. */

const BINS = 1 << 16;
/** Splats nearer than this are not rendered, as in studio.rasterizer. */
export const NEAR = 0.01;

/** Sorts splats by depth; reuses its memory between calls. */
export class DepthSorter {
  private depths = new Float32Array(0);
  private keys = new Uint16Array(0);
  private readonly starts = new Uint32Array(BINS + 1);

  /** The tile pixels of the splats that are at least NEAR in front of the camera, farthest first. At equal depth, the splat
   * with the higher index counts as farther, because the rasterizer draws front to back and keeps the given order.
   * `positions`: (N, 3) centers. `pixels`: (N) the value to return for each splat; null for its index. `axis`: (4) a splat's
   * depth is axis · (x, y, z, 1). `out`: (N) filled from the start. Returns the number of values. */
  sort(
    positions: Float32Array,
    pixels: Uint32Array | null,
    axis: readonly [number, number, number, number],
    out: Uint32Array,
  ): number {
    const count = out.length;
    if (this.depths.length < count) {
      this.depths = new Float32Array(count);
      this.keys = new Uint16Array(count);
    }
    const { depths, keys, starts } = this;
    const [ax, ay, az, aw] = axis;
    let nearest = Infinity;
    let farthest = -Infinity;
    for (let i = 0, p = 0; i < count; i++, p += 3) {
      const depth = ax * positions[p] + ay * positions[p + 1] + az * positions[p + 2] + aw;
      depths[i] = depth;
      if (depth >= NEAR) {
        if (depth < nearest) nearest = depth;
        if (depth > farthest) farthest = depth;
      }
    }
    if (farthest === -Infinity) return 0;
    starts.fill(0);
    const scale = farthest > nearest ? (BINS - 1) / (farthest - nearest) : 0;
    for (let i = 0; i < count; i++) {
      const depth = depths[i];
      if (depth >= NEAR) {
        const key = Math.min(BINS - 1, Math.max(0, ((farthest - depth) * scale) | 0));
        keys[i] = key;
        starts[key + 1]++;
      }
    }
    for (let key = 1; key <= BINS; key++) starts[key] += starts[key - 1];
    const total = starts[BINS];
    for (let i = count - 1; i >= 0; i--)
      if (depths[i] >= NEAR) out[starts[keys[i]]++] = pixels === null ? i : pixels[i];
    return total;
  }
}
