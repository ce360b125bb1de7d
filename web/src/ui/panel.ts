/** The info panel's playback statistics. */

import type { Player } from "../player/player.ts";
import { DECODERS } from "./choices.ts";
import { make } from "./dom.ts";
import { bytes, count, milliseconds, plural } from "./format.ts";

function figures(player: Player): [string, string][] {
  const { statistics: s, info, group, stream } = player;
  const { bandwidth } = stream.fetched;
  const received = bytes(stream.fetched.bytes);
  const wanted = Number(((info?.fps ?? 0) * player.speed).toFixed(2));
  const interval = s.interval.mean(60);
  const [width, height] = player.screen.size;
  const rows: [string, string][] = [
    ["Frame rate", !player.playing ? `paused (${wanted} fps)` : `${interval === 0 ? "–" : (1000 / interval).toFixed(1)} of ${wanted} fps`],
    ["Dropped", `${count(s.dropped)} of ${plural(s.shown + s.dropped, "frame")}, ${plural(s.stalls, "stall")}`],
    ["Splats", `${count(player.drawn)} of ${count(group?.splats ?? 0)}`],
    ["Decode", milliseconds(s.decode.mean())],
    ["Dequantize", milliseconds(s.dequantize.mean())],
    ["Sort", milliseconds(s.sort.mean())],
    ["Prepare", `${milliseconds(s.prepare.mean(4))} per group`],
    ["Upload", milliseconds(s.upload.mean())],
    ["Render", s.gpu.mean() > 0 ? `${milliseconds(s.draw.mean())} CPU, ${milliseconds(s.gpu.mean())} GPU` : `${milliseconds(s.draw.mean())} CPU`],
    ["Main thread", `${milliseconds(s.main.mean())} per frame`],
    ["Image", `${width} × ${height}`],
    ["Bandwidth", bandwidth === 0 ? "–" : `${bandwidth.toFixed(1)} Mbit/s`],
    // Of several renditions, only one of each group is fetched.
    ["Received", info?.renditions.length === 1 ? `${received} of ${bytes(info.totalBytes)}` : received],
  ];
  if (info !== null) {
    rows.push(["Stream", `${info.profile}, ${info.codec}, SH ${group?.sh_degree ?? info.shDegree}`]);
    if (group !== null) {
      const rate = `${bytes(group.bytes / group.frame_count)} per frame, ${((8e-6 * group.bytes * info.fps) / group.frame_count).toFixed(1)} Mbit/s`;
      rows.push(["Rendition", info.renditions.length === 1 ? rate : `${group.id} (one of ${info.renditions.length}), ${rate}`]);
    }
    rows.push(["Player", `${stream.path === null ? "–" : DECODERS[stream.path]}, WebGL2`]);
    rows.push(["Checked", info.checksums ? "sizes and SHA-256" : "sizes only; SHA-256 requires HTTPS"]);
  }
  return rows;
}

export function showFigures(table: HTMLElement, player: Player): void {
  table.replaceChildren(
    ...figures(player).map(([name, value]) => make("tr", {}, make("th", { scope: "row" }, name), make("td", {}, value))),
  );
}
