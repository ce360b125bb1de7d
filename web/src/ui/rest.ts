/** The part that is loaded once there is an image: controls, intros, VR and AR, sound; and decoding by `<video>`. */

import type { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import { listen } from "./actions.ts";
import { Controls, type ControlsHost } from "./controls.ts";
import { addStyle } from "./dom.ts";
import { languageOf, setLanguage } from "./first_words.ts";
import { addNotes } from "./notes.ts";
import { addReport } from "./panel.ts";
import css from "./style.css";
import { template } from "./template.ts";
import { wordsOf } from "./words.ts";

export { Sound } from "../player/sound.ts";
export { VideoReader } from "../player/video_reader.ts";
export { flyPath, loadPath } from "./intro.ts";
export { inLanguage } from "./words.ts";

/** Adds the controls to a player's element. */
export function addControls(host: ControlsHost, root: ShadowRoot, player: Player): Controls {
  root.querySelector(".failure")!.insertAdjacentHTML("beforebegin", template(wordsOf(host)));
  setLanguage(root, languageOf(host));
  addStyle(root, css);
  const controls = new Controls(host, root, player);
  listen(root, controls, player.stop.signal);
  const notes = host.getAttribute("data-marks");
  if (notes !== null)
    addNotes(notes, root, player, controls, wordsOf(host)).catch((error: unknown) => controls.notice(messageOf(error)));
  const isReport = host.hasAttribute("page") && new URLSearchParams(location.search).has("report");
  if (isReport) addReport(root, player, wordsOf(host), (message) => controls.notice(message));
  return controls;
}
