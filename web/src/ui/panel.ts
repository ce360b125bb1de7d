/** The info panel's playback statistics. */

import type { Player } from "../player/player.ts";
import { DECODERS } from "./choices.ts";
import { make } from "./dom.ts";
import { bytes, count, milliseconds } from "./format.ts";
import type { Words } from "./words.ts";

export function figures(player: Player, words: Words): [string, string][] {
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
    rows.push([names.stream, `${info.profile}, ${info.codec}, SH ${group?.sh_degree ?? info.shDegree}`]);
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
