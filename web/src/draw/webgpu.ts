/** The WebGPU renderer: it dequantizes, projects, sorts and draws without returning to the page. */

import { takeEarlyAdapter } from "../player/early_files.ts";
import { StreamError } from "../stream/errors.ts";
import type { GroupSetup, Picture } from "../worker/messages.ts";
import { centerOf, fieldLimits, type Pinhole } from "./camera.ts";
import { MAX_VALUES, RadixSort } from "./radix_sort.ts";
import type { GpuTimes, Renderer } from "./renderer.ts";
import { ESCAPE_GROUP, projectShader, RESOLVE_SHADER, SPLAT_SHADER, STATE_WORDS, VIEW_BYTES, VISIBLE_WORD, WORKGROUP } from "./wgsl.ts";

/** Splats per instance: with one splat each, the overhead of instances would exceed the work on splats. */
const BATCH = 1024;
/** Rows that are copied to a buffer start at multiples of this many bytes. */
const ROW_ALIGNMENT = 256;
const DRAWING_FORMAT = "rgba16float";
/** Time stamps: beginning and end of projecting, sorting and drawing. */
const STAMPS = 6;
/** Milliseconds to wait for a graphics driver that does not answer. */
const PATIENCE = 5000;

/**
 * Requests a device with as large textures and buffers as there are.
 *
 * @param software - whether an adapter without a GPU is welcome, too
 * @throws StreamError - there is none; says why
 */
export async function requestWebGPU(software: boolean): Promise<GPUDevice> {
  // Older browsers lack it on all pages, others on insecure ones, whatever the types promise.
  const gpu = (navigator as Partial<Navigator>).gpu;
  if (gpu === undefined) throw new StreamError("this browser does not support it on this page");
  const late = new Promise<null>((resolve) => setTimeout(resolve, PATIENCE, null));
  const adapter = await Promise.race([takeEarlyAdapter() ?? gpu.requestAdapter({ powerPreference: "high-performance" }), late]);
  if (adapter === null) throw new StreamError("there is no suitable graphics driver");
  if (adapter.info.isFallbackAdapter && !software) throw new StreamError("there is no GPU, only software");
  const names = ["maxTextureDimension2D", "maxBufferSize", "maxStorageBufferBindingSize"] as const;
  const device = await Promise.race([
    adapter.requestDevice({
      requiredLimits: Object.fromEntries(names.map((name) => [name, adapter.limits[name]])),
      requiredFeatures: adapter.features.has("timestamp-query") ? ["timestamp-query"] : [],
    }),
    late,
  ]);
  if (device === null) throw new StreamError("the graphics driver does not respond");
  return device;
}

/** Buffers whose sizes depend on the number of splats, and what binds them. */
interface Tile {
  readonly side: number;
  readonly words: GPUBuffer;
  readonly depths: GPUBuffer;
  readonly draw: GPUBindGroup;
}

export class WebGPURenderer implements Renderer {
  readonly name = "WebGPU";
  readonly sorts = true;
  readonly software: boolean;
  readonly maxTexture: number;
  gpuTimes: GpuTimes | null = null;
  visible: number | null = null;
  private readonly device: GPUDevice;
  private readonly context: GPUCanvasContext;
  private readonly format: GPUTextureFormat;
  private readonly tell: (why: string) => void;
  private readonly sort: RadixSort;
  private readonly splats: GPURenderPipeline;
  private readonly resolves = new Map<GPUTextureFormat, GPURenderPipeline>();
  private readonly resolveShader: GPUShaderModule;
  private readonly projects = new Map<string, readonly GPUComputePipeline[]>();
  private readonly view: GPUBuffer;
  private readonly surface: GPUBuffer;
  private readonly state: GPUBuffer;
  private readonly corners: GPUBuffer;
  private readonly sampler: GPUSampler;
  private readonly report: GPUBuffer;
  private readonly stamps: { readonly set: GPUQuerySet; readonly buffer: GPUBuffer } | null;
  private reporting = false;
  private pending = 0;
  private gone = false;
  private setup: GroupSetup | null = null;
  private tile: Tile | null = null;
  private luma: GPUTexture | null = null;
  private drawing: GPUTexture | null = null;
  private units: GPUBuffer | null = null;
  private statics: GPUBuffer | null = null;
  private blocks: GPUBuffer | null = null;
  private escapes: GPUBuffer | null = null;
  private project: GPUBindGroup | null = null;
  private escapePoints = 0;
  private hasPicture = false;

