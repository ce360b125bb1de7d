/** Actions of the viewer with gestures, keys and buttons: one table, of which *Help* is made. docs/WEB.md lists them, too. */

import type { Controls } from "./controls.ts";
import type { HelpLine } from "./format.ts";
import type { Words } from "./words.ts";

const kbd = (...keys: readonly string[]): string =>
  keys.map((key) => `<kbd>${key.length === 1 ? key.toUpperCase().replace("<", "&lt;") : key}</kbd>`).join(" ");

interface Action {
  /** A line of *Help*, to which the keys are added; gestures are in motion.ts and timeline.ts. HTML. */
  readonly help?: (words: Words) => HelpLine;
  /** Values of `KeyboardEvent.key`; letters in lower case. */
  readonly keys?: readonly string[];
  /** `data-act` of its buttons (template.ts). */
  readonly act?: string;
  /** `key` is the pressed one; "" for a button. */
  readonly run?: (controls: Controls, key: string) => void;
}

/** All actions, in the order of *Help*. */
const ACTIONS: readonly Action[] = [
  { help: (words) => ({ what: words.turn, touch: words.oneFinger, keys: `${words.leftButton}, ${kbd("←", "→", "↑", "↓")}` }) },
  { help: (words) => ({ what: words.move, touch: words.twoFingers, keys: `${words.rightButton}, <kbd>Shift</kbd> ${words.withAbove}` }) },
  { help: (words) => ({ what: words.zoom, touch: words.pinchOnly, keys: `${words.wheel}, ${kbd("+", "−")}` }) },
  { help: (words) => ({ what: words.reset, touch: words.doubleTap, keys: words.doubleClick }), keys: ["r"], act: "reset", run: ({ motion }) => motion.reset() },
  { help: (words) => ({ what: words.controls, touch: words.tap }) },
  { help: (words) => ({ what: words.seek, touch: words.dragTimeline }) },
  { help: (words) => ({ what: words.playPause }), keys: [" ", "k"], act: "play", run: (controls) => controls.togglePlay() },
  { help: (words) => ({ what: words.second }), keys: ["j", "l"], run: (controls, key) => controls.skip(key === "j" ? -1 : 1) },
  { help: (words) => ({ what: words.frame }), keys: [",", "."], run: (controls, key) => controls.step(key === "," ? -1 : 1) },
  { help: (words) => ({ what: words.slower }), keys: ["<", ">"], run: (controls, key) => controls.changeSpeed(key === "<" ? -1 : 1) },
  { help: (words) => ({ what: words.sound }), keys: ["m"], act: "sound", run: (controls) => controls.toggleSound() },
  { help: (words) => ({ what: words.background }), keys: ["b"], run: (controls) => controls.nextBackground() },
  { help: (words) => ({ what: words.full }), keys: ["f"], act: "full", run: (controls) => void controls.toggleFull() },
  { help: (words) => ({ what: words.statistics }), keys: ["i"], act: "info", run: ({ sheets }) => sheets.toggle("info") },
  { help: (words) => ({ what: words.share }), keys: ["c"], act: "link", run: (controls) => controls.share() },
  { help: (words) => ({ what: words.help }), keys: ["?"], act: "help", run: ({ sheets }) => sheets.toggle("help") },
  { help: (words) => ({ what: words.gamepad, keys: words.gamepadMore }) },
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

export const helpLines = (words: Words): HelpLine[] => ACTIONS.flatMap(({ help, keys = [] }) => {
  if (help === undefined) return [];
  const line = help(words);
  const parts = [line.keys, kbd(...keys.map((key) => (key === " " ? words.space : key)))].filter(Boolean);
  return [parts.length === 0 ? line : { ...line, keys: parts.join(", ") }];
});

/** Runs the actions of buttons and keys, below a shadow root and on its host. */
export function listen(root: ShadowRoot, controls: Controls, signal: AbortSignal): void {
  const { host, motion } = controls;
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
    if (event.key !== "Shift" && event.key !== "Tab") host.endIntro();
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
    motion.shift = event.shiftKey;
    motion.release(event);
  }, { signal });
}
