/** Sorts splats back to front: a counting sort of 16-bit depths. */

const BINS = 1 << 16;
/** Splats nearer than this are not rendered, as in studio.rasterizer. */
export const NEAR = 0.01;

/** Sorts splats by depth; reuses its memory between calls. */
export class DepthSorter {
  /** (N) of the splats that were sorted last. */
  depths = new Float32Array(0);
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

/** In an order, what is added to the numbers of splats of the set. */
export const OF_SET = 2 ** 31;

/** The splats of the set. They stay where they are, so they are sorted only when the view moves. */
export class SortedSet {
  private readonly sorter = new DepthSorter();
  private readonly order: Uint32Array; // with `OF_SET`
  private readonly depths: Float32Array;
  private count = 0;
  private axis = "";

  /** `positions`: (N, 3) centers. */
  constructor(private readonly positions: Float32Array) {
    this.order = new Uint32Array(positions.length / 3);
    this.depths = new Float32Array(positions.length / 3);
  }

  get size(): number {
    return this.order.length;
  }

  /** Merges the sorted set into the first `count` splats of an order, which have these `depths`. `pixels`: the value to return
   * for each of them; for a splat of the set, it is its number and `OF_SET`. Returns the number of values in `out`. */
  merge(
    order: Uint32Array, count: number, depths: Float32Array, pixels: Uint32Array,
    axis: readonly [number, number, number, number], out: Uint32Array,
  ): number {
    this.sort(axis);
    const { order: own, depths: behind, count: size } = this;
    let filled = 0;
    let next = 0;
    for (let a = 0; a < count; a++) {
      const splat = order[a];
      const depth = depths[splat];
      while (next < size && behind[next] > depth) out[filled++] = own[next++];
      out[filled++] = pixels[splat];
    }
    out.set(own.subarray(next, size), filled);
    return filled + size - next;
  }

  private sort(axis: readonly [number, number, number, number]): void {
    const key = axis.join();
    if (key === this.axis) return;
    this.axis = key;
    const { depths, order, sorter } = this;
    const count = (this.count = sorter.sort(this.positions, null, axis, order));
    for (let i = 0; i < count; i++) {
      depths[i] = sorter.depths[order[i]];
      order[i] |= OF_SET;
    }
  }
}