  /**
   * @param tell - called once if the device stops working, with the reason
   * @throws StreamError - the canvas cannot be drawn to
   */
  constructor(canvas: HTMLCanvasElement, device: GPUDevice, tell: (why: string) => void) {
    const context = canvas.getContext("webgpu") as GPUCanvasContext | null;
    if (context === null) throw new StreamError("the browser cannot draw to the page with it");
    this.device = device;
    this.context = context;
    // Older browsers do not tell.
    this.software = (device as Partial<GPUDevice>).adapterInfo?.isFallbackAdapter ?? false;
    this.tell = tell;
    this.maxTexture = device.limits.maxTextureDimension2D;
    this.format = navigator.gpu.getPreferredCanvasFormat();
    context.configure({ device, format: this.format, alphaMode: "premultiplied" });
    void device.lost.then(({ message }) => {
      this.lose(message === "" ? "the device was lost" : message);
    });
    device.addEventListener("uncapturederror", ({ error }) => {
      this.lose(error.message);
    });
    const { UNIFORM, COPY_DST, COPY_SRC, STORAGE, INDIRECT, INDEX, MAP_READ, QUERY_RESOLVE } = GPUBufferUsage;
    this.view = device.createBuffer({ size: VIEW_BYTES, usage: UNIFORM | COPY_DST });
    this.surface = device.createBuffer({ size: 32, usage: UNIFORM | COPY_DST });
    this.state = device.createBuffer({ size: 4 * STATE_WORDS, usage: STORAGE | INDIRECT | COPY_DST | COPY_SRC });
    this.report = device.createBuffer({ size: 8 * STAMPS + 8, usage: MAP_READ | COPY_DST });
    this.corners = device.createBuffer({ size: 2 * 6 * BATCH, usage: INDEX | COPY_DST });
    const corners = Uint16Array.from({ length: 6 * BATCH }, (_, i) => 4 * Math.floor(i / 6) + [0, 1, 2, 2, 1, 3][i % 6]);
    device.queue.writeBuffer(this.corners, 0, corners);
    this.sampler = device.createSampler({ magFilter: "linear", minFilter: "linear" });
    this.stamps = device.features.has("timestamp-query")
      ? {
          set: device.createQuerySet({ type: "timestamp", count: STAMPS }),
          buffer: device.createBuffer({ size: 8 * STAMPS, usage: QUERY_RESOLVE | COPY_SRC }),
        }
      : null;
    this.sort = new RadixSort(device, BATCH);
    const module = device.createShaderModule({ code: SPLAT_SHADER });
    const over = { srcFactor: "one", dstFactor: "one-minus-src-alpha" } as const;
    this.splats = device.createRenderPipeline({
      layout: "auto",
      vertex: { module },
      // 8 bits are not precise enough to accumulate many faint splats.
      fragment: { module, targets: [{ format: DRAWING_FORMAT, blend: { color: over, alpha: over } }] },
    });
    this.resolveShader = device.createShaderModule({ code: RESOLVE_SHADER });
    this.resolvePipeline(this.format);
  }

  get busy(): boolean {
    return this.pending > 0;
  }

  get lost(): boolean {
    return this.gone;
  }

  private lose(why: string): void {
    if (this.gone) return;
    this.gone = true;
    this.tell(why);
  }

  private resolvePipeline(format: GPUTextureFormat): GPURenderPipeline {
    let pipeline = this.resolves.get(format);
    if (pipeline === undefined) {
      const module = this.resolveShader;
      pipeline = this.device.createRenderPipeline({ layout: "auto", vertex: { module }, fragment: { module, targets: [{ format }] } });
      this.resolves.set(format, pipeline);
    }
    return pipeline;
  }

  prepare(profile: "motion" | "planes", shDegree: number): void {
    this.projectPipelines(profile, shDegree);
  }

