/** The page of `?benchmark`: progress, then the results and a button to save them. */

import { benchmark, type BenchmarkResult } from "./benchmark.ts";
import type { V3PlayerElement } from "./element.ts";
import { plural } from "./format.ts";

export function runBenchmark(element: V3PlayerElement): void {
  element.addEventListener("v3-ready", () => {
    const player = element.engine!;
    const sheet = document.createElement("section");
    sheet.className = "sheet bench";
    sheet.setAttribute("aria-label", "Benchmark");
    sheet.innerHTML = `<h2>Benchmark</h2><p>Playing 300 frames while the camera orbits.</p><progress max="1" value="0"></progress>`;
    element.shadowRoot!.append(sheet);
    const bar = sheet.querySelector("progress")!;
    void benchmark(player, (part) => {
      bar.value = part;
    }).then((result) => {
      show(sheet, result);
      (window as unknown as Record<string, unknown>)["v3benchmark"] = result;
    });
  }, { once: true });
}

function show(sheet: HTMLElement, result: BenchmarkResult): void {
  const { frames, milliseconds, stream, picture } = result;
  sheet.innerHTML = `<h2>Benchmark</h2><p></p><table><thead><tr><th scope="col">Milliseconds</th><td>5%</td><td>median</td><td>95%</td></tr></thead><tbody></tbody></table>
<div class="actions choices"><button type="button" data-save>Save as JSON</button></div>`;
  sheet.querySelector("p")!.textContent =
    `${frames.rate} of ${frames.wanted} fps; ${plural(frames.dropped, "dropped frame")}, ${plural(frames.stalls, "stall")}. ` +
    `${stream["splats"]} splats, SH ${stream["shDegree"]}, ${picture.width} × ${picture.height}.`;
  const body = sheet.querySelector("tbody")!;
  for (const [name, { p5, median, p95 }] of Object.entries(milliseconds)) {
    const row = body.insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = name;
    row.append(head);
    for (const value of [p5, median, p95]) row.insertCell().textContent = value.toFixed(2);
  }
  sheet.querySelector("[data-save]")!.addEventListener("click", () => {
    const address = URL.createObjectURL(new Blob([JSON.stringify(result, null, 1)], { type: "application/json" }));
    const link = document.createElement("a");
    link.href = address;
    link.download = "v3player-benchmark.json";
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  });
}
