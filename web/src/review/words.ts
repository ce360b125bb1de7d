/** The words that a client reads first: how good the take is, how good the frame on the screen is, and where to look. */

import type { Player } from "../player/player.ts";
import { make } from "../ui/dom.ts";
import { clock } from "../ui/format.ts";
import type { Timeline } from "../ui/timeline.ts";
import type { MetricCurves, QualityCurves } from "./api.ts";
import { WORDS } from "./language.ts";

const MOST = 3; // moments that are shown

type Word = "good" | "visible loss" | "bad";

type Rated = Pick<MetricCurves, "decoded" | "words">;

/** A frame's quality; null if it was not measured. */
export function wordOf({ decoded, words }: Rated, frame: number): Word | null {
  const value = decoded[frame] ?? null;
  if (value === null || words === null) return null;
  return value >= words[0] ? "good" : value >= words[1] ? "visible loss" : "bad";
}

const label = (rated: Rated, frame: number): string => {
  const word = wordOf(rated, frame);
  return word === null ? WORDS.unmeasured : WORDS.grades[word];
};

/** The worst frame of each of the worst passages that are not good, at most `most`, in the order of time. */
export function worstFrames(rated: Rated, most: number): number[] {
  const { decoded } = rated;
  const worst: number[] = [];
  let open = false;
  decoded.forEach((value, frame) => {
    const word = wordOf(rated, frame);
    const lossy = word !== null && word !== "good";
    if (lossy && !open) worst.push(frame);
    else if (lossy && value! < decoded[worst.at(-1)!]!) worst[worst.length - 1] = frame;
    open = lossy;
  });
  const value = (frame: number): number => decoded[frame]!;
  return worst.sort((a, b) => value(a) - value(b)).slice(0, most).sort((a, b) => a - b);
}

/** How many frames are how good, for the whole take. */
export function summaryOf(rated: Rated): string {
  const words = rated.decoded.map((_, frame) => wordOf(rated, frame)).filter((word) => word !== null);
  if (words.length === 0) return WORDS.notYet;
  const parts = (["good", "visible loss", "bad"] as const).flatMap((word) => {
    const share = Math.round((100 * words.filter((one) => one === word).length) / words.length);
    return words.includes(word) ? [WORDS.time(WORDS.grades[word], share < 1 ? WORDS.belowOne : `${share}%`)] : [];
  });
  return WORDS.quality(parts.join(", "));
}

/** Returns the word for the frame on the screen, and the summary with the worst moments, which are marked on the timeline. */
export function wordsPanel(
  quality: QualityCurves | null,
  fps: number,
  player: Player,
  timeline: Timeline,
  seek: (frame: number) => void,
): { now: HTMLElement; element: HTMLElement } {
  const now = make("p", { class: "now" });
  const metric = quality?.metrics[0];
  if (metric === undefined) return { now, element: make("div", { class: "words" }) };
  const show = (frame: number): void => {
    now.textContent = `${clock(frame / fps)} · ${label(metric, frame)}`;
  };
  player.on("frame", ({ frame }) => show(frame));
  show(player.frame);
  const worst = worstFrames(metric, MOST);
  timeline.mark(worst);
  const moments = worst.map((frame) => {
    const go = make("button", { type: "button" }, make("b", {}, clock(frame / fps)), ` ${label(metric, frame)}`);
    go.addEventListener("click", () => seek(frame));
    return go;
  });
  const places = moments.length === 0 ? [] : [make("div", { class: "row worst" }, make("span", {}, WORDS.worst), ...moments)];
  return { now, element: make("div", { class: "words" }, make("p", {}, summaryOf(metric)), ...places) };
}
