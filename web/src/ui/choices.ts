/** What can be chosen in the settings: speeds and backgrounds. */

import type { Vector } from "../stream/metadata.ts";
import type { DecodePath } from "../worker/messages.ts";

const DECODERS: readonly unknown[] = ["webcodecs", "webcodecs-software", "video"] satisfies DecodePath[];

export const isDecoder = (name: unknown): name is DecodePath => DECODERS.includes(name);

export const SPEEDS = [0.25, 0.5, 1, 1.5, 2] as const;

/** Available backgrounds; null is transparent. "stream" is the background suggested by the stream. */
export const BACKGROUNDS = {
  stream: { label: "As recorded", color: null },
  black: { label: "Black", color: [0, 0, 0] },
  gray: { label: "Gray", color: [0.22, 0.24, 0.27] },
  white: { label: "White", color: [1, 1, 1] },
  green: { label: "Green", color: [0, 0.69, 0.25] },
  none: { label: "Transparent", color: null },
} as const;

export type BackgroundName = keyof typeof BACKGROUNDS;

export const isBackground = (name: unknown): name is BackgroundName =>
  typeof name === "string" && Object.hasOwn(BACKGROUNDS, name);

/** A color in CSS. */
export const cssColor = (color: Vector | null): string =>
  color === null ? "transparent" : `rgb(${color.map((value) => Math.round(255 * value)).join(" ")})`;

/** Whether a background looks like the one that the stream suggests, which is enough to choose from. */
export function isSuggested(name: BackgroundName, suggested: Vector): boolean {
  const { color } = BACKGROUNDS[name];
  return color !== null && color.every((value, channel) => Math.abs(value - suggested[channel]) < 0.02);
}
