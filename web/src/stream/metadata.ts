/** The metadata that players use (docs/STREAM.md, "Metadata"). It is optional: what is not well-formed is ignored. */

/** Largest number in a stream, a view or a mark: everything that is computed from it stays finite. */
export const MAX_VALUE = 1e9;

export type Vector = readonly [number, number, number];

/** A pinhole camera, OpenCV axes; pixels from the outer corner of the top-left pixel. */
export interface Camera {
  readonly width: number;
  readonly height: number;
  readonly K: readonly (readonly number[])[];
  readonly worldToCamera: readonly (readonly number[])[];
}

/** The places from which the splats can be viewed. */
export interface ViewRange {
  /** The middle of the scene, world units. */
  readonly center: Vector;
  /** Unit vectors from there to the training cameras. */
  readonly directions: readonly Vector[];
  /** Degrees to the nearest direction up to which views are good. */
  readonly angle: number;
}

/** Control and bidirectional characters, with which a title could look like another one. */
// eslint-disable-next-line no-control-regex
const CONTROLS = /[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]/g;

const oneLine = (text: string): string => text.replace(/\s+/g, " ").trim();

/** Text for one line; the same as `plain_text` in studio/stream/metadata.py. */
export const plainText = (text: string): string => oneLine(oneLine(text).replace(CONTROLS, ""));

/** Each value is null if it is missing or not well-formed. */
export interface Metadata {
  readonly camera: Camera | null;
  readonly up: Vector | null;
  readonly background: Vector | null;
  readonly viewRange: ViewRange | null;
  readonly title: string | null;
}

const MAX_SIDE = 1e6;
const MAX_DIRECTIONS = 256;
const MAX_TITLE = 200;

type Values = Readonly<Record<string, unknown>>;

export const isNumber = (value: unknown): value is number => typeof value === "number" && Number.isFinite(value);

export const isVector = (value: unknown): value is Vector =>
  Array.isArray(value) && value.length === 3 && value.every((one) => isNumber(one) && Math.abs(one) <= MAX_VALUE);

const isSide = (value: unknown): value is number => Number.isInteger(value) && Number(value) >= 1 && Number(value) <= MAX_SIDE;

const isSquare = (value: unknown, size: number): value is number[][] =>
  Array.isArray(value) &&
  value.length === size &&
  value.every((row) => Array.isArray(row) && row.length === size && row.every(isNumber));

const object = (value: unknown): Values => (typeof value === "object" && value !== null ? (value as Values) : {});

/** A camera of a rig file; null if it is not well-formed. */
export function readCamera(value: unknown): Camera | null {
  const { width, height, K, world_to_camera: worldToCamera } = object(value);
  if (!isSide(width) || !isSide(height) || !isSquare(K, 3) || !isSquare(worldToCamera, 4)) return null;
  return K[0][0] > 0 && K[1][1] > 0 ? { width, height, K, worldToCamera } : null;
}

function readViewRange(value: unknown): ViewRange | null {
  const { center, directions, angle } = object(value);
  if (!isVector(center) || !isNumber(angle) || !(angle > 0 && angle <= 180)) return null;
  if (!Array.isArray(directions) || directions.length < 1 || directions.length > MAX_DIRECTIONS) return null;
  if (!directions.every((one): one is Vector => isVector(one) && Math.hypot(...one) > 0.5)) return null;
  const units = directions.map((one) => one.map((part) => part / Math.hypot(...one)) as unknown as Vector);
  return { center, directions: units, angle };
}

export function readMetadata(values: Values): Metadata {
  const { up, background, title } = values;
  const isColor = isVector(background) && background.every((one) => one >= 0 && one <= 1);
  return {
    camera: readCamera(values["suggested_camera"]),
    up: isVector(up) && up.some((one) => one !== 0) ? up : null,
    background: isColor ? background : null,
    viewRange: readViewRange(values["view_range"]),
    title: typeof title === "string" ? plainText(title.slice(0, MAX_TITLE)) : null,
  };
}
