/** Adds a review to the player's page: quality and size per frame, comparison with held-out footage, marks. Only `v3studio
 * serve --review` puts this script into a page. */

import type { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import type { V3PlayerElement } from "../ui/element.ts";
import { type ReviewData, ReviewServer } from "./api.ts";
import { Comparison } from "./comparison.ts";
import { make } from "../ui/dom.ts";
import { linkTo } from "../ui/link.ts";
import { Pins } from "../ui/pins.ts";
import { LANGUAGE, WORDS } from "./language.ts";
import { Marks } from "./marks.ts";
import { Plots } from "./plots.ts";
import css from "./style.css";
import { wordsPanel } from "./words.ts";

function build(panel: HTMLElement, element: V3PlayerElement, player: Player, server: ReviewServer, data: ReviewData): void {
  const controls = element.ui!;
  const fps = player.info?.fps ?? 25;
  const seek = (frame: number): void => {
    element.pause();
    player.seekFrame(frame);
  };
  const plots = new Plots(data.quality, data.frame_count, fps, seek);
  plots.show(player.frame);
  const pins = new Pins(player);
  const comparison = new Comparison(element, player, server, data, plots);
  const marks = new Marks(server, fps, player, comparison, plots, pins, seek);
  const words = wordsPanel(data.quality, fps, player, controls.timeline, seek);
  const tools = make("div", { class: "row tools" }, comparison.button, marks.add, comparison.choices, words.now);
  const problems = data.problems.map((text) => make("p", { class: "problem" }, text));
  panel.replaceChildren(tools, marks.form, marks.problem, words.element, plots.element, ...problems, marks.element);
  player.on("frame", ({ frame }) => plots.show(frame));
  // The stream was baked again: its figures, too, are others.
  player.on("opened", () => location.replace(linkTo(location.href, player.seconds, player.view, controls.reviewParameters())));
  const compared = new URLSearchParams(location.search).get("compare");
  if (compared !== null) comparison.begin(compared);
  controls.reviewParameters = (): Record<string, string> => {
    const { camera } = comparison;
    return camera === null ? {} : { compare: camera.name };
  };
  controls.addHelp([
    ...(data.cameras.length === 0 ? [] : [
      { what: WORDS.compare, touch: `<i>${WORDS.compareWith}</i>, ${WORDS.dragLine}`, keys: `<kbd>W</kbd>, ${WORDS.dragLine}` },
    ]),
    { what: WORDS.comment, touch: `<i>${WORDS.mark}</i>, ${WORDS.below}`, keys: `<kbd>N</kbd> ${WORDS.marksView}` },
  ]);
  element.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey || event.ctrlKey) return;
    const action = { w: () => { comparison.toggle(); }, n: () => { marks.begin(); } }[event.key.toLowerCase()];
    if (action === undefined || (event.composedPath()[0] as Element).matches(".address")) return;
    event.preventDefault();
    action();
  });
}

async function start(): Promise<void> {
  const element = document.querySelector<V3PlayerElement>("v3-player[page]");
  if (element === null) return;
  document.head.append(make("style", {}, css));
  document.body.classList.add("v3-reviewed");
  const panel = make("section", { class: "v3-review", "aria-label": WORDS.review, lang: LANGUAGE }, make("p", {}, WORDS.loading));
  document.body.append(panel);
  await customElements.whenDefined("v3-player");
  const server = new ReviewServer(new URL(".review/", document.baseURI));
  const controlled = new Promise<void>((resolve) => {
    if (element.ui !== null) resolve();
    else element.addEventListener("v3-controls", () => resolve(), { once: true });
  });
  try {
    const [data] = await Promise.all([server.data(), controlled]);
    if (element.engine !== null) build(panel, element, element.engine, server, data);
  } catch (error) {
    panel.replaceChildren(make("p", { class: "problem", role: "alert" }, WORDS.broken(messageOf(error))));
  }
}

void start();