  /** The pipelines for all splats, and for those with escapes. */
  private projectPipelines(profile: "motion" | "planes", shDegree: number): readonly GPUComputePipeline[] {
    const key = `${profile} ${shDegree}`;
    let pipelines = this.projects.get(key);
    if (pipelines === undefined) {
      const { device } = this;
      const module = device.createShaderModule({ code: projectShader(profile, shDegree) });
      const buffers: (GPUBufferBindingType | null)[] = ["uniform", "uniform", null, "storage", "storage", "storage", "read-only-storage"];
      if (profile === "motion") buffers.push("read-only-storage", "read-only-storage");
      const entries = buffers.map((type, binding) => ({
        binding,
        visibility: GPUShaderStage.COMPUTE,
        ...(type === null ? { texture: {} } : { buffer: { type } }),
      }));
      const layout = device.createPipelineLayout({ bindGroupLayouts: [device.createBindGroupLayout({ entries })] });
      pipelines = ["projectAll", "projectEscapes"].map((entryPoint) =>
        device.createComputePipeline({ layout, compute: { module, entryPoint } }),
      );
      this.projects.set(key, pipelines);
    }
    return pipelines;
  }

  /** The buffer filled with the data, or a larger one if the data do not fit. */
  private fill(buffer: GPUBuffer | null, data: ArrayBufferView<ArrayBuffer>, usage: number): GPUBuffer {
    let target = buffer;
    if (target === null || target.size < data.byteLength) {
      target?.destroy();
      this.project = null;
      const size = Math.ceil(Math.max(data.byteLength, 16) / 16) * 16;
      target = this.device.createBuffer({ size, usage: usage | GPUBufferUsage.COPY_DST });
    }
    this.device.queue.writeBuffer(target, 0, data);
    return target;
  }

  setGroup(setup: GroupSetup): void {
    if (this.gone) return;
    const { device } = this;
    const { maxStorageBufferBindingSize, maxBufferSize } = device.limits;
    const { tile, columns, rows } = setup;
    if (32 * tile ** 2 > Math.min(maxStorageBufferBindingSize, maxBufferSize) || tile ** 2 >= MAX_VALUES) {
      this.lose(`${setup.splats} splats are more than the GPU's buffers can hold`);
      return;
    }
    this.setup = setup;
    this.hasPicture = false;
    this.project = null;
    if (this.luma?.width !== tile * columns || this.luma.height !== tile * rows) {
      this.luma?.destroy();
      this.luma = device.createTexture({
        size: [tile * columns, tile * rows],
        format: "r8unorm",
        usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
      });
    }
    const units = new Float32Array(4 * Math.ceil(setup.units.length / 4));
    units.set(setup.units);
    this.units?.destroy();
    this.units = this.fill(null, units, GPUBufferUsage.UNIFORM);
    if (setup.statics !== null) this.statics = this.fill(this.statics, setup.statics, GPUBufferUsage.STORAGE);
    if (this.tile?.side !== tile) this.tile = this.makeTile(tile);
  }

  private makeTile(side: number): Tile {
    this.tile?.words.destroy();
    this.tile?.depths.destroy();
    const [words, depths] = [32, 4].map((bytes) =>
      this.device.createBuffer({ size: bytes * side ** 2, usage: GPUBufferUsage.STORAGE }),
    );
    const order = this.sort.bind(depths, this.state);
    return { side, words, depths, draw: this.bind(this.splats, [this.view, words, order, this.state]) };
  }

  private bind(
    pipeline: GPUComputePipeline | GPURenderPipeline,
    resources: readonly (GPUBuffer | GPUTextureView | GPUSampler)[],
  ): GPUBindGroup {
    return this.device.createBindGroup({
      layout: pipeline.getBindGroupLayout(0),
      entries: resources.map((resource, binding) => ({
        binding,
        resource: resource instanceof GPUBuffer ? { buffer: resource } : resource,
      })),
    });
  }

  setPicture(picture: Picture): void {
    const { setup, luma } = this;
    if (this.gone || setup === null || luma === null || setup.group !== picture.group) return;
    const size = [luma.width, luma.height];
    this.device.queue.writeTexture({ texture: luma }, picture.luma, { bytesPerRow: luma.width }, size);
    if (picture.blocks !== null) this.blocks = this.fill(this.blocks, picture.blocks, GPUBufferUsage.STORAGE);
    this.setEscapes(picture.escapes);
    this.hasPicture = true;
  }

