/** The part of a camera's image that is shown, and its place. */

import { type Box, cornersOf, pinholeOf, placeIn } from "../render/camera.ts";
import type { Camera } from "../stream/metadata.ts";
import type { ReviewCamera } from "./api.ts";

/** A part of an image, in its pixels. */
export interface Part {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

const MARGIN = 0.08; // room around the performer, as a fraction of their size on each side

export const whole = ({ width, height }: ReviewCamera): Part => ({ x: 0, y: 0, width, height });

/** The part that holds the performer: the box of all splats, seen by the camera. The whole image if it is not in front. */
export function around(camera: ReviewCamera, box: Box): Part {
  const pinhole = pinholeOf(cameraOf(camera, whole(camera)));
  const places = cornersOf(box).map((corner) => placeIn(pinhole, corner)).filter((place) => place !== null);
  if (places.length < 8) return whole(camera);
  const span = (values: number[], size: number): [number, number] => {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const margin = MARGIN * (high - low);
    return [Math.max(0, low - margin), Math.min(size, high + margin)];
  };
  const [left, right] = span(places.map(([x]) => x), camera.width);
  const [top, bottom] = span(places.map(([, y]) => y), camera.height);
  if (right - left < 8 || bottom - top < 8) return whole(camera);
  return { x: left, y: top, width: right - left, height: bottom - top };
}

/** A larger part that fills the canvas, in which this part is as large as possible in what is not covered. `top`, `bottom`: how
 * much of the canvas is covered above and below, pixels. */
export function withRoom(part: Part, width: number, height: number, top: number, bottom: number): Part {
  const free = height - top - bottom;
  // Where the controls leave little, they may cover some.
  if (free < 0.4 * height) return part;
  const scale = Math.min(width / part.width, free / part.height);
  return {
    x: part.x + (part.width - width / scale) / 2,
    y: part.y + (part.height - free / scale) / 2 - top / scale,
    width: width / scale,
    height: height / scale,
  };
}

/** The pinhole camera whose whole image is this part. */
export function cameraOf({ K, world_to_camera }: ReviewCamera, part: Part): Camera {
  return {
    width: part.width,
    height: part.height,
    K: [
      [K[0][0], K[0][1], K[0][2] - part.x],
      [0, K[1][1], K[1][2] - part.y],
      [0, 0, 1],
    ],
    worldToCamera: world_to_camera,
  };
}

/** The place of the whole image on a canvas on which the part is as large as possible, in the middle. */
export function placed(camera: ReviewCamera, part: Part, width: number, height: number): Part {
  const scale = Math.min(width / part.width, height / part.height);
  return {
    x: width / 2 - (part.x + part.width / 2) * scale,
    y: height / 2 - (part.y + part.height / 2) * scale,
    width: camera.width * scale,
    height: camera.height * scale,
  };
}
