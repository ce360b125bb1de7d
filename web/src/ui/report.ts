/** The report of `?report`: this device's own figures while it plays, for people who cannot hold the device. In English. */

import type { Player } from "../player/player.ts";
import type { Controls } from "./controls.ts";
import { make } from "./dom.ts";
import { copyText } from "./give_link.ts";
import { figures } from "./panel.ts";
import { ENGLISH, type Words } from "./words.ts";

const [EARLY, LATE] = [10, 120]; // seconds of playback after which figures are taken; what is hot by then draws more slowly

type Row = readonly string[];

function device({ screen }: Player): Row[] {
  const { gl, maxTexture } = screen.renderer;
  const { userAgent, hardwareConcurrency, deviceMemory } = navigator as Navigator & { readonly deviceMemory?: number };
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const has = (extension: string): string => (gl.getExtension(extension) === null ? "no" : "yes");
  const [image] = performance.getEntriesByName("v3-first-image") as (PerformanceEntry | undefined)[];
  return [
    ["Browser", userAgent],
    ["Screen", `${window.screen.width} × ${window.screen.height}, ${devicePixelRatio} pixels each`],
    ["Processor", `${hardwareConcurrency} threads, ${deviceMemory ?? "?"} GB`],
    ["Graphics", String(gl.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER))],
    ["Largest texture", `${maxTexture}, ${gl.getParameter(gl.MAX_TEXTURE_IMAGE_UNITS)} at once`],
    ["Half floats", `${has("EXT_color_buffer_float")}, ${has("EXT_color_buffer_half_float")}`],
    ["WebCodecs", "VideoDecoder" in window ? "yes" : "no"],
    ["First image", image === undefined ? "?" : `${Math.round(image.startTime)} ms`],
  ];
}

/** Shows the report over the image, and takes figures twice. */
export function addReport(root: ShadowRoot, player: Player, controls: Controls, words: Words): void {
  const state = make("p", { role: "status" });
  const copy = make("button", { type: "button", class: "plain" }, words.copy);
  const body = make("tbody");
  root.append(make("section", { class: "sheet report", "aria-label": words.report }, make("h2", {}, words.report), state, copy, make("table", {}, body)));
  const fixed = device(player);
  let early: Row[] = [];
  let rows: Row[] = fixed;
  let seconds = 0;
  const measure = (): void => {
    const now = figures(player, ENGLISH);
    if (seconds <= EARLY) early = now;
    const late = now.map(([name, value], k) => (seconds <= EARLY ? [name, value] : [name, early[k]?.[1] ?? "", value]));
    rows = [...fixed, ["Seconds", `${Math.min(seconds, EARLY)}`, ...(seconds > EARLY ? [`${seconds}`] : [])], ...late];
    body.replaceChildren(...rows.map(([name, ...values]) => make("tr", {}, make("th", { scope: "row" }, name), ...values.map((value) => make("td", {}, value)))));
    state.textContent = seconds < LATE ? words.measuring(seconds, LATE) : words.measured;
  };
  copy.addEventListener("click", () => {
    const text = rows.map(([name, ...values]) => `${name}: ${values.join(" | ")}`).join("\n");
    void copyText(text, root).then((done) => controls.notice(done ? words.reportCopied : words.copyYourself));
  });
  measure();
  const timer = setInterval(() => {
    if (!player.playing || document.hidden) return;
    seconds++;
    measure();
    if (seconds === LATE) clearInterval(timer);
  }, 1000);
  player.stop.signal.addEventListener("abort", () => clearInterval(timer));
}
