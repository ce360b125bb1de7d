/** The shaders of a cast: splats from arrays, and the ground. */

import { HARMONICS, HEAD } from "./shaders.ts";

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

/** The ground of a cast and what lies on it: a rectangle around the origin of its own x and z. */
export const GROUND_VERTEX = `${HEAD}
uniform mat4 toImage; // clip coordinates of its own
uniform vec2 halves;
out vec2 place; // -1 to 1
void main() {
  place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec2 at = place * halves;
  gl_Position = toImage * vec4(at.x, 0.0, at.y, 1.0);
}`;

/** A disk of one color, or a shadow. */
export const GROUND_FRAGMENT = `${HEAD}
uniform vec4 color;
uniform sampler2D shadow;
uniform bool isShadow;
in vec2 place;
out vec4 pixel;
void main() {
  float edge = length(place), soft = fwidth(edge);
  float alpha = isShadow ? texture(shadow, 0.5 * place + 0.5).r : 1.0 - smoothstep(1.0 - soft, 1.0, edge);
  pixel = vec4(color.rgb, 1.0) * color.a * alpha;
}`;
