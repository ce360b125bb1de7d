/** What is loaded once there is an image: controls, intros, VR and AR. */

import type { Player } from "../player/player.ts";
import { type HelpLine, listen } from "./actions.ts";
import { Controls, type ControlsHost } from "./controls.ts";
import css from "./style.css";
import { helpRow, template } from "./template.ts";
import { languageOf, wordsOf } from "./words.ts";

export { flyPath, loadPath } from "./intro.ts";

/** Adds the controls to a player's element. */
export function addControls(host: ControlsHost, root: ShadowRoot, player: Player, signal: AbortSignal): Controls {
  root.querySelector(".failure")!.insertAdjacentHTML("beforebegin", template(wordsOf(host)));
  for (const part of root.children) if (part instanceof HTMLElement) part.lang = languageOf(host);
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(css);
  root.adoptedStyleSheets.push(sheet);
  const controls = new Controls(host, root, player, signal);
  listen(host, root, controls, signal);
  return controls;
}

/** Adds lines to *Help*. */
export function addHelp(root: ShadowRoot, lines: readonly HelpLine[]): void {
  root.querySelector(".help tbody")!.insertAdjacentHTML("afterbegin", lines.map(helpRow).join(""));
}
