/** Canvases, and programs and textures of WebGL2. */

import { StreamError } from "../stream/errors.ts";

const MAX_PIXEL_RATIO = 2; // phones have up to four times as many pixels as a viewer can resolve

/** Canvas pixels for each CSS pixel. */
export const pixelRatio = (): number => Math.min(window.devicePixelRatio || 1, MAX_PIXEL_RATIO);

/** Width and height of a canvas on the page, in its pixels. */
export function sizeOf({ clientWidth, clientHeight }: HTMLCanvasElement): [number, number] {
  const ratio = pixelRatio();
  return [Math.max(1, Math.round(clientWidth * ratio)), Math.max(1, Math.round(clientHeight * ratio))];
}

/** Gives a canvas a size. One of the same size keeps its content. */
export function resize(canvas: HTMLCanvasElement | OffscreenCanvas, width: number, height: number): void {
  if (canvas.width === width && canvas.height === height) return;
  canvas.width = width;
  canvas.height = height;
}

/** The WebGL2 context of a canvas. StreamError: the browser does not support it. */
export function contextOf(canvas: HTMLCanvasElement, options: WebGLContextAttributes): WebGL2RenderingContext {
  const gl = canvas.getContext("webgl2", options);
  if (gl === null) throw new StreamError("This browser does not support WebGL2, which the player requires.");
  return gl;
}

export class Program {
  readonly handle: WebGLProgram;
  private checked = false;
  private readonly places = new Map<string, WebGLUniformLocation | null>();

  constructor(private readonly gl: WebGL2RenderingContext, vertex: string, fragment: string) {
    this.handle = gl.createProgram();
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, vertex],
      [gl.FRAGMENT_SHADER, fragment],
    ] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(this.handle, shader);
      gl.deleteShader(shader);
    }
    gl.linkProgram(this.handle);
  }

  /** Drivers compile in the background until the status is queried. */
  use(): void {
    const { gl } = this;
    if (!this.checked && gl.getProgramParameter(this.handle, gl.LINK_STATUS) !== true && !gl.isContextLost()) {
      const logs = (gl.getAttachedShaders(this.handle) ?? []).map((shader) => gl.getShaderInfoLog(shader) ?? "");
      throw new StreamError(`The graphics driver cannot compile the player's shader: ${logs.join(" ").slice(0, 300)}`);
    }
    this.checked = true;
    gl.useProgram(this.handle);
  }

  at(name: string): WebGLUniformLocation | null {
    let place = this.places.get(name);
    if (place === undefined) {
      place = this.gl.getUniformLocation(this.handle, name);
      this.places.set(name, place);
    }
    return place;
  }
}

/** A texture without filtering; its memory is reused while its size does not change. */
export class Texture {
  readonly handle: WebGLTexture;
  width = 0;
  height = 0;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly unit: number,
    private readonly format: readonly [internal: number, format: number, type: number],
    filter: number = gl.NEAREST,
  ) {
    this.handle = gl.createTexture();
    this.bind();
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  bind(): void {
    this.gl.activeTexture(this.gl.TEXTURE0 + this.unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.handle);
  }

  /** Makes it the input of a program. */
  bindTo(program: Program, name: string): void {
    this.bind();
    this.gl.uniform1i(program.at(name), this.unit);
  }

  /** Allocates the texture if needed; true if it is new. */
  resize(width: number, height: number): boolean {
    this.bind();
    if (width === this.width && height === this.height) return false;
    const { gl } = this;
    const [internal, format, type] = this.format;
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, type, null);
    this.width = width;
    this.height = height;
    return true;
  }

  /** Fills the first texels, all by default: complete rows, then the rest of the last one. */
  fill(data: Uint8Array | Uint32Array | Float32Array, texels = this.width * this.height): void {
    const { gl, width } = this;
    const [, format, type] = this.format;
    const channels = format === gl.RGBA || format === gl.RGBA_INTEGER ? 4 : 1;
    const rows = Math.floor(texels / width);
    const rest = texels - rows * width;
    this.bind();
    if (rows > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, rows, format, type, data);
    if (rest > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, rows, rest, 1, format, type, data, channels * rows * width);
  }
}
