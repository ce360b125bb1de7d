/**
 * The WebGPU shaders: the same arithmetic as in `shaders.ts`.
 *
 * 1. `project` (compute) dequantizes and projects each splat: from the luma of all its channels to eight words (position,
 *    inverse covariance, color, opacity) and a depth.
 * 2. The depths are sorted (`radix_sort.ts`).
 * 3. `SPLAT` draws the quads of the visible splats in that order.
 */

import { ALPHA_MAX, ALPHA_MIN, NEAR } from "./renderer.ts";
import { colorSum } from "./shaders.ts";

/** Invocations in a workgroup of compute shaders. */
export const WORKGROUP = 256;
/** Of the one for escapes. */
export const ESCAPE_GROUP = 64;

/** Per drawing; written by `WebGPURenderer`. */
const VIEW = `
struct View {
  rotation: mat3x3f,
  translation: vec3f,
  eye: vec3f,
  lens: vec4f, // fx, fy, cx, cy
  limits: vec4f, // minimum and maximum x / z, then y / z
  lattice: vec4f, // minimum, step
  size: vec2f,
  ratio: f32, // lattice step / radius of the blocks
  tile: u32,
  columns: u32,
  splats: u32,
  mirrored: u32, // bit k: the low byte of axis k is mirrored
  batch: u32,
  dilation: f32, // added to the diagonal of every projected covariance, square pixels
}
`;
/** Size of `View` in bytes. */
export const VIEW_BYTES = 176;

/** Results that later passes and the page read; the first five words are those of an indirect indexed draw. */
export const STATE = `
struct State {
  indexCount: u32, instanceCount: atomic<u32>, firstIndex: u32, baseVertex: u32, firstInstance: u32,
  nearest: atomic<u32>, farthest: atomic<u32>, visible: atomic<u32>, // depths as bits of positive floats, which sort alike
}
`;
export const STATE_WORDS = 8;
export const VISIBLE_WORD = 7;

const MOTION = (shDegree: number): string => `
@group(0) @binding(7) var<storage, read> statics: array<vec4u>;
@group(0) @binding(8) var<storage, read> blocks: array<vec4f>;

fn multiply(a: vec4f, b: vec4f) -> vec4f { // wxyz
  return vec4f(a.x * b.x - dot(a.yzw, b.yzw), a.x * b.yzw + b.x * a.yzw + cross(a.yzw, b.yzw));
}

fn dequantize() -> bool {
  let s = statics[here];
  if (s.w == 0u) { return false; }
  let cell = vec3f(vec3u(s.x & 65535u, s.x >> 16u, s.y & 65535u));
  let at = 5u * s.z;
  let a0 = blocks[at]; let a1 = blocks[at + 1u]; let a2 = blocks[at + 2u]; let a3 = blocks[at + 3u];
  let u = (cell - vec3f(a0.w, a1.w, a2.w)) * view.ratio;
  let moved = a3.xyz + u.x * a0.xyz + u.y * a1.xyz + u.z * a2.xyz;
  mean = view.lattice.xyz + (cell + 0.5) * view.lattice.w + moved + exp2(f32(s.y >> 16u)) * vec3f(v(0), v(1), v(2));
  let p = vec3f(v(3), v(4), v(5));
  let square = dot(p, p);
  quat = multiply(blocks[at + 4u], vec4f(1.0 - square, 2.0 * p) / (1.0 + square));
  scale = exp(vec3f(v(6), v(7), v(8)));
  opacity = v(9);
  return true;
}

fn harmonics(d: vec3f) -> vec3f {
  var color = vec3f(); // luma, orange, green
  ${colorSum(shDegree, 10)}
  return vec3f(color.x + color.y - color.z, color.x + color.z, color.x - color.y - color.z);
}`;

const PLANES = (shDegree: number): string => {
  const opacity = 6 + 3 * (shDegree + 1) ** 2;
  return `
fn place(axis: u32) -> f32 {
  let high = byteAt(2u * axis);
  var low = byteAt(2u * axis + 1u);
  if (((view.mirrored >> axis) & 1u) == 1u && (u32(high) & 1u) == 1u) { low = 255.0 - low; }
  return units[axis].x + high * units[axis].y + low * units[axis].w;
}

fn dequantize() -> bool {
  if (here >= view.splats) { return false; }
  mean = vec3f(place(0), place(1), place(2));
  opacity = v(${opacity});
  scale = exp(vec3f(v(${opacity + 1}), v(${opacity + 2}), v(${opacity + 3})));
  quat = vec4f(v(${opacity + 4}), v(${opacity + 5}), v(${opacity + 6}), v(${opacity + 7}));
  let size = length(quat);
  if (!(size > 0.0)) { return false; }
  quat /= size;
  return true;
}

fn harmonics(d: vec3f) -> vec3f {
  var color = vec3f();
  ${colorSum(shDegree, 6)}
  return color;
}`;
};

