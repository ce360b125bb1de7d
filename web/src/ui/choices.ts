/** Choices of the viewer and the author: speeds and backgrounds in the settings, decoders by links and attributes. */

import type { Vector } from "../stream/metadata.ts";
import type { DecodePath } from "../worker/messages.ts";

/** Names of decoders as they are shown. */
export const DECODERS: Readonly<Record<DecodePath, string>> = {
  webcodecs: "WebCodecs",
  "webcodecs-software": "WebCodecs, software",
  video: "video element",
};

export const isDecoder = (name: string | null): name is DecodePath => name !== null && Object.hasOwn(DECODERS, name);

export const SPEEDS = [0.25, 0.5, 1, 1.5, 2] as const;

/** Available backgrounds; null is transparent. "set" is the set behind the performer, "stream" the color suggested by the
 * stream. */
export const BACKGROUNDS = {
  set: { color: null },
  stream: { color: null },
  black: { color: [0, 0, 0] },
  gray: { color: [0.22, 0.24, 0.27] },
  white: { color: [1, 1, 1] },
  green: { color: [0, 0.69, 0.25] },
  none: { color: null },
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

const LIGHT = 0.18; // relative luminance (WCAG 2) above which black text has more contrast than white text

const linear = (value: number): number => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);

/** @param color - RGB, 0 to 1 */
export function isLight([red, green, blue]: Vector): boolean {
  return 0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue) > LIGHT;
}

/** RGB, 0 to 1, of what is behind a transparent element: the nearest ancestor with a background; pages are white. */
export function backdropOf(element: Element): Vector {
  for (let one = element.parentElement; one !== null; one = one.parentElement) {
    const parts = (getComputedStyle(one).backgroundColor.match(/[\d.]+/g) ?? []).map(Number);
    const [red, green, blue, alpha] = parts.length === 3 ? [...parts, 1] : parts;
    if (alpha > 0.5) return [red / 255, green / 255, blue / 255];
  }
  return [1, 1, 1];
}
