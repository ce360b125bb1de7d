/** A camera path that is flown once when the stream is ready, until the first input. */

import { pinholeOf, type View } from "../render/camera.ts";
import type { Player } from "../player/player.ts";
import { StreamError } from "../stream/errors.ts";
import { type Camera, isNumber, readCamera } from "../stream/metadata.ts";
import { textAt } from "./dom.ts";

const FORMAT = "v3studio-camera-path";
const MAX_KEYS = 1000; // keys that a path may have at most
const EASINGS = ["smooth", "ease", "linear", "hold"]; // how the camera moves from a key to the next one

interface Key {
  readonly time: number;
  readonly easing: string;
  readonly camera: Camera;
}

/** A curve through points at ascending times, with continuous velocity and acceleration: a natural cubic spline. */
export function spline(times: readonly number[], values: readonly number[]): (time: number) => number {
  const n = times.length;
  // Second derivatives, by elimination in the tridiagonal system.
  const second = new Array<number>(n).fill(0);
  const upper = new Array<number>(n).fill(0);
  for (let i = 1; i < n - 1; i++) {
    const [before, after] = [times[i] - times[i - 1], times[i + 1] - times[i]];
    const bend = 6 * ((values[i + 1] - values[i]) / after - (values[i] - values[i - 1]) / before);
    const pivot = 2 * (before + after) - before * upper[i - 1];
    upper[i] = after / pivot;
    second[i] = (bend - before * second[i - 1]) / pivot;
  }
  for (let i = n - 2; i > 0; i--) second[i] -= upper[i] * second[i + 1];
  return (time) => {
    if (n === 1 || time <= times[0]) return values[0];
    if (time >= times[n - 1]) return values[n - 1];
    let i = 0;
    while (time > times[i + 1]) i++;
    const step = times[i + 1] - times[i];
    const [a, b] = [(times[i + 1] - time) / step, (time - times[i]) / step];
    const bent = ((a ** 3 - a) * second[i] + (b ** 3 - b) * second[i + 1]) * (step ** 2 / 6);
    return a * values[i] + b * values[i + 1] + bent;
  };
}

/** The same, where each point says how to get to the next one: an easing of the camera path's format. */
function eased(times: readonly number[], values: readonly number[], easings: readonly string[]): (time: number) => number {
  const smooth = spline(times, values);
  return (time) => {
    const i = times.findLastIndex((one) => one <= time);
    if (i < 0 || i >= times.length - 1) return smooth(time);
    if (easings[i] === "hold") return values[i];
    const step = times[i + 1] - times[i];
    const share = (time - times[i]) / step;
    if (easings[i] === "linear") return (1 - share) * values[i] + share * values[i + 1];
    return smooth(easings[i] === "ease" ? times[i] + share * share * (3 - 2 * share) * step : time);
  };
}

/** The keys of a camera path file. */
function parseKeys(text: string): Key[] {
  const wrong = (problem: string): StreamError => new StreamError(`The intro's camera path ${problem}.`);
  let values: unknown;
  try {
    values = JSON.parse(text);
  } catch {
    throw wrong("is not readable JSON");
  }
  const { format, keys } = (values ?? {}) as { format?: unknown; keys?: unknown };
  if (format !== FORMAT || !Array.isArray(keys)) throw wrong(`is not a ${FORMAT}`);
  if (keys.length < 1 || keys.length > MAX_KEYS) throw wrong(`has ${keys.length} keys`);
  let last = -Infinity;
  return keys.map((key: Record<string, unknown> | null, i) => {
    const { time, easing = "smooth", camera: stored } = key ?? {};
    const camera = readCamera(stored);
    const fits = isNumber(time) && time > last && typeof easing === "string" && EASINGS.includes(easing) && camera !== null;
    if (!fits) throw wrong(`has an invalid key ${i}`);
    last = time;
    return { time, easing, camera };
  });
}

/** The views of a path over the seconds since its beginning, and its duration. */
export interface IntroPath {
  readonly seconds: number;
  readonly at: (seconds: number) => View;
}

/** @throws StreamError - not a camera path */
export function readPath(text: string, player: Player): IntroPath {
  const keys = parseKeys(text);
  const times = keys.map((key) => key.time - keys[0].time);
  const rows = keys.map(({ camera }) => {
    const { azimuth, elevation, distance, target } = player.camera.viewOf(pinholeOf(camera));
    return [azimuth, elevation, Math.log(distance), ...target];
  });
  // Never more than half a turn from key to key.
  for (let i = 1; i < rows.length; i++) rows[i][0] -= 360 * Math.round((rows[i][0] - rows[i - 1][0]) / 360);
  const easings = keys.map(({ easing }) => easing);
  const curves = rows[0].map((_, k) => eased(times, rows.map((row) => row[k]), easings));
  return {
    seconds: times[times.length - 1],
    at: (seconds) => {
      const [azimuth, elevation, distance, x, y, z] = curves.map((curve) => curve(seconds));
      return { azimuth, elevation, distance: Math.exp(distance), target: [x, y, z] };
    },
  };
}

/** The path that an attribute names: a URL, or `#ID` of an element that holds its JSON. StreamError: not a camera path. */
export async function loadPath(place: string, player: Player): Promise<IntroPath> {
  return readPath(await textAt(place), player);
}

/** Flies a path; the camera stays where the path ends, or where it is when the returned function is called. */
export function flyPath(player: Player, path: IntroPath, ended: () => void): () => void {
  let began: number | null = null;
  const tick = (now: number): void => {
    began ??= now;
    const seconds = (now - began) / 1000;
    player.view = path.at(seconds);
    if (seconds < path.seconds) handle = requestAnimationFrame(tick);
    else ended();
  };
  let handle = requestAnimationFrame(tick);
  return () => cancelAnimationFrame(handle);
}
