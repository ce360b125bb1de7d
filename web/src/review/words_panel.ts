/** What a client reads first: how good the take is, how good the frame on the screen is, and where to look. */

import type { Player } from "../player/player.ts";
import { clock } from "../ui/format.ts";
import type { V3PlayerElement } from "../ui/element.ts";
import type { QualityCurves } from "./api.ts";
import { make } from "../ui/dom.ts";
import { summaryOf, wordOf, worstFrames } from "./words.ts";

const MOST = 3; // moments that are shown

/** Returns the word for the frame on the screen, and the summary with the worst moments, which are marked on the timeline. */
export function wordsPanel(
  quality: QualityCurves | null,
  fps: number,
  player: Player,
  element: V3PlayerElement,
  seek: (frame: number) => void,
): { now: HTMLElement; element: HTMLElement } {
  const now = make("p", { class: "now" });
  const metric = quality?.metrics[0];
  if (metric === undefined) return { now, element: make("div", { class: "words" }) };
  const show = (frame: number): void => {
    now.textContent = `${clock(frame / fps)} · ${wordOf(metric, frame) ?? "not measured"}`;
  };
  player.on("frame", ({ frame }) => show(frame));
  show(player.frame);
  const worst = worstFrames(metric, MOST);
  element.controls?.timeline.mark(worst);
  const moments = worst.map((frame) => {
    const go = make("button", { type: "button" }, make("b", {}, clock(frame / fps)), ` ${wordOf(metric, frame) ?? ""}`);
    go.addEventListener("click", () => seek(frame));
    return go;
  });
  const places = moments.length === 0 ? [] : [make("div", { class: "row worst" }, make("span", {}, "Worst moments:"), ...moments)];
  return { now, element: make("div", { class: "words" }, make("p", {}, summaryOf(metric)), ...places) };
}
