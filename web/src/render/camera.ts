/** An orbit camera, and its pinhole camera for a given canvas size. */

import type { Camera, Vector, ViewRange } from "../stream/metadata.ts";
import type { DepthAxis } from "../worker/messages.ts";

export type Vec3 = [number, number, number];

/** The camera to render from: OpenCV axes, in pixels of the render resolution. */
export interface Pinhole {
  readonly width: number;
  readonly height: number;
  readonly fx: number;
  readonly fy: number;
  readonly cx: number;
  readonly cy: number;
  /** (3, 3) world to camera, row-major. */
  readonly rotation: readonly number[];
  readonly translation: Vector;
}

/** A view, as in links: angles in degrees, lengths in world units. */
export interface View {
  readonly azimuth: number;
  readonly elevation: number;
  readonly distance: number;
  readonly target: Vector;
}

/** A view of which parts can be missing: they stay as they are. */
export type PartialView = { readonly [K in keyof View]?: View[K] };

export const add = (a: Vector, b: Vector, s = 1): Vec3 => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vector, b: Vector): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a: Vector): number => Math.hypot(...a);
export const unit = (a: Vector): Vec3 => {
  const size = length(a) || 1;
  return [a[0] / size, a[1] / size, a[2] / size];
};

export interface Box {
  readonly min: Vector;
  readonly max: Vector;
}

export const middleOf = ({ min, max }: Box): Vec3 => add(min, max).map((value) => value / 2) as Vec3;

export const cornersOf = ({ min, max }: Box): Vec3[] =>
  Array.from({ length: 8 }, (_, corner) => [0, 1, 2].map((k) => ((corner >> k) & 1 ? max[k] : min[k])) as Vec3);

export function boxOf(points: readonly Vector[]): Box {
  const ends = (how: (...values: number[]) => number): Vec3 => [0, 1, 2].map((k) => how(...points.map((point) => point[k]))) as Vec3;
  return { min: ends(Math.min), max: ends(Math.max) };
}

const DEGREES = 180 / Math.PI;
const MAX_ELEVATION = 89;
const MARGIN = 1.12; // margin around the scene, as a factor
const EYE_LEVEL = 10; // degrees above the horizon at which a view begins at most: a capture camera may hang under the ceiling
const FIELD = 2; // as in studio.rasterizer: the projection is linearized at most this far off the axis (x / z, y / z), ...
const FIELD_MARGIN = 0.3; // ... or outside the image by this fraction of half its size.

/** Minimum and maximum x / z, then y / z, at which a splat's projection is linearized. */
export function fieldLimits({ width, height, fx, fy, cx, cy }: Pinhole): [number, number, number, number] {
  const [mx, my] = [(FIELD_MARGIN * 0.5 * width) / fx, (FIELD_MARGIN * 0.5 * height) / fy];
  return [
    Math.min(-FIELD, -cx / fx - mx),
    Math.max(FIELD, (width - cx) / fx + mx),
    Math.min(-FIELD, -cy / fy - my),
    Math.max(FIELD, (height - cy) / fy + my),
  ];
}

/** The pinhole of a camera as specified in the stream's metadata and in rig files. */
export function pinholeOf({ width, height, K, worldToCamera: w }: Camera): Pinhole {
  const rows = w.slice(0, 3);
  return {
    width,
    height,
    fx: K[0][0],
    fy: K[1][1],
    cx: K[0][2],
    cy: K[1][2],
    rotation: rows.flatMap((row) => row.slice(0, 3)),
    translation: rows.map((row) => row[3]) as unknown as Vector,
  };
}

export function depthAxis({ rotation: r, translation: t }: Pinhole): DepthAxis {
  return [r[6], r[7], r[8], t[2]];
}

/** The camera center in world coordinates. */
export function centerOf({ rotation: r, translation: t }: Pinhole): Vec3 {
  return [0, 1, 2].map((k) => -(r[k] * t[0] + r[3 + k] * t[1] + r[6 + k] * t[2])) as Vec3;
}

/** The place of a world point in the image; null if it is behind the camera. */
export function placeIn({ rotation: r, translation: t, fx, fy, cx, cy }: Pinhole, point: Vector): [number, number] | null {
  const [x, y, z] = [0, 1, 2].map((k) => r[3 * k] * point[0] + r[3 * k + 1] * point[1] + r[3 * k + 2] * point[2] + t[k]);
  return z <= 1e-6 ? null : [(fx * x) / z + cx, (fy * y) / z + cy];
}

/** Degrees beyond the range in which the image fades. */
export const FADE = 20;

