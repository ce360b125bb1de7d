/** Renders frames with WebGL2. */

import type { Vector } from "../stream/metadata.ts";
import { BLOCK_TEXELS } from "../stream/motion.ts";
import { unitsOf } from "../stream/layout.ts";
import type { GroupSetup, Picture, StreamSet } from "../worker/messages.ts";
import { centerOf, fieldLimits, type Pinhole } from "./camera.ts";
import { escapedSplats } from "./escapes.ts";
import { contextOf, Program, Texture } from "./gl.ts";
import {
  ARRAY_WIDTH, arraySplats, FULL_VERTEX, imageSplats, ORDER_WIDTH, projectFragment, RESOLVE_FRAGMENT, SPLAT_FRAGMENT, SPLAT_VERTEX,
} from "./shaders.ts";

const BLOCKS_PER_ROW = 128; // blocks per row of the block table

const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i; // names of renderers that draw with the CPU

const BATCH = 1024; // splats per instance: with one splat each, the overhead of instances would exceed the work on splats

/** All GPU resources, recreated after the context is lost. */
export class Resources {
  readonly luma: Texture;
  readonly statics: Texture;
  readonly blocks: Texture;
  /** Splats with escapes: see `escapedSplats`. */
  readonly escapedLuma: Texture;
  readonly escapedStatics: Texture;
  /** Output of the first pass: the tile of all splats, and above it the tile of those with escapes. */
  readonly words: readonly [Texture, Texture];
  readonly wordsFrame: WebGLFramebuffer;
  readonly order: Texture;
  /** The splats of the set, and their words. */
  readonly set: Texture;
  readonly setWords: readonly [Texture, Texture];
  readonly setFrame: WebGLFramebuffer;
  readonly splat: Program;
  readonly resolve: Program;
  /** The image at its own resolution. */
  readonly drawing: Texture;
  readonly drawingFrame: WebGLFramebuffer;
  readonly projects = new Map<string, Program>();

