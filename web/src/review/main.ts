/**
 * Adds a review to the player's page: quality and size per frame, comparison with held-out footage, marks. Only
 * `v3studio serve --review` puts this script into a page.
 */

import type { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import type { V3PlayerElement } from "../ui/element.ts";
import { type Mark, type ReviewData, ReviewServer } from "./api.ts";
import { make } from "./dom.ts";
import { Marks } from "./marks.ts";
import { Plots } from "./plots.ts";
import css from "./style.css";
import { Wipe } from "./wipe.ts";

const FREE = "";

function build(panel: HTMLElement, element: V3PlayerElement, player: Player, server: ReviewServer, data: ReviewData): void {
  const fps = player.info?.fps ?? 25;
  const seek = (frame: number): void => {
    element.pause();
    player.seekFrame(frame);
  };
  const plots = new Plots(data.quality, data.frame_count, fps, seek);
  plots.show(player.frame);
  const marks = new Marks(server, fps, {
    frame: () => player.frame,
    pause: () => {
      element.pause();
    },
    seek: (frame) => {
      player.seekFrame(frame);
    },
    changed: (all: readonly Mark[]) => {
      plots.mark(all, seek);
    },
  });
  const choice = make("select", { "aria-label": "Compare with the footage of a camera" }, make("option", { value: FREE }, "Free view"));
  for (const { name } of data.cameras) choice.append(make("option", { value: name }, `Compare with ${name}`));
  const all = make("input", { type: "checkbox" });
  const allLabel = make("label", { hidden: "" }, all, " whole picture");
  const wipe = new Wipe(player, server, data.background, () => {
    choice.value = FREE;
    compare();
  });
  const compare = (): void => {
    const camera = data.cameras.find(({ name }) => name === choice.value) ?? null;
    wipe.show(camera, all.checked);
    plots.compare(camera?.name ?? null);
    allLabel.hidden = camera === null;
  };
  choice.addEventListener("change", compare);
  all.addEventListener("change", compare);
  const tools = make("div", { class: "row" }, ...(data.cameras.length > 0 ? [choice, allLabel] : []), marks.add, plots.readout);
  const problems = data.problems.map((text) => make("p", { class: "problem" }, text));
  panel.replaceChildren(tools, plots.element, ...problems, marks.element);
  player.on("frame", ({ frame }) => {
    plots.show(frame);
  });
}

async function start(): Promise<void> {
  const element = document.querySelector<V3PlayerElement>("v3-player[page]");
  if (element === null) return;
  document.head.append(make("style", {}, css));
  document.body.classList.add("v3-reviewed");
  const panel = make("section", { class: "v3-review", "aria-label": "Review" }, make("p", {}, "Loading the review …"));
  document.body.append(panel);
  await customElements.whenDefined("v3-player");
  const server = new ReviewServer(new URL(".review/", document.baseURI));
  const opened = new Promise<void>((resolve) => {
    if (element.engine?.info) resolve();
    else
      element.addEventListener("v3-opened", () => {
        resolve();
      }, { once: true });
  });
  try {
    const [data] = await Promise.all([server.data(), opened]);
    if (element.engine !== null) build(panel, element, element.engine, server, data);
  } catch (error) {
    panel.replaceChildren(make("p", { class: "problem", role: "alert" }, `The review cannot be loaded: ${messageOf(error)}`));
  }
}

void start();