  /** Uploads the points (one per splat with escapes: pixel, first escape, count), then the escapes. */
  private setEscapes(escapes: Int32Array | null): void {
    const points: number[] = [];
    const count = (escapes?.length ?? 0) / 4;
    for (let i = 0, begin = 0; i < count; i++)
      if (i + 1 === count || escapes![4 * (i + 1)] !== escapes![4 * i]) {
        points.push(escapes![4 * i], begin, i + 1 - begin, 0);
        begin = i + 1;
      }
    const first = 4 + points.length;
    for (let i = 1; i < points.length; i += 4) points[i] += first / 4;
    const list = new Int32Array(first + 4 * count);
    list[0] = this.escapePoints = points.length / 4;
    list.set(points, 4);
    if (escapes !== null) list.set(escapes, first);
    this.escapes = this.fill(this.escapes, list, GPUBufferUsage.STORAGE);
  }

  setOrder(): void {
    // The GPU sorts each drawing.
  }

  draw(pinhole: Pinhole, background: readonly [number, number, number] | null): void {
    if (this.gone) return;
    const { device } = this;
    if (this.drawing?.width !== pinhole.width || this.drawing.height !== pinhole.height) {
      this.drawing?.destroy();
      this.drawing = this.makeDrawing(pinhole);
    }
    const encoder = device.createCommandEncoder();
    const timed = this.stamps !== null && !this.reporting;
    this.drawInto(encoder, this.drawing, pinhole, timed);
    this.resolveInto(encoder, this.drawing, this.context.getCurrentTexture(), background);
    const reported = !this.reporting;
    if (reported) this.encodeReport(encoder, timed);
    device.queue.submit([encoder.finish()]);
    if (reported) void this.readReport(timed);
    this.pending++;
    void device.queue.onSubmittedWorkDone().then(() => {
      this.pending--;
    }, () => undefined);
  }

