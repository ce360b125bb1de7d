/** Renders the splats of several streams, sorted together, over the ground with their shadows. */

import { DepthSorter } from "../stream/sort.ts";
import type { Vector } from "../stream/metadata.ts";
import type { Splats } from "../worker/messages.ts";
import { centerOf, depthAxis, dot, type Pinhole } from "./camera.ts";
import { GROUND_FRAGMENT, GROUND_VERTEX } from "./cast_shaders.ts";
import { Program, Texture } from "./gl.ts";
import { Renderer, type Resources } from "./renderer.ts";
import { ARRAY_WIDTH, arraySplats, ORDER_WIDTH } from "./shaders.ts";

/** Where something is: 3 rows of 4 numbers, a rotation with a scale, and an offset. */
export type Placement = readonly number[];

export const placedAt = (m: Placement, [x, y, z]: Vector): [number, number, number] =>
  [0, 4, 8].map((k) => m[k] * x + m[k + 1] * y + m[k + 2] * z + m[k + 3]) as [number, number, number];

/** `a` after `b`. */
export const composed = (a: Placement, b: Placement): Placement =>
  [0, 4, 8].flatMap((k) => [0, 1, 2, 3].map((c) => a[k] * b[c] + a[k + 1] * b[c + 4] + a[k + 2] * b[c + 8] + (c === 3 ? a[k + 3] : 0)));

/** The camera that sees what `pinhole` sees, in the coordinates of what is placed; depths are the world's. */
const within = ({ rotation: r, translation: t, ...lens }: Pinhole, m: Placement): Pinhole => {
  const c = composed([0, 1, 2].flatMap((k) => [...r.slice(3 * k, 3 * k + 3), t[k]]), m);
  return { ...lens, rotation: [0, 4, 8].flatMap((k) => c.slice(k, k + 3)), translation: [c[3], c[7], c[11]] };
};

/** A shadow or the whole ground: where its middle is, how far it reaches along its own x and z, and what it looks like. */
export interface Lying {
  readonly place: Placement;
  readonly halves: readonly [x: number, z: number];
  readonly color: readonly [number, number, number, number];
  /** Its opacities, square; null for a disk. */
  readonly pixels: Uint8Array<ArrayBuffer> | null;
}

interface Item {
  readonly place: Placement;
  readonly splats: Splats;
  /** Whether the texture has the splats. */
  sent: boolean;
}

export class CastRenderer extends Renderer {
  /** What lies on the ground, the lowest first. */
  lying: readonly Lying[] = [];
  private readonly items: (Item | undefined)[] = [];
  private readonly sorter = new DepthSorter();
  private positions = new Float32Array(0);
  private places = new Uint32Array(0);
  private axis = "";
  /** Textures and programs of these resources, which a lost context takes away. */
  private own: { of: Resources; textures: Texture[]; shadow: Texture; ground: Program } | null = null;

  /** Shows these splats as an item's from now on; its arrays are read until the next call. */
  show(number: number, place: Placement, splats: Splats): void {
    const before = this.items[number]?.splats.count;
    this.items[number] = { place, splats, sent: false };
    if (before === splats.count) this.locate(number);
    else this.items.forEach((_, k) => this.locate(k));
    this.axis = "";
  }

  /** First place of an item's splats among all: each begins a row of words. */
  private first(number: number): number {
    const rows = this.items.slice(0, number).map((item) => Math.ceil((item?.splats.count ?? 0) / ORDER_WIDTH));
    return ORDER_WIDTH * rows.reduce((sum, value) => sum + value, 0);
  }

  /** Computes where an item's splats are in the world. */
  private locate(number: number): void {
    const size = this.first(this.items.length);
    if (this.places.length !== size) {
      this.places = new Uint32Array(size);
      this.positions = new Float32Array(3 * size).fill(NaN); // what is no splat is nowhere
    }
    const item = this.items[number];
    if (item === undefined) return;
    const { place: m, splats: { means, count } } = item;
    const { positions } = this;
    for (let i = 0, p = 0, to = 3 * this.first(number); i < count; i++, p += 3, to += 3)
      for (let k = 0; k < 3; k++) positions[to + k] = m[4 * k] * means[p] + m[4 * k + 1] * means[p + 1] + m[4 * k + 2] * means[p + 2] + m[4 * k + 3];
  }

