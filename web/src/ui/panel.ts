/** The info panel's playback statistics, and the report of `?report`: this device's own figures while it plays, in English, for
 * people who cannot hold the device. */

import type { Player } from "../player/player.ts";
import { DECODERS } from "./choices.ts";
import { make } from "./dom.ts";
import { bytes, count, milliseconds } from "./format.ts";
import { copyText } from "./give_link.ts";
import { ENGLISH, type Words } from "./words.ts";

function figures(player: Player, words: Words): [string, string][] {
  const names = words.figures;
  const { statistics: s, info, group, stream } = player;
  const { bandwidth } = stream.fetched;
  const received = bytes(stream.fetched.bytes);
  const wanted = Number(((info?.fps ?? 0) * player.speed).toFixed(2));
  const interval = s.interval.mean(60);
  const [width, height] = player.screen.size;
  const rows: [string, string][] = [
    [names.rate, !player.playing ? `${words.isPaused} (${wanted} fps)` : words.of(interval === 0 ? "–" : (1000 / interval).toFixed(1), `${wanted} fps`)],
    [names.dropped, `${words.of(count(s.dropped), words.frames(count(s.shown + s.dropped)))}, ${words.stalls}: ${count(s.stalls)}`],
    [names.splats, words.of(count(player.drawn), count(group?.splats ?? 0))],
    [names.decode, milliseconds(s.decode.mean())],
    [names.dequantize, milliseconds(s.dequantize.mean())],
    [names.sort, milliseconds(s.sort.mean())],
    [names.prepare, `${milliseconds(s.prepare.mean(4))} ${words.perGroup}`],
    [names.upload, milliseconds(s.upload.mean())],
    [names.render, s.gpu.mean() > 0 ? `${milliseconds(s.draw.mean())} CPU, ${milliseconds(s.gpu.mean())} GPU` : `${milliseconds(s.draw.mean())} CPU`],
    [names.main, `${milliseconds(s.main.mean())} ${words.perFrame}`],
    [names.image, `${width} × ${height}`],
    [names.bandwidth, bandwidth === 0 ? "–" : `${bandwidth.toFixed(1)} Mbit/s`],
    // Of several renditions, only one of each group is fetched.
    [names.received, info?.renditions.length === 1 ? words.of(received, bytes(info.totalBytes)) : received],
  ];
  if (info !== null) {
    rows.push([names.stream, `SH ${group?.sh_degree ?? info.shDegree}`]);
    if (group !== null) {
      const rate = `${bytes(group.bytes / group.frame_count)} ${words.perFrame}, ${((8e-6 * group.bytes * info.fps) / group.frame_count).toFixed(1)} Mbit/s`;
      rows.push([names.rendition, info.renditions.length === 1 ? rate : `${words.of(group.id, String(info.renditions.length))}, ${rate}`]);
    }
    rows.push([names.player, `${stream.path === null ? "–" : DECODERS[stream.path]}, WebGL2`]);
    rows.push([names.checked, info.checksums ? words.sizes : words.sizesOnly]);
  }
  return rows;
}

export function showFigures(table: HTMLElement, player: Player, words: Words): void {
  table.replaceChildren(
    ...figures(player, words).map(([name, value]) => make("tr", {}, make("th", { scope: "row" }, name), make("td", {}, value))),
  );
}

const [EARLY, LATE] = [10, 120]; // seconds of playback after which figures are taken; what is hot by then draws more slowly

type Row = readonly string[];

function device({ screen }: Player): Row[] {
  const { gl, graphics, maxTexture } = screen.renderer;
  const { userAgent, hardwareConcurrency, deviceMemory } = navigator as Navigator & { readonly deviceMemory?: number };
  const has = (extension: string): string => (gl.getExtension(extension) === null ? "no" : "yes");
  const [image] = performance.getEntriesByName("v3-first-image") as (PerformanceEntry | undefined)[];
  return [
    ["Browser", userAgent],
    ["Screen", `${window.screen.width} × ${window.screen.height}, ${devicePixelRatio} pixels each`],
    ["Processor", `${hardwareConcurrency} threads, ${deviceMemory ?? "?"} GB`],
    ["Graphics", graphics],
    ["Largest texture", `${maxTexture}, ${gl.getParameter(gl.MAX_TEXTURE_IMAGE_UNITS)} at once`],
    ["Half floats", `${has("EXT_color_buffer_float")}, ${has("EXT_color_buffer_half_float")}`],
    ["WebCodecs", "VideoDecoder" in window ? "yes" : "no"],
    ["First image", image === undefined ? "?" : `${Math.round(image.startTime)} ms`],
  ];
}

/** Shows the report over the image, and takes figures twice. */
export function addReport(root: ShadowRoot, player: Player, words: Words, notice: (message: string) => void): void {
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
    void copyText(text, root).then((done) => notice(done ? words.reportCopied : words.copyYourself));
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
