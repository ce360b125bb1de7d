/** The info panel: live playback statistics. */

import type { Player } from "../player/player.ts";
import { bytes, count, milliseconds } from "./format.ts";

const PATHS = { webcodecs: "WebCodecs", "webcodecs-software": "WebCodecs, software", video: "video element" } as const;

export function figures(player: Player): [string, string][] {
  const { statistics: s, info } = player;
  const interval = s.interval.mean(60);
  const { drawn, all } = player.splats;
  const [width, height] = player.drawSize;
  const rows: [string, string][] = [
    ["Frames", interval === 0 || !player.playing ? "–" : `${(1000 / interval).toFixed(1)} fps of ${info?.fps ?? 0}`],
    ["Dropped", `${s.dropped} of ${s.shown + s.dropped}, ${s.stalls} stalls`],
    ["Splats", `${count(drawn)} of ${count(all)}`],
    ["Decode", milliseconds(s.decode.mean())],
    ["Dequantize", milliseconds(s.dequantize.mean())],
    ["Sort", milliseconds(s.sort.mean())],
    ["Upload", milliseconds(s.upload.mean())],
    ["Draw", s.gpu.count > 0 ? `${milliseconds(s.draw.mean())} CPU, ${milliseconds(s.gpu.mean())} GPU` : `${milliseconds(s.draw.mean())} CPU`],
    ["Main thread", `${milliseconds(s.main.mean())} per frame`],
    ["Picture", `${width} × ${height}`],
    ["Bandwidth", player.bandwidth === 0 ? "–" : `${player.bandwidth.toFixed(1)} Mbit/s`],
    ["Received", `${bytes(player.receivedBytes)} of ${bytes(info?.totalBytes ?? 0)}`],
  ];
  if (info !== null) {
    rows.push(["Stream", `${info.profile}, ${info.codec}, SH ${info.shDegree}, ${bytes(info.totalBytes / info.frameCount)}/frame`]);
    rows.push(["Player", `${player.path === null ? "–" : PATHS[player.path]}, ${player.rendererName}`]);
    if (player.withoutWebGPU !== null) rows.push(["WebGPU", `not used: ${player.withoutWebGPU}`]);
    rows.push(["Checked", info.checksums ? "sizes and SHA-256" : "sizes only; SHA-256 requires HTTPS"]);
  }
  return rows;
}

export class Panel {
  private readonly element: HTMLElement;
  private readonly player: Player;
  private timer = 0;

  constructor(element: HTMLElement, player: Player) {
    this.element = element;
    this.player = player;
  }

  get open(): boolean {
    return !this.element.hidden;
  }

  toggle(open = !this.open): void {
    this.element.hidden = !open;
    clearInterval(this.timer);
    if (!open) return;
    this.refresh();
    this.timer = setInterval(() => {
      this.refresh();
    }, 500);
  }

  private refresh(): void {
    const table = this.element.querySelector("tbody")!;
    table.replaceChildren(
      ...figures(this.player).map(([name, value]) => {
        const row = document.createElement("tr");
        const head = document.createElement("th");
        head.scope = "row";
        head.textContent = name;
        const cell = document.createElement("td");
        cell.textContent = value;
        row.append(head, cell);
        return row;
      }),
    );
  }
}
