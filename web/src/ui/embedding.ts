/** The message interface for iframes, version 1 (docs/guides/web.md). Commands are harmless, so any embedding page may send
 * them; replies go to the embedding page. */

import { messageOf } from "../stream/errors.ts";
import type { V3PlayerElement } from "./element.ts";

const VERSION = 1;
const EVENTS = ["opened", "ready", "play", "pause", "time", "view", "waiting", "ended", "looped", "sound", "notice", "updated", "error"];

const COMMANDS = ["play", "pause", "seek", "setSpeed", "setMuted", "setView", "resetView", "setLoop", "setBackground"] as const;

const isCommand = (name: unknown): name is (typeof COMMANDS)[number] => COMMANDS.some((one) => one === name);

export function listen(element: V3PlayerElement): void {
  if (window.parent === window) return;
  const post = (event: string, detail: unknown): void => {
    window.parent.postMessage({ v3player: VERSION, event, detail }, "*");
  };
  for (const event of EVENTS)
    element.addEventListener(`v3-${event}`, (sent) => post(event, (sent as CustomEvent).detail));
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