  constructor(private readonly gl: WebGL2RenderingContext, half: boolean) {
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    const integers = [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT] as const;
    // Each texture has a unit of its own.
    this.luma = new Texture(gl, 0, [gl.R8, gl.RED, gl.UNSIGNED_BYTE]);
    this.statics = new Texture(gl, 1, integers);
    this.blocks = new Texture(gl, 2, [gl.RGBA32F, gl.RGBA, gl.FLOAT]);
    this.escapedLuma = new Texture(gl, 3, [gl.R32F, gl.RED, gl.FLOAT]);
    this.escapedStatics = new Texture(gl, 4, integers);
    this.words = [new Texture(gl, 5, integers), new Texture(gl, 6, integers)];
    this.wordsFrame = gl.createFramebuffer();
    this.order = new Texture(gl, 7, [gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT]);
    // Shaders have no other input from buffers, so that it stays bound.
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    const corners = Uint16Array.from({ length: 6 * BATCH }, (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 2, 1, 3][i % 6]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    this.splat = new Program(gl, SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.resolve = new Program(gl, FULL_VERTEX, RESOLVE_FRAGMENT);
    const format = half ? ([gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT] as const) : ([gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE] as const);
    this.drawing = new Texture(gl, 8, format, gl.LINEAR);
    this.drawingFrame = gl.createFramebuffer();
    this.set = new Texture(gl, 9, [gl.R32F, gl.RED, gl.FLOAT]);
    this.setWords = [new Texture(gl, 10, integers), new Texture(gl, 11, integers)];
    this.setFrame = gl.createFramebuffer();
    this.resizeWords(ORDER_WIDTH, 1, this.setWords, this.setFrame);
  }

  /** The program that projects; `splats`: its part that reads them. */
  project(splats: string): Program {
    let program = this.projects.get(splats);
    if (program === undefined) {
      program = new Program(this.gl, FULL_VERTEX, projectFragment(splats));
      this.projects.set(splats, program);
    }
    return program;
  }

  /** Makes room for the words of the first pass; there may be more rows. */
  resizeWords(width: number, height: number, [first, second] = this.words, frame = this.wordsFrame): void {
    const { gl } = this;
    if (width === first.width && height <= first.height) return;
    first.resize(width, height);
    second.resize(width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, first.handle, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, second.handle, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
  }

  resizeDrawing(width: number, height: number): void {
    const { gl, drawing, drawingFrame } = this;
    if (!drawing.resize(width, height)) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, drawingFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, drawing.handle, 0);
  }
}

/** A part of a framebuffer, in pixels from its bottom left corner. */
export interface Viewport {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

/** A camera's image, and where it goes. */
export interface DrawnView {
  readonly pinhole: Pinhole;
  readonly viewport: Viewport;
}

/** Values that are derived from a group once. */
interface RenderedGroup extends Pick<GroupSetup, "group" | "statics"> {
  readonly units: Float32Array;
}

interface TimerQuery {
  readonly TIME_ELAPSED_EXT: number;
  readonly GPU_DISJOINT_EXT: number;
}

export class Renderer {
  /** Whether the CPU renders, since there is no GPU. */
  readonly software: boolean;
  /** Largest side of a texture in pixels. */
  readonly maxTexture: number;
  /** The name of what draws. */
  readonly graphics: string;
  /** GPU time of a recent frame in milliseconds; null if it cannot be measured. */
  gpuTime: number | null = null;
  readonly gl: WebGL2RenderingContext;
  private readonly half: boolean;
  private readonly timer: TimerQuery | null;
  private query: WebGLQuery | null = null;
  private fence: WebGLSync | null = null;
  protected resources: Resources | null;
  private setup: RenderedGroup | null = null;
  private hasPicture = false;
  /** Side of the tile of splats with escapes; 0 if the frame has none. */
  private escapedSide = 0;
  private escapedPixels = new Uint32Array(0);
  /** Places of the words of splats with escapes, by pixel; 0 for others. */
  private moved = new Uint32Array(0);
  protected count = 0;
  /** The set. `seen`: the pinhole that its words are of. */
  private behind: { readonly count: number; readonly dilation: number; seen: string } | null = null;

  /** `xrCompatible`: to draw the views of a WebXR session. StreamError: the browser does not support WebGL2. */
  constructor(canvas: HTMLCanvasElement, xrCompatible = false) {
    const gl = (this.gl = contextOf(canvas, { xrCompatible, antialias: false, depth: false, powerPreference: "high-performance" }));
    this.maxTexture = gl.getParameter(gl.MAX_TEXTURE_SIZE) as number;
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.graphics = String(gl.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
    this.software = SOFTWARE.test(this.graphics);
    // 8 bits are not precise enough to accumulate many faint splats.
    this.half = gl.getExtension("EXT_color_buffer_float") !== null || gl.getExtension("EXT_color_buffer_half_float") !== null;
    this.timer = gl.getExtension("EXT_disjoint_timer_query_webgl2") as TimerQuery | null;
    this.resources = new Resources(gl, this.half);
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.resources = null;
      this.query = null;
      this.fence = null;
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.setup = null;
      this.hasPicture = false;
      gl.getExtension("EXT_color_buffer_float");
      gl.getExtension("EXT_color_buffer_half_float");
      this.resources = new Resources(gl, this.half);
    });
  }

  /** Whether the GPU is still working on the last frame; more draw calls would only queue up. */
  get busy(): boolean {
    const { fence, gl } = this;
    if (fence === null || this.resources === null) return false;
    if (gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED) return true;
    gl.deleteSync(fence);
    this.fence = null;
    return false;
  }

  /** Whether the graphics context is lost; nothing can be rendered until it is restored. */
  get lost(): boolean {
    return this.resources === null || this.gl.isContextLost();
  }

  /** Compiles the shaders for such a stream in the background. */
  prepare(shDegree: number): void {
    this.resources?.project(imageSplats(shDegree));
  }

  /** Uploads a group's shared data; only images of this group may follow until the next call. */
  setGroup({ group, statics }: GroupSetup): void {
    const { resources } = this;
    if (resources === null) return;
    const { tile, columns, rows } = group;
    this.setup = { group, statics, units: unitsOf(group) };
    this.hasPicture = false;
    resources.luma.resize(tile * columns, tile * rows);
    resources.statics.resize(tile, tile);
    resources.statics.fill(statics);
    this.moved = new Uint32Array(tile ** 2);
    resources.resizeWords(tile, tile);
    resources.blocks.resize(BLOCKS_PER_ROW * BLOCK_TEXELS, Math.ceil(group.blocks.count / BLOCKS_PER_ROW));
  }

  /** Uploads a frame. */
  setPicture(picture: Picture): void {
    const { resources, setup } = this;
    if (resources === null || setup?.group.index !== picture.group) return;
    resources.luma.fill(picture.luma);
    resources.blocks.fill(picture.blocks, picture.blocks.length / 4);
    this.setEscapes(resources, setup, picture);
    this.hasPicture = true;
    this.setOrder(picture.order, picture.count);
  }

  /** Uploads the splats of the set, of which orders may then have some. */
  setSet({ splats, count, dilation }: StreamSet): void {
    const { resources } = this;
    if (resources === null) return;
    resources.set.resize(ARRAY_WIDTH, Math.ceil(splats.length / ARRAY_WIDTH));
    resources.set.fill(splats, splats.length);
    resources.resizeWords(ORDER_WIDTH, Math.ceil(count / ORDER_WIDTH), resources.setWords, resources.setFrame);
    this.behind = { count, dilation, seen: "" };
  }

  /** Uploads a new sort order for the same frame. */
  setOrder(pixels: Uint32Array, count: number): void {
    const { resources, moved } = this;
    if (resources === null) return;
    const order = this.escapedSide === 0 ? pixels : pixels.map((pixel) => moved[pixel] || pixel);
    resources.order.resize(ORDER_WIDTH, Math.max(1, Math.ceil(order.length / ORDER_WIDTH)));
    resources.order.fill(order, count);
    this.count = count;
  }

  private setEscapes(resources: Resources, { group, units, statics }: RenderedGroup, { luma, escapes }: Picture): void {
    for (const pixel of this.escapedPixels) this.moved[pixel] = 0;
    this.escapedPixels = new Uint32Array(0);
    this.escapedSide = 0;
    if (escapes === null) return;
    const { tile, columns, rows } = group;
    const { pixels, side, luma: small, statics: few } = escapedSplats(group, units.length / 2, luma, statics, escapes);
    resources.escapedLuma.resize(side * columns, side * rows);
    resources.escapedLuma.fill(small);
    resources.escapedStatics.resize(side, side);
    resources.escapedStatics.fill(few);
    resources.resizeWords(tile, tile + side);
    for (let k = 0; k < pixels.length; k++) this.moved[pixels[k]] = tile * (tile + Math.floor(k / side)) + (k % side);
    this.escapedPixels = pixels;
    this.escapedSide = side;
  }

  /** Renders the last upload, scaled to the canvas. `background`: RGB, 0 to 1; null leaves the background transparent. */
  draw(pinhole: Pinhole, background: Vector | null): void {
    const { gl } = this;
    if (this.resources === null) return;
    const begun = this.beginTimer();
    const { width, height } = gl.canvas;
    this.drawViews([{ pinhole, viewport: { x: 0, y: 0, width, height } }], null, background);
    if (begun) gl.endQuery(this.timer!.TIME_ELAPSED_EXT);
    gl.deleteSync(this.fence);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** Renders views into parts of a framebuffer of this context, such as that of a WebXR session; null for the canvas. */
  drawViews(views: readonly DrawnView[], frame: WebGLFramebuffer | null, background: Vector | null): void {
    const { gl, resources } = this;
    if (resources === null) return;
    for (const { pinhole, viewport } of views) {
      this.drawView(resources, pinhole);
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      this.resolve(resources, viewport, background);
    }
  }

  /** Another one, for an immersive session. */
  forSession(canvas: HTMLCanvasElement): Renderer {
    return new Renderer(canvas, true);
  }

  dispose(): void {
    this.resources = null;
    // Frees all that is in it.
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  private drawView(resources: Resources, pinhole: Pinhole): void {
    const { gl } = this;
    const size = [pinhole.width, pinhole.height] as const;
    resources.resizeDrawing(...size);
    const tile = this.project(resources, pinhole);
    gl.bindFramebuffer(gl.FRAMEBUFFER, resources.drawingFrame);
    gl.viewport(0, 0, ...size);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.drawBehind?.(pinhole);
    if (tile > 0 && this.count > 0) this.drawSplats(resources, tile, size);
    gl.disable(gl.BLEND);
  }

  /** Draws what is behind all splats. */
  protected drawBehind?(pinhole: Pinhole): void;

  private drawSplats(resources: Resources, tile: number, size: readonly [number, number]): void {
    const { gl } = this;
    const { splat } = resources;
    splat.use();
    resources.words.forEach((texture, k) => texture.bindTo(splat, `words${k}`));
    resources.setWords.forEach((texture, k) => texture.bindTo(splat, `set${k}`));
    gl.uniform1i(splat.at("tile"), tile);
    gl.uniform2f(splat.at("size"), ...size);
    resources.order.bindTo(splat, "order");
    gl.uniform1i(splat.at("count"), this.count);
    gl.uniform1i(splat.at("batch"), BATCH);
    gl.drawElementsInstanced(gl.TRIANGLES, 6 * BATCH, gl.UNSIGNED_SHORT, 0, Math.ceil(this.count / BATCH));
  }

  /** Projects all splats into words; returns the width of these, 0 if there is nothing to draw. */
  protected project(resources: Resources, pinhole: Pinhole): number {
    const { gl, escapedSide, setup } = this;
    if (setup === null || !this.hasPicture) return 0;
    const { group, units } = setup;
    gl.bindFramebuffer(gl.FRAMEBUFFER, resources.wordsFrame);
    const program = resources.project(imageSplats(group.sh_degree));
    program.use();
    gl.uniform2fv(program.at("units"), units);
    const { min, step } = group.positions;
    resources.blocks.bindTo(program, "blocks");
    gl.uniform3f(program.at("latticeMin"), ...min);
    gl.uniform2f(program.at("lattice"), step, step / group.blocks.radius);
    this.setPinhole(program, pinhole, centerOf(pinhole), group.dilation);
    const tile = (luma: Texture, texels: Texture, side: number, top: number): void => {
      luma.bindTo(program, "luma");
      texels.bindTo(program, "statics");
      this.drawWords(program, side, side, top, group.columns);
    };
    tile(resources.luma, resources.statics, group.tile, 0);
    if (escapedSide > 0) tile(resources.escapedLuma, resources.escapedStatics, escapedSide, group.tile);
    this.projectSet(resources, pinhole);
    return group.tile;
  }

  /** Projects the set, unless the view is that of the last time. */
  private projectSet(resources: Resources, pinhole: Pinhole): void {
    const { gl, behind } = this;
    const key = JSON.stringify(pinhole);
    if (behind === null || behind.seen === key) return;
    behind.seen = key;
    const { count, dilation } = behind;
    gl.bindFramebuffer(gl.FRAMEBUFFER, resources.setFrame);
    const program = resources.project(arraySplats(0));
    program.use();
    this.setPinhole(program, pinhole, centerOf(pinhole), dilation);
    this.projectArrays(program, resources.set, [0, 3 * count, 7 * count, 10 * count, 11 * count], count, 0);
  }

  /** Projects splats that are in a texture as means, quats, scales, opacities and sh, each from its place on, into rows of
   * words; `top`: the first of them. */
  protected projectArrays(program: Program, values: Texture, places: readonly number[], count: number, top: number): void {
    const { gl } = this;
    values.bindTo(program, "values");
    gl.uniform1iv(program.at("places[0]"), places);
    gl.uniform1i(program.at("count"), count);
    this.drawWords(program, ORDER_WIDTH, Math.ceil(count / ORDER_WIDTH), top, 1);
  }

  /** Fills a rectangle of words, `top` rows below the first ones. `columns`: of the tiles that the splats are in. */
  private drawWords(program: Program, width: number, height: number, top: number, columns: number): void {
    const { gl } = this;
    gl.viewport(0, top, width, height);
    gl.uniform2i(program.at("layoutOf"), width, columns);
    gl.uniform2i(program.at("origin"), 0, top);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Sets what projecting depends on, besides the splats. `eye`: the camera's center in their coordinates. */
  protected setPinhole(program: Program, pinhole: Pinhole, eye: Vector, dilation: number): void {
    const { gl } = this;
    gl.uniform1f(program.at("dilation"), dilation);
    // WebGL matrices are column-major: the rows are passed as columns of the transpose.
    gl.uniformMatrix3fv(program.at("rotation"), true, pinhole.rotation);
    gl.uniform3f(program.at("translation"), ...pinhole.translation);
    gl.uniform3f(program.at("eye"), ...eye);
    gl.uniform4f(program.at("lens"), pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy);
    gl.uniform4f(program.at("limits"), ...fieldLimits(pinhole));
    gl.uniform2f(program.at("size"), pinhole.width, pinhole.height);
  }

  private resolve({ resolve, drawing }: Resources, { x, y, width, height }: Viewport, background: Vector | null): void {
    const { gl } = this;
    gl.viewport(x, y, width, height);
    resolve.use();
    drawing.bindTo(resolve, "drawing");
    gl.uniform4f(resolve.at("viewport"), x, y, width, height);
    gl.uniform4f(resolve.at("background"), ...(background ?? ([0, 0, 0] as const)), background === null ? 0 : 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Starts a timer query if they are supported and the last one has finished. */
  private beginTimer(): boolean {
    const { gl, timer } = this;
    if (timer === null) return false;
    if (this.query !== null) {
      if (gl.getQueryParameter(this.query, gl.QUERY_RESULT_AVAILABLE) !== true) return false;
      if (gl.getParameter(timer.GPU_DISJOINT_EXT) !== true)
        this.gpuTime = (gl.getQueryParameter(this.query, gl.QUERY_RESULT) as number) / 1e6;
    }
    this.query ??= gl.createQuery();
    gl.beginQuery(timer.TIME_ELAPSED_EXT, this.query);
    return true;
  }
}