  protected override project(resources: Resources, pinhole: Pinhole): number {
    const { gl, items } = this;
    const { textures } = this.ownOf(resources);
    resources.resizeWords(ORDER_WIDTH, Math.max(1, this.first(items.length) / ORDER_WIDTH));
    items.forEach((item, k) => {
      if (item === undefined) return;
      const { splats, place } = item;
      const { means, quats, scales, opacities, sh, count, shDegree } = splats;
      const arrays = [means, quats, scales, opacities, sh];
      const texture = (textures[k] ??= new Texture(gl, 0, [gl.R32F, gl.RED, gl.FLOAT]));
      if (!item.sent) {
        const values = Math.max(...arrays.map(({ byteOffset, byteLength }) => byteOffset + byteLength)) / 4;
        texture.resize(ARRAY_WIDTH, Math.max(texture.height, Math.ceil(values / ARRAY_WIDTH)));
        texture.fill(new Float32Array(means.buffer, 0, values), values);
        item.sent = true;
      }
      const program = resources.project(arraySplats(shDegree));
      gl.bindFramebuffer(gl.FRAMEBUFFER, resources.wordsFrame);
      program.use();
      const inside = within(pinhole, place);
      const scale = dot(place.slice(0, 3) as unknown as Vector, place.slice(0, 3) as unknown as Vector);
      const eye = centerOf(inside).map((value) => value / scale) as unknown as Vector;
      this.setPinhole(program, inside, eye, splats.dilation);
      this.projectArrays(program, texture, arrays.map(({ byteOffset }) => byteOffset / 4), count, this.first(k) / ORDER_WIDTH);
    });
    const axis = depthAxis(pinhole);
    if (this.axis !== axis.join()) {
      this.axis = axis.join();
      this.setOrder(this.places, this.sorter.sort(this.positions, null, axis, this.places));
    }
    return ORDER_WIDTH;
  }

  protected override drawBehind(pinhole: Pinhole): void {
    const { gl, resources } = this;
    // From below, nobody stands on it.
    if (resources === null || centerOf(pinhole)[1] <= 0) return;
    const { ground, shadow } = this.ownOf(resources);
    const { width, height, fx, fy, cx, cy } = pinhole;
    ground.use();
    for (const { place, halves, color, pixels } of this.lying) {
      const { rotation: r, translation: t } = within(pinhole, place);
      const rows = [0, 1, 2].map((k) => [...r.slice(3 * k, 3 * k + 3), t[k]]);
      const x = rows[0].map((value, c) => (2 * fx * value + (2 * cx - width) * rows[2][c]) / width);
      const y = rows[1].map((value, c) => (-2 * fy * value - (2 * cy - height) * rows[2][c]) / height);
      gl.uniformMatrix4fv(ground.at("toImage"), true, [...x, ...y, 0, 0, 0, 0, ...rows[2]]);
      gl.uniform2f(ground.at("halves"), ...halves);
      gl.uniform4f(ground.at("color"), ...color);
      gl.uniform1i(ground.at("isShadow"), Number(pixels !== null));
      const side = pixels === null ? 1 : Math.sqrt(pixels.length);
      shadow.resize(side, side);
      if (pixels !== null) shadow.fill(pixels);
      shadow.bindTo(ground, "shadow");
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
  }

  private ownOf(resources: Resources): NonNullable<typeof this.own> {
    const { gl } = this;
    if (this.own?.of !== resources) {
      for (const item of this.items) if (item !== undefined) item.sent = false;
      this.axis = "";
      const shadow = new Texture(gl, 1, [gl.R8, gl.RED, gl.UNSIGNED_BYTE], gl.LINEAR);
      this.own = { of: resources, textures: [], shadow, ground: new Program(gl, GROUND_VERTEX, GROUND_FRAGMENT) };
    }
    return this.own;
  }
}
