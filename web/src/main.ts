/** Defines `<v3-player>`; on the player's own page, also applies URL parameters and handles messages of an embedding page. */

import { startWorker } from "./player/stream.ts";
import { messageOf } from "./stream/errors.ts";
import { V3PlayerElement } from "./ui/element.ts";
import { readParameters } from "./ui/values.ts";

export { V3PlayerElement };
export type { V3PlayerEventMap, V3PlayerHandlers, V3PlayerProperties, V3PlayerState } from "./ui/element.ts";
export { Player } from "./player/player.ts";

/** Attributes that a page has for its own stream, and not for one that a link names. */
const OWN = ["data-title", "data-credits", "data-license", "data-description", "data-link", "data-marks", "poster", "intro"];

/** The message interface for iframes, version 1 (docs/guides/web.md). Commands are harmless, so any embedding page may send
 * them; replies go to the embedding page. */
const VERSION = 1;
const EVENTS = ["opened", "ready", "play", "pause", "time", "view", "waiting", "ended", "looped", "sound", "notice", "updated", "error"] as const;

const COMMANDS = ["play", "pause", "seek", "setSpeed", "setMuted", "setView", "resetView", "setLoop", "setBackground"] as const;

const isCommand = (name: unknown): name is (typeof COMMANDS)[number] => COMMANDS.some((one) => one === name);

function listen(element: V3PlayerElement): void {
  if (window.parent === window) return;
  const post = (event: string, detail: unknown): void => {
    window.parent.postMessage({ v3player: VERSION, event, detail }, "*");
  };
  for (const event of EVENTS)
    element.addEventListener(`v3-${event}`, ({ detail }: CustomEvent<unknown>) => post(event, detail));
  window.addEventListener("message", ({ data, source }: MessageEvent<unknown>) => {
    if (source !== window.parent || typeof data !== "object" || data === null) return;
    const message = data as Record<string, unknown>;
    if (message["v3player"] !== VERSION) return;
    const { command, value } = message as { command?: unknown; value?: unknown };
    try {
      if (command === "getState") post("state", element.state);
      else if (isCommand(command)) element[command](value as never);
      else throw new RangeError(`There is no command ${String(command).slice(0, 40)}.`);
    } catch (error) {
      post("error", messageOf(error));
    }
  });
}

// Where pages are rendered on a server, there are no elements.
if ("customElements" in globalThis && customElements.get("v3-player") === undefined) {
  // URL parameters apply before the element starts.
  const page = document.querySelector<V3PlayerElement>("v3-player[page]");
  const link = readParameters(new URLSearchParams(location.search), page?.hasAttribute("allow-src") === true);
  if (page !== null) {
    try {
      startWorker();
    } catch {
      // the element says why
    }
    if (link.attributes.has("src")) {
      for (const name of OWN) page.removeAttribute(name);
      page.replaceChildren();
    }
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
