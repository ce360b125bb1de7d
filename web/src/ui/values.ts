/** Checks values from outside: arguments of the element's methods, messages of an embedding page, attributes and URL
 * parameters. */

import type { PartialView } from "../render/camera.ts";
import { MAX_VALUE } from "../stream/metadata.ts";
import { BACKGROUNDS, type BackgroundName, isBackground, isDecoder } from "./choices.ts";
import { parseView } from "./link.ts";

const VIEW =
  "setView requires an object with some of azimuth, elevation, distance (above 0) and target ([x, y, z]), " +
  'or text such as "30,10"';

/** The passed value, for messages. */
const shown = (value: unknown): string =>
  typeof value === "object" && value !== null ? "an object" : typeof value === "string" ? `"${value.slice(0, 60)}"` : String(value);

function wrong(what: string, value: unknown): RangeError {
  return new RangeError(`${what}; found ${shown(value)}.`);
}

const isNumber = (value: unknown): value is number =>
  typeof value === "number" && Number.isFinite(value) && Math.abs(value) <= MAX_VALUE;

/** A time in seconds. */
export function readSeconds(value: unknown): number {
  if (!isNumber(value)) throw wrong("seek requires a number of seconds", value);
  return value;
}

/** A speed, 0.1 to 4. */
export function readSpeed(value: unknown): number {
  if (!isNumber(value) || value < 0.1 || value > 4) throw wrong("setSpeed requires a number from 0.1 to 4", value);
  return value;
}

/** @param method - for the message */
export function readSwitch(value: unknown, method: string): boolean {
  if (typeof value !== "boolean") throw wrong(`${method} requires true or false`, value);
  return value;
}

export function readBackground(value: unknown): BackgroundName {
  if (!isBackground(value)) throw wrong(`setBackground requires one of ${Object.keys(BACKGROUNDS).join(", ")}`, value);
  return value;
}

/** A view as in links, or an object of which parts can be missing. */
export function readView(value: unknown): PartialView {
  const view = typeof value === "string" ? parseView(value) : value;
  const parts = (typeof view === "object" ? view ?? {} : {}) as Readonly<Record<string, unknown>>;
  const { azimuth, elevation, distance, target, ...others } = parts;
  const numbers = [azimuth, elevation, distance].every((one) => one === undefined || isNumber(one));
  const point = target === undefined || (Array.isArray(target) && target.length === 3 && target.every(isNumber));
  const given = Object.entries({ azimuth, elevation, distance, target }).filter(([, one]) => one !== undefined);
  const fits = numbers && point && given.length > 0 && Object.keys(others).length === 0;
  if (!fits || (isNumber(distance) && distance <= 0)) throw wrong(VIEW, value);
  return Object.fromEntries(given);
}

/** The parameters of a page's URL (docs/WEB.md, "URL parameters"). */
export interface Parameters {
  /** Attributes of the element that they set. */
  readonly attributes: ReadonlyMap<string, string>;
  /** The time to start at, in seconds. */
  readonly time: number | null;
  readonly view: PartialView | null;
  /** The unusable parameters, in a viewer's words. */
  readonly ignored: readonly string[];
}

/** @param takesSource - whether the page plays streams that a link names */
export function readParameters(query: URLSearchParams, takesSource: boolean): Parameters {
  const seconds = query.get("t")?.trim() ? Number(query.get("t")) : NaN;
  const time = seconds >= 0 && seconds <= MAX_VALUE ? seconds : null;
  const view = parseView(query.get("view"));
  const usable = {
    src: { what: "video", fits: takesSource && query.get("src") !== "" },
    background: { what: "background", fits: isBackground(query.get("background")) },
    decoder: { what: "decoder", fits: isDecoder(query.get("decoder")) },
    t: { what: "time", fits: time !== null },
    view: { what: "view", fits: view !== null },
  };
  const given = Object.entries(usable).filter(([name]) => query.has(name));
  const ignored = given.filter(([, { fits }]) => !fits).map(([, { what }]) => what);
  const attributes = given.filter(([name, { fits }]) => fits && name !== "t" && name !== "view");
  return { attributes: new Map(attributes.map(([name]) => [name, query.get(name)!])), time, view, ignored };
}
