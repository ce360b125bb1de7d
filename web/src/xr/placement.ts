/** The place of a stream in the room: a floor point, a turn about the vertical, and a scale. Pure functions and values. */

import { add, type Box, cross, dot, middleOf, type Pinhole, unit, type Vec3 } from "../render/camera.ts";
import type { Vector } from "../stream/metadata.ts";

/** Height in meters of what is placed in a room, where it is life-size, and on a table. */
const PERSON = 1.7;
const TABLE = 0.5;
const LIFE_SIZE = [0.5, 3] as const; // heights in world units that are taken for meters: people and small groups of people
const AWAY = 2; // meters from the viewer at first
const SMALLEST = 0.05;
const LARGEST = 20;

/** The parts of a column-major 4 x 4 matrix, as WebXR has them. */
type Matrix = Readonly<Float32Array>;

/** An orthonormal frame of the stream: rows right, up and towards the viewer of the suggested camera. */
export interface Footing {
  /** (3, 3), row-major. */
  readonly axes: readonly number[];
  /** The middle of the bounding box's floor, in world units. */
  readonly floor: Vector;
  /** Height of the bounding box, in world units. */
  readonly height: number;
}

/** The stream's footing from its bounding box, its up direction and the horizontal direction of the suggested camera. */
export function footing(box: Box, up: Vector, ahead: Vector): Footing {
  const top = unit(up);
  const right = unit(cross(ahead, top));
  const back = cross(right, top);
  // Half the extent of the box along the vertical.
  const half = [0, 1, 2].reduce((sum, k) => sum + (Math.abs(top[k]) * (box.max[k] - box.min[k])) / 2, 0);
  return { axes: [...right, ...top, ...back], floor: add(middleOf(box), top, -half), height: Math.max(2 * half, 1e-6) };
}

export class Placement {
  /** Meters per world unit. */
  scale: number;
  /** Radians about the vertical; 0: the suggested camera looks along the room's -z. */
  turn = 0;
  /** The middle of the floor in the room, in meters. */
  place: Vec3 = [0, 0, -AWAY];

  /** @param small - to be placed on a table, instead of in a room */
  constructor(private readonly footing: Footing, small: boolean) {
    const { height } = footing;
    const lifeSize = height >= LIFE_SIZE[0] && height <= LIFE_SIZE[1];
    this.scale = small ? TABLE / height : lifeSize ? 1 : PERSON / height;
  }

  /** Places it in front of a viewer, on the floor, facing them. */
  faceViewer(viewer: Matrix): void {
    const size = Math.hypot(viewer[8], viewer[10]);
    const [x, z] = size < 1e-6 ? [0, -1] : [-viewer[8] / size, -viewer[10] / size]; // where they look, horizontally
    this.turnTo([viewer[12] + AWAY * x, 0, viewer[14] + AWAY * z], viewer);
  }

  /** Places it at a point of the room, facing the viewer. */
  turnTo(place: Vec3, viewer: Matrix): void {
    this.place = place;
    this.turn = Math.atan2(viewer[12] - place[0], viewer[14] - place[2]);
  }

  /** Scales it about its floor point, within limits of its height. */
  zoom(factor: number): void {
    const { height } = this.footing;
    this.scale = Math.max(SMALLEST / height, Math.min(LARGEST / height, this.scale * factor));
  }

  /** The camera, in world units of the stream, of an eye in the room. `view`: room to eye (OpenGL axes). `projection`: OpenGL
   * projection; may be off-center. */
  pinhole(view: Matrix, projection: Matrix, width: number, height: number): Pinhole {
    const { axes, floor } = this.footing;
    const [c, s] = [Math.cos(this.turn), Math.sin(this.turn)];
    // Stream to room, without scale and translation.
    const room = [
      ...[0, 1, 2].map((k) => c * axes[k] + s * axes[6 + k]),
      ...axes.slice(3, 6),
      ...[0, 1, 2].map((k) => c * axes[6 + k] - s * axes[k]),
    ];
    // OpenCV's y and z have the opposite sign of OpenGL's.
    const rows = [0, 1, 2].map((row) => {
      const sign = row === 0 ? 1 : -1;
      return [0, 1, 2, 3].map((column) => sign * view[4 * column + row]);
    });
    const rotation = rows.flatMap((row) =>
      [0, 1, 2].map((k) => row[0] * room[k] + row[1] * room[3 + k] + row[2] * room[6 + k]),
    );
    const translation = rows.map(
      (row, k) =>
        (dot(row.slice(0, 3) as Vec3, this.place) + row[3]) / this.scale - dot(rotation.slice(3 * k, 3 * k + 3) as Vec3, floor),
    ) as Vec3;
    return {
      width,
      height,
      fx: (projection[0] * width) / 2,
      fy: (projection[5] * height) / 2,
      cx: ((1 - projection[8]) * width) / 2,
      cy: ((1 + projection[9]) * height) / 2,
      rotation,
      translation,
    };
  }
}
