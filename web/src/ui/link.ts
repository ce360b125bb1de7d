/** Links to a time and a view: `?t=3.2&view=30,10,2.5,0,0,0` (angles in degrees, then distance and target). */

import type { PartialView, View } from "../render/camera.ts";
import { MAX_VALUE } from "../stream/metadata.ts";

const short = (value: number, digits = 4): string => String(Number(value.toPrecision(digits)));

/** The view of a link: two angles, or with the distance, or with the target too; null if it is malformed. */
export function parseView(text: string | null): PartialView | null {
  const values = (text ?? "").split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  if (![2, 3, 6].includes(values.length) || !values.every((value) => Math.abs(value) <= MAX_VALUE)) return null;
  const [azimuth, elevation, distance, x, y, z] = values;
  if (values.length === 2) return { azimuth, elevation };
  if (!(distance > 0)) return null;
  return values.length === 3 ? { azimuth, elevation, distance } : { azimuth, elevation, distance, target: [x, y, z] };
}

/** The page's URL with a time, a view and further parameters; the rest of it is unchanged. */
export function linkTo(address: string, seconds: number, view: View, more: Readonly<Record<string, string>> = {}): string {
  const { azimuth, elevation, distance, target } = view;
  const url = new URL(address);
  url.searchParams.delete("compare");
  url.searchParams.set("t", short(seconds, 5));
  url.searchParams.set("view", [azimuth, elevation, distance, ...target].map((value) => short(value)).join());
  for (const [name, value] of Object.entries(more)) url.searchParams.set(name, value);
  return url.href.replaceAll("%2C", ",");
}