  async snapshot(
    pinhole: Pinhole,
    background: readonly [number, number, number],
  ): Promise<Uint8ClampedArray<ArrayBuffer>> {
    const { width, height } = pinhole;
    const row = 4 * width;
    const pixels = new Uint8ClampedArray(row * height);
    if (this.gone) return pixels;
    const { device } = this;
    const drawing = this.makeDrawing(pinhole);
    const bytes = device.createTexture({
      size: [width, height],
      format: "rgba8unorm",
      usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC,
    });
    const bytesPerRow = Math.ceil(row / ROW_ALIGNMENT) * ROW_ALIGNMENT;
    const buffer = device.createBuffer({ size: bytesPerRow * height, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const encoder = device.createCommandEncoder();
    this.drawInto(encoder, drawing, pinhole, false);
    this.resolveInto(encoder, drawing, bytes, background);
    encoder.copyTextureToBuffer({ texture: bytes }, { buffer, bytesPerRow }, [width, height]);
    device.queue.submit([encoder.finish()]);
    await buffer.mapAsync(GPUMapMode.READ);
    const raw = new Uint8Array(buffer.getMappedRange());
    for (let y = 0; y < height; y++) pixels.set(raw.subarray(y * bytesPerRow, y * bytesPerRow + row), y * row);
    drawing.destroy();
    bytes.destroy();
    buffer.destroy();
    return pixels;
  }

  async finish(): Promise<void> {
    await this.device.queue.onSubmittedWorkDone();
  }

  dispose(): void {
    this.gone = true;
    this.context.unconfigure();
    this.device.destroy();
  }

  private makeDrawing({ width, height }: Pinhole): GPUTexture {
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING;
    return this.device.createTexture({ size: [width, height], format: DRAWING_FORMAT, usage });
  }

  private drawInto(encoder: GPUCommandEncoder, target: GPUTexture, pinhole: Pinhole, timed: boolean): void {
    const { setup, tile, device } = this;
    const ready = setup !== null && tile !== null && this.hasPicture;
    const stamps = (first: number): { timestampWrites?: GPUComputePassTimestampWrites } =>
      timed
        ? { timestampWrites: { querySet: this.stamps!.set, beginningOfPassWriteIndex: first, endOfPassWriteIndex: first + 1 } }
        : {};
    const state = Uint32Array.of(6 * BATCH, 0, 0, 0, 0, 0xffffffff, 0, 0);
    device.queue.writeBuffer(this.state, 0, state);
    const projecting = encoder.beginComputePass(stamps(0));
    if (ready) this.projectAll(projecting, setup, tile, pinhole);
    projecting.end();
    const sorting = encoder.beginComputePass(stamps(2));
    if (ready) this.sort.encode(sorting);
    sorting.end();
    const drawing = encoder.beginRenderPass({
      colorAttachments: [{ view: target.createView(), loadOp: "clear", storeOp: "store" }],
      ...stamps(4),
    });
    if (ready) {
      drawing.setPipeline(this.splats);
      drawing.setBindGroup(0, tile.draw);
      drawing.setIndexBuffer(this.corners, "uint16");
      drawing.drawIndexedIndirect(this.state, 0);
    }
    drawing.end();
  }

  private projectAll(pass: GPUComputePassEncoder, setup: GroupSetup, tile: Tile, pinhole: Pinhole): void {
    const [all, patch] = this.projectPipelines(setup.profile, setup.shDegree);
    this.device.queue.writeBuffer(this.view, 0, viewData(setup, pinhole));
    if (this.project === null) {
      const resources = [this.view, this.units!, this.luma!.createView(), tile.words, tile.depths, this.state, this.escapes!];
      if (setup.profile === "motion") resources.push(this.statics!, this.blocks!);
      this.project = this.bind(all, resources);
    }
    pass.setBindGroup(0, this.project);
    pass.setPipeline(all);
    pass.dispatchWorkgroups(Math.ceil(setup.tile ** 2 / WORKGROUP));
    if (this.escapePoints > 0) {
      pass.setPipeline(patch);
      pass.dispatchWorkgroups(Math.ceil(this.escapePoints / ESCAPE_GROUP));
    }
  }

  private resolveInto(
    encoder: GPUCommandEncoder,
    drawing: GPUTexture,
    target: GPUTexture,
    background: readonly [number, number, number] | null,
  ): void {
    const color = background ?? ([0, 0, 0] as const);
    const surface = Float32Array.of(...color, background === null ? 0 : 1, target.width, target.height, 0, 0);
    this.device.queue.writeBuffer(this.surface, 0, surface);
    const pipeline = this.resolvePipeline(target.format);
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: target.createView(), loadOp: "clear", storeOp: "store" }],
    });
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, this.bind(pipeline, [drawing.createView(), this.sampler, this.surface]));
    pass.draw(3);
    pass.end();
  }

  private encodeReport(encoder: GPUCommandEncoder, timed: boolean): void {
    this.reporting = true;
    if (timed) {
      const { set, buffer } = this.stamps!;
      encoder.resolveQuerySet(set, 0, STAMPS, buffer, 0);
      encoder.copyBufferToBuffer(buffer, 0, this.report, 0, 8 * STAMPS);
    }
    encoder.copyBufferToBuffer(this.state, 4 * VISIBLE_WORD, this.report, 8 * STAMPS, 4);
  }

  private async readReport(timed: boolean): Promise<void> {
    try {
      await this.report.mapAsync(GPUMapMode.READ);
    } catch {
      return; // the device is lost, and that is reported with the reason
    }
    const range = this.report.getMappedRange();
    this.visible = new Uint32Array(range, 8 * STAMPS, 1)[0];
    if (timed) {
      const t = Array.from(new BigUint64Array(range, 0, STAMPS), (stamp) => Number(stamp) / 1e6);
      this.gpuTimes = { project: t[1] - t[0], sort: t[3] - t[2], all: t[5] - t[0] };
    }
    this.report.unmap();
    this.reporting = false;
  }
}

/** The bytes of the shaders' `View`. */
function viewData(setup: GroupSetup, pinhole: Pinhole): ArrayBuffer {
  const data = new ArrayBuffer(VIEW_BYTES);
  const floats = new Float32Array(data);
  const words = new Uint32Array(data);
  const { rotation } = pinhole;
  // Matrices are column-major, with columns padded to four.
  for (let k = 0; k < 9; k++) floats[4 * (k % 3) + Math.floor(k / 3)] = rotation[k];
  floats.set(pinhole.translation, 12);
  floats.set(centerOf(pinhole), 16);
  floats.set([pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy], 20);
  floats.set(fieldLimits(pinhole), 24);
  if (setup.lattice !== null) floats.set([...setup.lattice.min, setup.lattice.step], 28);
  floats.set([pinhole.width, pinhole.height, setup.lattice?.ratio ?? 0], 32);
  const mirrored = setup.mirrored.reduce((bits, yes, axis) => bits | (Number(yes) << axis), 0);
  words.set([setup.tile, setup.columns, setup.splats, mirrored, BATCH], 35);
  floats[40] = setup.dilation;
  return data;
}
