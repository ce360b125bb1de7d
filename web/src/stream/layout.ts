/** Names, bounds and places of what a frame's image holds, as in studio/stream/layout.py. */

export const MAX_VALUE = 1e9;
const MAX_LOG_SCALE = Math.log(MAX_VALUE);
const MAX_SHAPE = 1e4;

/** Bounds of a component's or channel's values, so that everything rendered is finite: scales end where positions do. */
export function valueBounds(name: string): readonly [low: number, high: number] {
  if (name.startsWith("shape_")) return [-MAX_SHAPE, MAX_SHAPE];
  return [-MAX_VALUE, name.startsWith("log_scale") ? MAX_LOG_SCALE : MAX_VALUE];
}

/** Channels of the profile `motion`, in order: 10 + 3 (degree + 1)^2. */
export function channelNames(shDegree: number): string[] {
  const names = ["residual_x", "residual_y", "residual_z"];
  names.push("shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz", "opacity");
  for (let k = 0; k < (shDegree + 1) ** 2; k++) for (const part of ["y", "co", "cg"]) names.push(`sh_${k}_${part}`);
  return names;
}

/** Components of the profile `planes`, in order: 11 + 3 (degree + 1)^2. */
export function componentNames(shDegree: number): string[] {
  const names = ["mean_x", "mean_y", "mean_z"];
  for (let k = 0; k < (shDegree + 1) ** 2; k++) for (const color of "rgb") names.push(`sh_${k}_${color}`);
  names.push("opacity", "log_scale_0", "log_scale_1", "log_scale_2", "quat_w", "quat_x", "quat_y", "quat_z");
  return names;
}

/** Side of the smallest square that fits `splats` pixels, rounded up to a multiple of `multiple`. */
export function squareSide(splats: number, multiple: number): number {
  let side = multiple * Math.max(1, Math.floor(Math.sqrt(splats) / multiple));
  while (side * side < splats) side += multiple;
  return side;
}
