/**
 * Sorts splats by depth on the GPU: two passes of a stable radix sort with eight bits each (least significant digit first;
 * count, scan, scatter). The order is the same on each run. It needs neither subgroups nor workgroups that wait for each
 * other, which WebGPU does not guarantee.
 *
 * Merrill and Grimshaw, "Revisiting Sorting for GPGPU Stream Architectures", PACT 2010.
 */

import { STATE, WORKGROUP } from "./wgsl.ts";

const DIGITS = 256;
/** Values that one workgroup sorts, in rounds of one value per invocation. */
const ROUNDS = 8;
const SHARE = ROUNDS * WORKGROUP;
/** Between the passes, a value has 8 bits of its key and 24 of its index. */
export const MAX_VALUES = 1 << 24;

const SHADER = `${STATE}
override last: bool; // whether this is the pass of the high digits
struct Size { values: u32, groups: u32, batch: u32 }
@group(0) @binding(0) var<uniform> size: Size;
@group(0) @binding(1) var<storage, read_write> state: State;
@group(0) @binding(2) var<storage, read> source: array<u32>;
@group(0) @binding(3) var<storage, read_write> sorted: array<u32>;
// [group][digit]: number of values, after the scan their start within the digit; in the last row, each digit's start.
@group(0) @binding(4) var<storage, read_write> counts: array<u32>;

// A 16-bit key: farthest first, then what is not visible. Returns the digit, and the value to write.
fn load(i: u32) -> vec2u {
  let word = source[i];
  if (last) { return vec2u(word >> 24u, word & 0xffffffu); }
  var key = 0xffffu;
  if (word != 0u) {
    let far = bitcast<f32>(atomicLoad(&state.farthest));
    let range = far - bitcast<f32>(atomicLoad(&state.nearest));
    key = min(0xfffeu, u32((far - bitcast<f32>(word)) * select(0.0, 65534.0 / range, range > 0.0)));
  }
  return vec2u(key & 255u, ((key >> 8u) << 24u) | i);
}

var<workgroup> digits: array<atomic<u32>, ${DIGITS}>;
var<workgroup> seen: atomic<u32>;

@compute @workgroup_size(${WORKGROUP})
fn count(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3u) {
  for (var round = 0u; round < ${ROUNDS}u; round++) {
    let i = group.x * ${SHARE}u + round * ${WORKGROUP}u + local;
    if (i < size.values) {
      atomicAdd(&digits[load(i).x], 1u);
      if (!last && source[i] != 0u) { atomicAdd(&seen, 1u); }
    }
  }
  workgroupBarrier();
  counts[group.x * ${DIGITS}u + local] = atomicLoad(&digits[local]);
  if (!last && local == 0u) { atomicAdd(&state.visible, atomicLoad(&seen)); }
}

var<workgroup> sums: array<u32, ${DIGITS}>;

@compute @workgroup_size(${DIGITS})
fn scan(@builtin(local_invocation_index) local: u32) {
  var total = 0u;
  for (var group = 0u; group < size.groups; group++) {
    let at = group * ${DIGITS}u + local;
    let here = counts[at];
    counts[at] = total;
    total += here;
  }
  sums[local] = total;
  for (var step = 1u; step < ${DIGITS}u; step *= 2u) {
    workgroupBarrier();
    var before = 0u;
    if (local >= step) { before = sums[local - step]; }
    workgroupBarrier();
    sums[local] += before;
  }
  counts[size.groups * ${DIGITS}u + local] = sums[local] - total;
  if (last && local == 0u) { atomicStore(&state.instanceCount, (atomicLoad(&state.visible) + size.batch - 1u) / size.batch); }
}

// For each digit, which invocations have it in this round.
var<workgroup> having: array<atomic<u32>, ${(DIGITS * WORKGROUP) / 32}>;
var<workgroup> starts: array<u32, ${DIGITS}>;
const WORDS = ${WORKGROUP / 32}u;

@compute @workgroup_size(${WORKGROUP})
fn scatter(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3u) {
  starts[local] = counts[group.x * ${DIGITS}u + local] + counts[size.groups * ${DIGITS}u + local];
  let bit = 1u << (local & 31u);
  for (var round = 0u; round < ${ROUNDS}u; round++) {
    let i = group.x * ${SHARE}u + round * ${WORKGROUP}u + local;
    let inside = i < size.values;
    var value = vec2u();
    if (inside) {
      value = load(i);
      atomicOr(&having[value.x * WORDS + (local >> 5u)], bit);
    }
    workgroupBarrier();
    if (inside) {
      var rank = countOneBits(atomicLoad(&having[value.x * WORDS + (local >> 5u)]) & (bit - 1u));
      for (var word = 0u; word < (local >> 5u); word++) { rank += countOneBits(atomicLoad(&having[value.x * WORDS + word])); }
      sorted[starts[value.x] + rank] = value.y;
    }
    workgroupBarrier();
    var total = 0u;
    for (var word = 0u; word < WORDS; word++) {
      total += countOneBits(atomicLoad(&having[local * WORDS + word]));
      atomicStore(&having[local * WORDS + word], 0u);
    }
    starts[local] += total;
    workgroupBarrier();
  }
}`;

