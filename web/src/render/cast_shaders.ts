/** The shaders of the ground of a cast. */

import { HEAD } from "./shaders.ts";

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
