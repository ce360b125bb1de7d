/** What the viewer can do with gestures, keys and buttons: one table, of which *Help* is made. docs/WEB.md lists the same. */

import type { Controls } from "./controls.ts";

const kbd = (...keys: readonly string[]): string =>
  keys.map((key) => `<kbd>${key === " " ? "Space" : key.toUpperCase().replace("<", "&lt;")}</kbd>`).join(" ");

/** What something does, and how: with fingers, and with mouse and keys. HTML. */
export interface HelpLine {
  readonly what: string;
  readonly touch?: string;
  readonly keys?: string;
}

interface Action {
  /** A line of *Help*, to which the keys are added; gestures are in motion.ts and timeline.ts. HTML. */
  readonly help?: HelpLine;
  /** As in `KeyboardEvent.key`; letters in lower case. */
  readonly keys?: readonly string[];
  /** `data-act` of its buttons (template.ts). */
  readonly act?: string;
  /** `key` is the pressed one; "" for a button. */
  readonly run?: (controls: Controls, key: string) => void;
}

/** In the order of *Help*. */
const ACTIONS: readonly Action[] = [
  { help: { what: "Turn", touch: "drag with one finger", keys: `left button, ${kbd("←", "→", "↑", "↓")}` } },
  { help: { what: "Move", touch: "drag with two fingers", keys: `right button, <kbd>Shift</kbd> with the above` } },
  { help: { what: "Zoom", touch: "pinch", keys: `wheel, ${kbd("+", "−")}` } },
  { help: { what: "Reset view", touch: "double tap", keys: "double click" }, keys: ["r"], act: "reset", run: ({ motion }) => motion.reset() },
  { help: { what: "Controls", touch: "tap: show or hide" } },
  { help: { what: "Seek", touch: "drag along the timeline" } },
  { help: { what: "Play, pause" }, keys: [" ", "k"], act: "play", run: (controls) => controls.togglePlay() },
  { help: { what: "Back, forward 1 s" }, keys: ["j", "l"], run: (controls, key) => controls.skip(key === "j" ? -1 : 1) },
  { help: { what: "Previous, next frame" }, keys: [",", "."], run: (controls, key) => controls.step(key === "," ? -1 : 1) },
  { help: { what: "Slower, faster" }, keys: ["<", ">"], run: (controls, key) => controls.changeSpeed(key === "<" ? -1 : 1) },
  { help: { what: "Sound" }, keys: ["m"], act: "sound", run: (controls) => controls.toggleSound() },
  { help: { what: "Background" }, keys: ["b"], run: (controls) => controls.nextBackground() },
  { help: { what: "Full screen" }, keys: ["f"], act: "full", run: (controls) => void controls.toggleFull() },
  { help: { what: "Statistics" }, keys: ["i"], act: "info", run: ({ sheets }) => sheets.toggle("info") },
  { help: { what: "Share" }, keys: ["c"], act: "link", run: (controls) => controls.share() },
  { help: { what: "Help" }, keys: ["?"], act: "help", run: ({ sheets }) => sheets.toggle("help") },
  { help: { what: "Gamepad", keys: "left stick turns, right stick moves, triggers zoom; A plays, B resets the view" } },
  { keys: ["Escape"], run: ({ sheets }) => sheets.close() },
  { act: "start", run: ({ host }) => host.play() },
  { act: "update", run: ({ host }) => host.openUpdated() },
  { act: "settings", run: ({ sheets }) => sheets.toggle("settings") },
  { act: "vr", run: (controls) => void controls.toggleImmersion("vr") },
  { act: "ar", run: (controls) => void controls.toggleImmersion("ar") },
  { act: "link-watch", run: (controls) => controls.shareToWatch() },
  { act: "link-review", run: (controls) => controls.shareReview() },
  { act: "close", run: ({ sheets }) => sheets.close() },
];

export const HELP: readonly HelpLine[] = ACTIONS.flatMap(({ help, keys = [] }) => {
  if (help === undefined) return [];
  const parts = [help.keys, kbd(...keys)].filter(Boolean);
  return [parts.length === 0 ? help : { ...help, keys: parts.join(", ") }];
});

/** Runs the actions of buttons and keys, below a shadow root and on its host. */
export function listen(host: HTMLElement, root: ShadowRoot, controls: Controls, signal: AbortSignal): void {
  root.addEventListener("click", (event) => {
    const pressed = (event.target as Element).closest<HTMLElement>("button");
    if (pressed === null) return;
    const { act } = pressed.dataset;
    // A pointer on the large button turns the view, or taps, as everywhere on the stage.
    if (act !== "start" || (event as MouseEvent).detail === 0)
      ACTIONS.find((action) => act !== undefined && action.act === act)?.run?.(controls, "");
    controls.awake();
  }, { signal });
  root.addEventListener("change", ({ target }) => {
    controls.choose(target as HTMLInputElement);
    controls.awake();
  }, { signal });
  host.addEventListener("keydown", (event) => {
    if (event.altKey || event.metaKey || event.ctrlKey) return;
    const { motion } = controls;
    if (event.key !== "Shift" && event.key !== "Tab") controls.host.endIntro();
    motion.shift = event.shiftKey;
    const from = event.composedPath()[0] as Element;
    // The link to copy by hand is selected and copied with keys.
    if (from.matches(".address") && event.key !== "Escape") return;
    // Arrow keys scroll what is in a sheet, or choose.
    if (event.key.startsWith("Arrow") && from.closest("[role=dialog]") !== null) return;
    // Anyone who has a keyboard may want to know its keys.
    host.classList.add("has-keys");
    // Letters also with Caps Lock.
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    // Space also presses a focused button.
    const onButton = from.matches("button, input");
    const isFor = host.hasAttribute("controls") && !(onButton && name === " ");
    const action = !isFor ? undefined : ACTIONS.find(({ keys }) => keys?.includes(name));
    if (action !== undefined) action.run?.(controls, name);
    else if (onButton || !motion.press(event)) return;
    event.preventDefault();
    controls.awake();
  }, { signal });
  host.addEventListener("keyup", (event) => {
    controls.motion.shift = event.shiftKey;
    controls.motion.release(event);
  }, { signal });
}