/**
 * The projection, with two entry points: `projectAll` has one invocation per pixel of the tile, `projectEscapes` one per splat with
 * escapes, which are read in place of the picture's codes.
 *
 * Words of a splat: x, y in pixels (float bits); inverse covariance xx, xy, yy (float bits); red and green, blue and opacity
 * (half floats); 0. Its depth is 0 if it is not visible.
 */
export function projectShader(profile: "motion" | "planes", shDegree: number): string {
  // In the profile planes, each position coordinate has two planes.
  const channels = (profile === "motion" ? 10 : 14) + 3 * (shDegree + 1) ** 2;
  return `${VIEW}${STATE}
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> units: array<vec4f, ${Math.ceil(channels / 2)}>; // offset and step of two channels each
@group(0) @binding(2) var luma: texture_2d<f32>;
@group(0) @binding(3) var<storage, read_write> words: array<vec4u>;
@group(0) @binding(4) var<storage, read_write> depths: array<u32>;
@group(0) @binding(5) var<storage, read_write> state: State;
@group(0) @binding(6) var<storage, read> escapes: array<vec4i>; // points (pixel, first, count), then (pixel, channel, code)

var<private> here: u32;
var<private> range: vec2u;
var<private> mean: vec3f;
var<private> scale: vec3f;
var<private> quat: vec4f;
var<private> opacity: f32;
var<workgroup> nearest: atomic<u32>;
var<workgroup> farthest: atomic<u32>;

fn byteAt(c: u32) -> f32 {
  let corner = vec2u(c % view.columns, c / view.columns) * view.tile;
  return floor(textureLoad(luma, corner + vec2u(here % view.tile, here / view.tile), 0).r * 255.0 + 0.5);
}
fn code(c: u32) -> f32 {
  for (var i = range.x; i < range.y; i++) {
    if (u32(escapes[i].y) == c) { return f32(escapes[i].z); }
  }
  return byteAt(c);
}
fn v(c: u32) -> f32 {
  let both = units[c >> 1u];
  let unit = select(both.xy, both.zw, (c & 1u) == 1u);
  return code(c) * unit.y + unit.x;
}
${profile === "motion" ? MOTION(shDegree) : PLANES(shDegree)}

/** Writes the splat's words; returns the bits of its depth, 0 if it is not visible. */
fn project() -> u32 {
  if (!dequantize()) { return 0u; }
  let local = view.rotation * mean + view.translation;
  if (!(local.z >= ${NEAR}) || !(opacity >= ${ALPHA_MIN})) { return 0u; }
  opacity = min(opacity, 1.0);
  let w = quat.x; let x = quat.y; let y = quat.z; let z = quat.w;
  let turned = view.rotation * mat3x3f(
    1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
  let flat = local.xy / local.z;
  let bent = clamp(flat, view.limits.xz, view.limits.yw);
  let focal = view.lens.xy / local.z;
  // Rows of Jacobian * rotation * axes: the splat's axes in image space.
  let ax = scale.x * turned[0]; let ay = scale.y * turned[1]; let az = scale.z * turned[2];
  let u = focal.x * (vec3f(ax.x, ay.x, az.x) - bent.x * vec3f(ax.z, ay.z, az.z));
  let t = focal.y * (vec3f(ax.y, ay.y, az.y) - bent.y * vec3f(ax.z, ay.z, az.z));
  let xx = dot(u, u); let xy = dot(u, t); let yy = dot(t, t);
  let normal = cross(u, t);
  let det = dot(normal, normal) + view.dilation * (xx + yy) + view.dilation * view.dilation;
  let cov = vec3f(xx + view.dilation, xy, yy + view.dilation);
  let place = flat * view.lens.xy + view.lens.zw;
  let reach = sqrt(2.0 * log(opacity / ${ALPHA_MIN}));
  let half = reach * sqrt(cov.xz);
  if (any(place + half <= vec2f()) || any(place - half >= view.size)) { return 0u; }
  if (!(det > 0.0) || !(det < 3e38)) { return 0u; }
  let conic = vec3f(cov.z, -cov.y, cov.x) / det;
  let color = max(harmonics(normalize(mean - view.eye)) + 0.5, vec3f());
  words[2u * here] = vec4u(bitcast<vec2u>(place), bitcast<vec2u>(conic.xy));
  words[2u * here + 1u] = vec4u(bitcast<u32>(conic.z), pack2x16float(color.rg), pack2x16float(vec2f(color.b, opacity)), 0u);
  return bitcast<u32>(local.z);
}

@compute @workgroup_size(${WORKGROUP})
fn projectAll(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local: u32) {
  if (local == 0u) { atomicStore(&nearest, 0xffffffffu); }
  workgroupBarrier();
  here = id.x;
  if (here < view.tile * view.tile) {
    let depth = project();
    depths[here] = depth;
    if (depth != 0u) { atomicMin(&nearest, depth); atomicMax(&farthest, depth); }
  }
  workgroupBarrier();
  if (local == 0u) { atomicMin(&state.nearest, atomicLoad(&nearest)); atomicMax(&state.farthest, atomicLoad(&farthest)); }
}

@compute @workgroup_size(${ESCAPE_GROUP})
fn projectEscapes(@builtin(global_invocation_id) id: vec3u) {
  let point = escapes[id.x + 1u];
  if (i32(id.x) >= escapes[0].x) { return; }
  here = u32(point.x);
  range = vec2u(vec2i(point.y, point.y + point.z));
  let depth = project();
  depths[here] = depth;
  if (depth != 0u) { atomicMin(&state.nearest, depth); atomicMax(&state.farthest, depth); }
}`;
}