export class RadixSort {
  private readonly device: GPUDevice;
  private readonly batch: number;
  private readonly layout: GPUBindGroupLayout;
  private readonly pipelines: readonly (readonly GPUComputePipeline[])[];
  private buffers: GPUBuffer[] = [];
  private bindings: readonly GPUBindGroup[] = [];
  private groups = 0;

  /** @param batch - visible splats per instance of the indirect draw */
  constructor(device: GPUDevice, batch: number) {
    this.device = device;
    this.batch = batch;
    const kinds: GPUBufferBindingType[] = ["uniform", "storage", "read-only-storage", "storage", "storage"];
    this.layout = device.createBindGroupLayout({
      entries: kinds.map((type, binding) => ({ binding, visibility: GPUShaderStage.COMPUTE, buffer: { type } })),
    });
    const module = device.createShaderModule({ code: SHADER });
    const layout = device.createPipelineLayout({ bindGroupLayouts: [this.layout] });
    this.pipelines = [0, 1].map((last) =>
      ["count", "scan", "scatter"].map((entryPoint) =>
        device.createComputePipeline({ layout, compute: { module, entryPoint, constants: { last } } }),
      ),
    );
  }

  /**
   * Prepares sorting these depths.
   *
   * @param depths - bits of positive floats, 0 for what is not visible
   * @param state - see STATE; with the smallest and largest depth. `visible` and `instanceCount` are written
   * @returns the buffer for the sorted indices, those of visible splats first
   */
  bind(depths: GPUBuffer, state: GPUBuffer): GPUBuffer {
    this.dispose();
    const { device } = this;
    const values = depths.size / 4;
    this.groups = Math.ceil(values / SHARE);
    const [middle, order, counts] = [4 * values, 4 * values, 4 * DIGITS * (this.groups + 1)].map((size) =>
      device.createBuffer({ size, usage: GPUBufferUsage.STORAGE }),
    );
    const size = device.createBuffer({ size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    device.queue.writeBuffer(size, 0, Uint32Array.of(values, this.groups, this.batch, 0));
    this.buffers = [middle, order, counts, size];
    this.bindings = [
      [depths, middle],
      [middle, order],
    ].map(([from, to]) =>
      device.createBindGroup({
        layout: this.layout,
        entries: [size, state, from, to, counts].map((buffer, binding) => ({ binding, resource: { buffer } })),
      }),
    );
    return order;
  }

  encode(pass: GPUComputePassEncoder): void {
    this.pipelines.forEach(([count, scan, scatter], number) => {
      pass.setBindGroup(0, this.bindings[number]);
      pass.setPipeline(count);
      pass.dispatchWorkgroups(this.groups);
      pass.setPipeline(scan);
      pass.dispatchWorkgroups(1);
      pass.setPipeline(scatter);
      pass.dispatchWorkgroups(this.groups);
    });
  }

  dispose(): void {
    for (const buffer of this.buffers) buffer.destroy();
  }
}
