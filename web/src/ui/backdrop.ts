/** Whether what is behind the title and the bar is light, so that they must be dark. */

import type { Vector } from "../stream/metadata.ts";

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
