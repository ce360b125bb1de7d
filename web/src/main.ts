/** Defines `<v3-player>`; on the player's own page, also applies URL parameters and handles messages of an embedding page. */

import { startWorker } from "./player/spare_worker.ts";
import { V3PlayerElement } from "./ui/element.ts";
import { listen } from "./ui/embedding.ts";
import { readParameters } from "./ui/parameters.ts";

export { V3PlayerElement };
export { Player } from "./player/player.ts";

/** What a page says of its own stream, and not of one that a link names. */
const OWN = ["data-title", "data-credits", "data-license", "data-description", "data-link", "poster", "intro"];

if (customElements.get("v3-player") === undefined) {
  // URL parameters apply before the element starts.
  const page = document.querySelector<V3PlayerElement>("v3-player[page]");
  const link = readParameters(new URLSearchParams(location.search), page?.hasAttribute("allow-src") === true);
  if (page !== null) {
    startWorker();
    if (link.attributes.has("src")) for (const name of OWN) page.removeAttribute(name);
    for (const [name, value] of link.attributes) page.setAttribute(name, value);
  }
  customElements.define("v3-player", V3PlayerElement);
  if (page !== null) {
    if (link.time !== null) {
      page.pause();
      page.seek(link.time);
    }
    if (link.view !== null) page.setView(link.view);
    if (link.ignored.length > 0) page.notice(`The link is damaged: ignored its ${link.ignored.join(" and ")}.`);
    listen(page);
  }
}
