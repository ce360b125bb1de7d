/**
 * The shaders. Rendering takes two passes:
 *
 * 1. `project` dequantizes and projects each splat once, one fragment per pixel of the splats' tile: from the luma of all
 *    its channels to eight words (position, inverse covariance, color, opacity, size).
 * 2. `splat` draws the quads in the sorted order, reading these words.
 *
 * Splats with escapes (codes that do not fit into a byte) are projected a second time, from a small image of floats, by the
 * same program: another one would have to be compiled when the first of them appear, amid playback.
 */

import { tilesOf } from "../stream/layout.ts";
import { NEAR, OF_SET } from "../stream/sort.ts";

/** Maximum alpha of a splat at a pixel, and the minimum that is rendered, as in studio.rasterizer. */
const ALPHA_MAX = 0.99;
const ALPHA_MIN = 1 / 255;

/** Splats in a row of the order, and of words of splats that are in no image. */
export const ORDER_WIDTH = 1024;

const float = (value: number): string => (Number.isInteger(value) ? `${value}.0` : String(value));

export const HEAD = `#version 300 es
precision highp float; precision highp int;
precision highp sampler2D; precision highp usampler2D; precision highp isampler2D;
`;

/** A triangle that covers the viewport. */
export const FULL_VERTEX = `${HEAD}
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

/** Real spherical harmonics, in the order and with the signs of studio.rasterizer.harmonics. */
const HARMONICS = [
  "0.28209479177387814",
  "-0.4886025119029199 * d.y",
  "0.4886025119029199 * d.z",
  "-0.4886025119029199 * d.x",
  "1.0925484305920792 * d.x * d.y",
  "-1.0925484305920792 * d.y * d.z",
  "0.31539156525252005 * (3.0 * d.z * d.z - 1.0)",
  "-1.0925484305920792 * d.x * d.z",
  "0.5462742152960396 * (d.x * d.x - d.y * d.y)",
  "-0.5900435899266435 * d.y * (3.0 * d.x * d.x - d.y * d.y)",
  "2.890611442640554 * d.x * d.y * d.z",
  "-0.4570457994644658 * d.y * (5.0 * d.z * d.z - 1.0)",
  "0.3731763325901154 * d.z * (5.0 * d.z * d.z - 3.0)",
  "-0.4570457994644658 * d.x * (5.0 * d.z * d.z - 1.0)",
  "1.445305721320277 * d.z * (d.x * d.x - d.y * d.y)",
  "-0.5900435899266435 * d.x * (d.x * d.x - 3.0 * d.y * d.y)",
];

/** Sum over the coefficients, each read from three channels, starting at `first`. */
function colorSum(shDegree: number, first: number): string {
  return HARMONICS.slice(0, (shDegree + 1) ** 2)
    .map((basis, k) => `color += (${basis}) * vec3(v(${first + 3 * k}), v(${first + 3 * k + 1}), v(${first + 3 * k + 2}));`)
    .join("\n  ");
}

/** Reads channels of the image: `v(c)` is the value of channel c. */
function channels(count: number): string {
  return `
uniform sampler2D luma;
uniform vec2 units[${count}];
uniform ivec2 layoutOf; // side of a tile, columns
ivec2 here;
float v(int c) {
  ivec2 corner = ivec2(c % layoutOf.y, c / layoutOf.y) * layoutOf.x;
  return floor(texelFetch(luma, corner + here, 0).r * 255.0 + 0.5) * units[c].y + units[c].x;
}`;
}

const READ = (shDegree: number): string => {
  const { means, scales, opacities, sh } = tilesOf(shDegree);
  return `
uniform usampler2D statics;
uniform sampler2D blocks;
uniform vec3 latticeMin;
uniform vec2 lattice; // step; step / radius

bool read(out vec3 mean, out mat3 axes, out float opacity) {
  uvec4 s = texelFetch(statics, here, 0);
  if (s.w == 0u) return false;
  vec3 cell = vec3(s.x & 65535u, s.x >> 16, s.y & 65535u);
  int block = int(s.z);
  ivec2 at = ivec2((block & 127) * 5, block >> 7);
  vec4 a0 = texelFetch(blocks, at, 0), a1 = texelFetch(blocks, at + ivec2(1, 0), 0);
  vec4 a2 = texelFetch(blocks, at + ivec2(2, 0), 0), a3 = texelFetch(blocks, at + ivec2(3, 0), 0);
  vec4 turn = texelFetch(blocks, at + ivec2(4, 0), 0);
  vec3 u = (cell - vec3(a0.w, a1.w, a2.w)) * lattice.y;
  vec3 moved = a3.xyz + u.x * a0.xyz + u.y * a1.xyz + u.z * a2.xyz;
  mean = latticeMin + (cell + 0.5) * lattice.x + moved + exp2(float(s.y >> 16)) * vec3(v(${means}), v(${means + 1}), v(${means + 2}));
  float xx = v(${scales}), yy = v(${scales + 1}), zz = v(${scales + 2});
  float xy = v(${scales + 3}), xz = v(${scales + 4}), yz = v(${scales + 5});
  mat3 shape = mat3(xx, xy, xz, xy, yy, yz, xz, yz, zz);
  axes = turned(turn) * (shape * shape);
  opacity = v(${opacities});
  return true;
}