/** Opacity of the image from an eye's place: 1 within the range, 0 from FADE degrees beyond. */
export function visibility({ center, directions, angle }: ViewRange, eye: Vector): number {
  const towards = add(eye, center, -1);
  const distance = length(towards);
  if (!(distance > 0)) return 1;
  const nearest = Math.max(...directions.map((one) => dot(one, towards) / distance));
  const beyond = Math.acos(Math.max(-1, Math.min(1, nearest))) * DEGREES - angle;
  return Math.max(0, Math.min(1, 1 - beyond / FADE));
}

export class OrbitCamera {
  azimuth = 0;
  elevation = 0;
  distance = 1;
  target: Vec3 = [0, 0, 0];
  /** Tangents of half the field of view that must be visible, horizontally and vertically. */
  private tangents: readonly [number, number] = [0.35, 0.35];
  /** The stream's up direction, and the horizontal direction of the suggested camera. */
  up: Vec3 = [0, 1, 0];
  ahead: Vec3 = [0, 0, 1];
  private side: Vec3 = [1, 0, 0];
  private home: View = { azimuth: 0, elevation: 0, distance: 1, target: [0, 0, 0] };
  private radius = 1;

  /** Sets the initial view: from the direction of the suggested camera, at eye level; from in front of the box without one.
   * `box`: of the whole stream: all of it is visible at any aspect ratio. */
  frame(box: Box, camera: Camera | null, up: Vector | null): void {
    const middle = middleOf(box);
    this.radius = Math.max(length(add(box.max, box.min, -1)) / 2, 1e-6);
    const pinhole = camera === null ? null : pinholeOf(camera);
    // OpenCV's y points down.
    this.up = unit(up ?? (pinhole === null ? [0, 1, 0] : (pinhole.rotation.slice(3, 6).map((v) => -v) as Vec3)));
    const forward: Vec3 = pinhole === null ? [0, 0, -1] : (pinhole.rotation.slice(6, 9) as Vec3);
    this.ahead = unit(add(forward, this.up, -dot(forward, this.up)));
    if (length(this.ahead) < 0.5) this.ahead = unit(cross(this.up, [0.3, 0.5, 0.8]));
    this.side = cross(this.ahead, this.up);
    // What a higher or lower camera shows looks at most this much larger from eye level.
    let larger = 1;
    if (pinhole === null) {
      this.home = { azimuth: 0, elevation: 0, distance: 3 * this.radius, target: middle };
    } else {
      const center = centerOf(pinhole);
      // The point on the camera's axis that is nearest to the center of the scene.
      const distance = Math.max(dot(add(middle, center, -1), forward), 0.1 * this.radius);
      const suggested = Math.asin(Math.max(-1, Math.min(1, -dot(forward, this.up)))) * DEGREES;
      const elevation = Math.max(-EYE_LEVEL, Math.min(EYE_LEVEL, suggested));
      if (elevation !== suggested) larger = 1 / Math.max(Math.cos(suggested / DEGREES), 0.1);
      this.home = { azimuth: 0, elevation, distance, target: add(center, forward, distance) };
    }
    this.reset();
    // The whole box should be visible, but no more than the suggested camera shows: a box may include a few stray splats.
    const [across, up_] = pinhole === null ? [1, 1] : [pinhole.width / 2 / pinhole.fx, pinhole.height / 2 / pinhole.fy];
    const [x, y] = this.extent(box);
    this.tangents = [Math.min(larger * across, MARGIN * x), Math.min(larger * up_, MARGIN * y)];
  }

  /** Maximum |x / z| and |y / z| of the box's corners; infinite if one is behind the camera. */
  private extent(box: Box): [number, number] {
    const lens = { ...this.pose(), width: 2, height: 2, fx: 1, fy: 1, cx: 0, cy: 0 };
    const places = cornersOf(box).map((corner) => placeIn(lens, corner) ?? [Infinity, Infinity]);
    return [0, 1].map((k) => Math.max(1e-3, ...places.map((place) => Math.abs(place[k])))) as [number, number];
  }

  reset(): void {
    this.view = this.home;
  }

  /** Begins with another view, to which `reset` leads back. */
  begin(view: PartialView): void {
    this.home = { ...this.home, ...view };
    this.reset();
  }

  /** Begins with a view from a point to another one: `fov` degrees high, or more, so that points are seen from side to side. */
  look(eye: Vector, target: Vector, fov: number, points: readonly Vector[]): void {
    this.begin(this.viewFrom(eye, target));
    const lens = { ...this.pose(), width: 2, height: 2, fx: 1, fy: 1, cx: 0, cy: 0 };
    const across = Math.max(0, ...points.map((point) => Math.abs(placeIn(lens, point)?.[0] ?? 0)));
    this.tangents = [1.05 * across, Math.tan(fov / 2 / DEGREES)];
  }

