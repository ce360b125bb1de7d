/**
 * The message interface for iframes, version 1 (docs/WEB.md). Commands are harmless, so any embedding page may send them;
 * replies go to the embedding page.
 */

import type { PartialView } from "../render/camera.ts";
import { parseView } from "./link.ts";
import { isBackground } from "./choices.ts";
import type { V3PlayerElement } from "./element.ts";

const VERSION = 1;
const EVENTS = ["opened", "ready", "play", "pause", "time", "view", "waiting", "ended", "looped", "sound", "notice", "error"];

/** A view as in links, or an object of which parts can be missing; null if it is malformed. */
function readView(value: unknown): PartialView | null {
  if (typeof value === "string") return parseView(value);
  if (typeof value !== "object" || value === null) return null;
  const { azimuth, elevation, distance, target, ...others } = value as Record<string, unknown>;
  const number = (one: unknown): one is number => typeof one === "number" && Number.isFinite(one);
  if (Object.keys(others).length > 0) return null;
  if (![azimuth, elevation, distance].every((one) => one === undefined || number(one))) return null;
  if (distance !== undefined && !(Number(distance) > 0)) return null;
  if (target !== undefined && !(Array.isArray(target) && target.length === 3 && target.every(number))) return null;
  const given = Object.entries({ azimuth, elevation, distance, target }).filter(([, one]) => one !== undefined);
  return given.length > 0 ? (Object.fromEntries(given)) : null;
}

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
    if (command === "play") element.play();
    else if (command === "pause") element.pause();
    else if (command === "seek" && typeof value === "number" && Number.isFinite(value)) element.seek(value);
    else if (command === "setSpeed" && typeof value === "number" && Number.isFinite(value)) element.setSpeed(value);
    else if (command === "setMuted" && typeof value === "boolean") element.setMuted(value);
    else if (command === "setView") {
      const view = readView(value);
      if (view !== null) element.setView(view);
      else post("error", "setView requires a view: azimuth, elevation, distance and target.");
    } else if (command === "resetView") element.resetView();
    else if (command === "setLoop" && typeof value === "boolean") element.setLoop(value);
    else if (command === "setBackground" && typeof value === "string" && isBackground(value)) element.setBackground(value);
    else if (command === "getState") post("state", element.state);
    else post("error", `Command ${String(command).slice(0, 40)} is unknown, or its value is missing or invalid.`);
  });
}