vec3 harmonics(vec3 d) {
  vec3 color = vec3(0.0); // luma, orange, green
  ${colorSum(shDegree, sh)}
  return vec3(color.x + color.y - color.z, color.x + color.z, color.x - color.y - color.z);
}`;
};

/** Reads splats from an image. */
export const imageSplats = (shDegree: number): string => channels(tilesOf(shDegree).count) + READ(shDegree);

/** Values in a row of the texture that holds splats as arrays. */
export const ARRAY_WIDTH = 4096;

/** Splats as arrays of floats, one after the other in a texture. */
export const arraySplats = (shDegree: number): string => `
uniform sampler2D values;
uniform int count;
uniform int places[5]; // of means, quats, scales, opacities and colors in the texture
uniform ivec2 layoutOf; // splats in a row
ivec2 here;
int number;
float at(int i) { return texelFetch(values, ivec2(i & ${ARRAY_WIDTH - 1}, i / ${ARRAY_WIDTH}), 0).r; }
vec3 three(int i) { return vec3(at(i), at(i + 1), at(i + 2)); }

bool read(out vec3 mean, out mat3 axes, out float opacity) {
  number = here.y * layoutOf.x + here.x;
  if (number >= count) return false;
  mean = three(places[0] + 3 * number);
  vec4 quat = vec4(at(places[1] + 4 * number), three(places[1] + 4 * number + 1));
  vec3 scale = three(places[2] + 3 * number);
  opacity = at(places[3] + number);
  axes = turned(quat);
  axes = mat3(scale.x * axes[0], scale.y * axes[1], scale.z * axes[2]);
  return true;
}

vec3 harmonics(vec3 d) {
  int first = places[4] + ${3 * (shDegree + 1) ** 2} * number;
  vec3 color = vec3(0.0);
  ${HARMONICS.slice(0, (shDegree + 1) ** 2).map((basis, k) => `color += (${basis}) * three(first + ${3 * k});`).join("\n  ")}
  return color;
}`;

/** The first pass. `splats`: the program's part that reads them. Words written: x, y in pixels (float bits); inverse covariance
 * xx, xy, yy (float bits); red and green, blue and opacity (half floats); 1 if the splat is visible. */
export function projectFragment(splats: string): string {
  return `${HEAD}
layout(location = 0) out uvec4 first;
layout(location = 1) out uvec4 second;
uniform mat3 rotation;
uniform vec3 translation, eye;
uniform vec4 lens; // fx, fy, cx, cy
uniform vec4 limits; // minimum and maximum x / z, then y / z
uniform float dilation; // added to the diagonal of every projected covariance, square pixels
uniform vec2 size;
uniform ivec2 origin; // where the words of the first splat go