/** A quad per splat along its axes in image space, out to where its alpha falls to 1/255. */
export const SPLAT_SHADER = `${VIEW}
struct Corner {
  @builtin(position) position: vec4f,
  @location(0) @interpolate(flat) paint: vec4f, // color and opacity
  @location(1) @interpolate(flat) conic: vec3f,
  @location(2) offset: vec2f,
}
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> words: array<vec4u>;
@group(0) @binding(2) var<storage, read> order: array<u32>; // farthest first
@group(0) @binding(3) var<storage, read> state: array<u32>;

@vertex
fn corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
  var out: Corner;
  out.position = vec4f(2.0, 2.0, 2.0, 1.0);
  let number = instance * view.batch + (vertex >> 2u);
  if (number >= state[${VISIBLE_WORD}]) { return out; }
  let splat = order[number];
  let a = words[2u * splat];
  let b = words[2u * splat + 1u];
  let place = bitcast<vec2f>(a.xy);
  let conic = vec3f(bitcast<vec2f>(a.zw), bitcast<f32>(b.x));
  let bo = unpack2x16float(b.z);
  out.conic = conic;
  out.paint = vec4f(unpack2x16float(b.y), bo);
  // Axes of the ellipse: eigenvectors of the inverse covariance.
  let middle = 0.5 * (conic.x + conic.z);
  let most = middle + length(vec2f(0.5 * (conic.x - conic.z), conic.y));
  let least = max((conic.x * conic.z - conic.y * conic.y) / most, 1e-12);
  var axis = select(vec2f(0.0, 1.0), vec2f(1.0, 0.0), conic.x < conic.z);
  if (abs(conic.y) > 1e-12) { axis = normalize(vec2f(conic.y, least - conic.x)); }
  let reach = sqrt(2.0 * log(max(bo.y * 255.0, 1.0))) + 0.01;
  let side = vec2f(vec2u(vertex & 1u, (vertex >> 1u) & 1u)) * 2.0 - 1.0;
  out.offset = reach * (side.x * axis * inverseSqrt(least) + side.y * vec2f(-axis.y, axis.x) * inverseSqrt(most));
  let pixel = (place + out.offset) / view.size;
  out.position = vec4f(pixel.x * 2.0 - 1.0, 1.0 - pixel.y * 2.0, 0.0, 1.0);
  return out;
}

@fragment
fn paint(in: Corner) -> @location(0) vec4f {
  let o = in.offset;
  let sigma = 0.5 * (in.conic.x * o.x * o.x + in.conic.z * o.y * o.y) + in.conic.y * o.x * o.y;
  let alpha = min(in.paint.a * exp(-max(sigma, 0.0)), ${ALPHA_MAX});
  if (alpha < ${ALPHA_MIN}) { discard; }
  return vec4f(in.paint.rgb * alpha, alpha);
}`;

/** Copies the drawing to the canvas, scaled, over the background. */
export const RESOLVE_SHADER = `
struct Surface { background: vec4f, canvas: vec4f } // alpha 0: no background
@group(0) @binding(0) var drawing: texture_2d<f32>;
@group(0) @binding(1) var linear: sampler;
@group(0) @binding(2) var<uniform> surface: Surface;

@vertex
fn full(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
  return vec4f(select(-1.0, 3.0, vertex == 1u), select(-1.0, 3.0, vertex == 2u), 0.0, 1.0);
}

@fragment
fn resolve(@builtin(position) at: vec4f) -> @location(0) vec4f {
  let front = textureSampleLevel(drawing, linear, at.xy / surface.canvas.xy, 0.0);
  let rest = 1.0 - front.a;
  return vec4f(front.rgb + rest * surface.background.rgb * surface.background.a, front.a + rest * surface.background.a);
}`;
