/** Defines `<v3-player>`; on the player's own page, also applies URL parameters and handles messages of an embedding page. */

import { startWorker } from "./player/spare_worker.ts";
import { V3PlayerElement } from "./ui/element.ts";
import { listen } from "./ui/embedding.ts";
import { parseTime, parseView } from "./ui/link.ts";

export { V3PlayerElement };
export { Player } from "./player/player.ts";

if (customElements.get("v3-player") === undefined) {
  // URL parameters apply before the element starts.
  const page = document.querySelector<V3PlayerElement>("v3-player[page]");
  if (page !== null) startWorker();
  const query = new URLSearchParams(location.search);
  for (const name of ["src", "background", "decoder"] as const) {
    const value = query.get(name);
    if (page !== null && value !== null) page.setAttribute(name, value);
  }
  customElements.define("v3-player", V3PlayerElement);
  if (page !== null) {
    const time = parseTime(query.get("t"));
    const view = parseView(query.get("view"));
    if (time !== null) {
      page.pause();
      page.seek(time);
    }
    if (view !== null) page.setView(view);
    listen(page);
  }
}