mat3 turned(vec4 q) { // rotation of a unit quaternion
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(
    1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

/* A splat's center and opacity, and three axes: its covariance is axes * transpose(axes). */
${splats}

void main() {
  here = ivec2(gl_FragCoord.xy) - origin;
  first = uvec4(0u);
  second = uvec4(0u);
  vec3 mean;
  mat3 axes;
  float opacity;
  if (!read(mean, axes, opacity)) return;
  vec3 local = rotation * mean + translation;
  if (!(local.z >= ${NEAR}) || !(opacity >= ${float(ALPHA_MIN)})) return;
  opacity = min(opacity, 1.0);
  axes = rotation * axes;
  vec2 flat2 = local.xy / local.z;
  vec2 bent = clamp(flat2, limits.xz, limits.yw);
  vec2 focal = lens.xy / local.z;
  // Rows of Jacobian * rotation * axes: the splat's axes in image space.
  axes = transpose(axes);
  vec3 u = focal.x * (axes[0] - bent.x * axes[2]);
  vec3 t = focal.y * (axes[1] - bent.y * axes[2]);
  float xx = dot(u, u), xy = dot(u, t), yy = dot(t, t);
  vec3 normal = cross(u, t);
  float det = dot(normal, normal) + dilation * (xx + yy) + dilation * dilation;
  vec3 cov = vec3(xx + dilation, xy, yy + dilation);
  vec2 place = flat2 * lens.xy + lens.zw;
  float reach = sqrt(2.0 * log(opacity / ${float(ALPHA_MIN)}));
  vec2 halfSize = reach * sqrt(cov.xz);
  if (any(lessThanEqual(place + halfSize, vec2(0.0))) || any(greaterThanEqual(place - halfSize, size))) return;
  if (!(det > 0.0) || isinf(det)) return;
  vec3 conic = vec3(cov.z, -cov.y, cov.x) / det;
  vec3 color = max(harmonics(normalize(mean - eye)) + 0.5, 0.0);
  first = uvec4(floatBitsToUint(place), floatBitsToUint(conic.xy));
  second = uvec4(floatBitsToUint(conic.z), packHalf2x16(color.rg), packHalf2x16(vec2(color.b, opacity)), 1u);
}`;
}

/** The second pass: a quad along the splat's axes in image space, out to where its alpha falls to 1/255. */
export const SPLAT_VERTEX = `${HEAD}
uniform usampler2D order; // pixels of the splats' tile, farthest first
uniform int count, batch;
uniform usampler2D words0, words1, set0, set1;
uniform int tile;
uniform vec2 size;
flat out vec4 paint; // color and opacity
flat out vec3 conic;
out vec2 offset;
void main() {
  int number = gl_InstanceID * batch + (gl_VertexID >> 2);
  if (number >= count) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  uint entry = texelFetch(order, ivec2(number & ${ORDER_WIDTH - 1}, number / ${ORDER_WIDTH}), 0).x;
  bool ofSet = entry >= ${OF_SET}u;
  int splat = int(ofSet ? entry - ${OF_SET}u : entry), width = ofSet ? ${ORDER_WIDTH} : tile;
  ivec2 at = ivec2(splat % width, splat / width);
  uvec4 b = ofSet ? texelFetch(set1, at, 0) : texelFetch(words1, at, 0);
  if (b.w == 0u) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  uvec4 a = ofSet ? texelFetch(set0, at, 0) : texelFetch(words0, at, 0);
  vec2 place = uintBitsToFloat(a.xy);
  conic = vec3(uintBitsToFloat(a.zw), uintBitsToFloat(b.x));
  vec2 rg = unpackHalf2x16(b.y), bo = unpackHalf2x16(b.z);
  paint = vec4(rg, bo);
  // Axes of the ellipse: eigenvectors of the inverse covariance.
  float middle = 0.5 * (conic.x + conic.z);
  float spread = length(vec2(0.5 * (conic.x - conic.z), conic.y));
  float most = middle + spread;
  float least = max((conic.x * conic.z - conic.y * conic.y) / most, 1e-12);
  vec2 axis = abs(conic.y) > 1e-12 ? normalize(vec2(conic.y, least - conic.x)) : (conic.x < conic.z ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
  float reach = sqrt(2.0 * log(max(bo.y * 255.0, 1.0))) + 0.01;
  vec2 corner = vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) * 2.0 - 1.0;
  offset = reach * (corner.x * axis * inversesqrt(least) + corner.y * vec2(-axis.y, axis.x) * inversesqrt(most));
  vec2 pixel = place + offset;
  gl_Position = vec4(pixel.x / size.x * 2.0 - 1.0, 1.0 - pixel.y / size.y * 2.0, 0.0, 1.0);
}`;

export const SPLAT_FRAGMENT = `${HEAD}
flat in vec4 paint;
flat in vec3 conic;
in vec2 offset;
out vec4 pixel;
void main() {
  float sigma = 0.5 * (conic.x * offset.x * offset.x + conic.z * offset.y * offset.y) + conic.y * offset.x * offset.y;
  float alpha = min(paint.a * exp(-max(sigma, 0.0)), ${float(ALPHA_MAX)});
  if (alpha < ${float(ALPHA_MIN)}) discard;
  pixel = vec4(paint.rgb * alpha, alpha);
}`;

/** Copies the framebuffer to the canvas, scaled, over the background. */
export const RESOLVE_FRAGMENT = `${HEAD}
uniform sampler2D drawing;
uniform vec4 background; // alpha 0: none
uniform vec4 viewport; // corner, size
out vec4 pixel;
void main() {
  vec4 front = texture(drawing, (gl_FragCoord.xy - viewport.xy) / viewport.zw);
  float rest = 1.0 - front.a;
  pixel = vec4(front.rgb + rest * background.rgb * background.a, front.a + rest * background.a);
}`;