  /** The view that is nearest to a camera's: upright, and what is at the scene's distance has the same size. */
  viewOf(pinhole: Pinhole): View {
    const center = centerOf(pinhole);
    const forward = pinhole.rotation.slice(6, 9) as Vec3;
    const depth = Math.max(dot(add(this.home.target, center, -1), forward), 0.1 * this.radius);
    return {
      ...this.anglesOf(forward),
      distance: (depth * pinhole.height) / 2 / pinhole.fy / this.tangents[1],
      target: add(center, forward, depth),
    };
  }

  /** The view from a point to another one, which it orbits. */
  viewFrom(eye: Vector, target: Vector): View {
    const towards = add(target, eye, -1);
    return { ...this.anglesOf(unit(towards)), distance: length(towards), target };
  }

  /** The angles of a view in a direction; straight up and down, the azimuth stays as it is. */
  private anglesOf(forward: Vector): Pick<View, "azimuth" | "elevation"> {
    const steep = dot(forward, this.up);
    const flat = add(forward, this.up, -steep);
    const azimuth = length(flat) < 1e-6 ? this.azimuth : Math.atan2(dot(flat, this.side), dot(flat, this.ahead)) * DEGREES;
    return { azimuth, elevation: Math.asin(Math.max(-1, Math.min(1, -steep))) * DEGREES };
  }

  /** The place of the viewer of a view. */
  eyeOf({ azimuth, elevation, distance, target }: View): Vec3 {
    return add(target, this.forwardOf(azimuth, elevation), -distance);
  }

  /** Vertical field of view in degrees, for an aspect ratio. */
  fieldOfView(aspect: number): number {
    return 2 * Math.atan(this.tangentsFor(aspect)[1]) * DEGREES;
  }

  get view(): View {
    return { azimuth: this.azimuth, elevation: this.elevation, distance: this.distance, target: [...this.target] };
  }

  set view(view: View) {
    this.azimuth = ((((view.azimuth + 180) % 360) + 360) % 360) - 180;
    this.elevation = Math.max(-MAX_ELEVATION, Math.min(MAX_ELEVATION, view.elevation));
    this.distance = Math.max(0.02 * this.radius, Math.min(50 * this.radius, view.distance));
    this.target = [...view.target];
  }

  /** Right, down and forward axes: the rows of the rotation. */
  private axes(): [Vec3, Vec3, Vec3] {
    const forward = this.forwardOf(this.azimuth, this.elevation);
    const right = unit(cross(forward, this.up));
    return [right, cross(forward, right), forward];
  }

  private forwardOf(azimuth: number, elevation: number): Vec3 {
    const [a, e] = [azimuth / DEGREES, elevation / DEGREES];
    const flat = add(this.ahead.map((v) => v * Math.cos(a)) as Vec3, this.side, Math.sin(a));
    return add(flat.map((v) => v * Math.cos(e)) as Vec3, this.up, -Math.sin(e));
  }

  /** Orbits by angles in degrees. */
  orbit(azimuth: number, elevation: number): void {
    this.view = { ...this.view, azimuth: this.azimuth + azimuth, elevation: this.elevation + elevation };
  }

  /** Scales the distance: factors below 1 move closer, above 1 farther away. */
  zoom(factor: number): void {
    this.view = { ...this.view, distance: this.distance * factor };
  }

  /** Pans so that the target moves by (dx, dy) on screen, as fractions of the image's height. */
  pan(dx: number, dy: number, aspect: number): void {
    const [right, down] = this.axes();
    const size = 2 * this.distance * this.tangentsFor(aspect)[1];
    this.target = add(add(this.target, right, -dx * size), down, -dy * size);
  }

  /** Tangents of half the field of view for an aspect ratio, such that what is in `tangents` is visible. */
  private tangentsFor(aspect: number): [number, number] {
    const [across, up] = this.tangents;
    const vertical = Math.max(up, across / aspect);
    return [vertical * aspect, vertical];
  }

  pinhole(width: number, height: number): Pinhole {
    const focal = height / 2 / this.tangentsFor(width / height)[1];
    return { ...this.pose(), width, height, fx: focal, fy: focal, cx: width / 2, cy: height / 2 };
  }

  private pose(): Pick<Pinhole, "rotation" | "translation"> {
    const axes = this.axes();
    const eye = this.eyeOf(this);
    return { rotation: axes.flat(), translation: axes.map((axis) => -dot(axis, eye)) as unknown as Vector };
  }
}
