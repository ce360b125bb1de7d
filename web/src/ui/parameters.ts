/** The parameters of a page's URL (docs/WEB.md, "URL parameters"). */

import type { PartialView } from "../render/camera.ts";
import { isBackground, isDecoder } from "./choices.ts";
import { parseTime, parseView } from "./link.ts";

export interface Parameters {
  /** Attributes of the element that they set. */
  readonly attributes: ReadonlyMap<string, string>;
  /** Where to start, in seconds. */
  readonly time: number | null;
  readonly view: PartialView | null;
  /** What cannot be used, in a viewer's words. */
  readonly ignored: readonly string[];
}

/** @param takesSource - whether the page plays streams that a link names */
export function readParameters(query: URLSearchParams, takesSource: boolean): Parameters {
  const time = parseTime(query.get("t"));
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
