/** The page of a cast around its scene: the player's own bar, title, hint and poster. */

import { messageOf } from "../stream/errors.ts";
import { Bar } from "../ui/bar.ts";
import { addStyle } from "../ui/dom.ts";
import css from "../ui/first.css";
import { firstTemplate, languageOf, setLanguage } from "../ui/first_words.ts";
import { clock as clockText } from "../ui/format.ts";
import { Hint } from "../ui/hint.ts";
import * as ICONS from "../ui/icons.ts";
import more from "../ui/style.css";
import { barTemplate, button } from "../ui/template.ts";
import { Motion, type Viewed } from "../ui/motion.ts";
import { Timeline } from "../ui/timeline.ts";
import type { CastClock } from "./clock.ts";

export class CastPage extends Bar {
  readonly stage: HTMLElement;
  readonly canvas: HTMLCanvasElement;
  private readonly hint: Hint;
  private clock: CastClock | null = null;

  constructor(host: HTMLElement) {
    super(host, host.attachShadow({ mode: "open" }));
    const { root, words } = this;
    for (const text of [css, more]) addStyle(root, text);
    root.innerHTML = `${firstTemplate(languageOf(host))}
<div class="top"><header class="head"><h1 class="title"></h1><p class="credits"></p></header><div class="notice" role="status" aria-live="polite"></div></div>
${barTemplate(words, `<div class="gap"></div>${button("reset", words.reset, ICONS.reset)}${button("full", words.full, ICONS.full)}`)}`;
    setLanguage(root, languageOf(host));
    this.stage = this.part(".stage");
    this.canvas = root.querySelector("canvas")!;
    this.hint = new Hint(this.part(".hint"));
    this.part(".title").textContent = document.title;
    this.part(".credits").textContent = host.dataset["credits"] ?? "";
    this.part("[data-act='again']").addEventListener("click", () => location.reload());
    this.part("[data-act='full']").hidden = !document.fullscreenEnabled;
    this.part(".veil").classList.add("busy");
  }

  /** What it returns; if it fails, the page says why. */
  async attempt<T>(make: () => T | Promise<T>): Promise<T> {
    try {
      return await make();
    } catch (error) {
      this.part(".veil").classList.remove("busy");
      this.part(".why").textContent = messageOf(error);
      this.part(".failure").hidden = false;
      throw error;
    }
  }

  /** Shows the scene and the bar. `viewed`: what gestures and keys move. */
  begin(clock: CastClock, viewed: Viewed): void {
    const { host, root } = this;
    this.clock = clock;
    const motion = new Motion(this.stage, viewed, { tap: () => undefined, input: () => undefined, touched: () => this.hint.turned() });
    const toggle = (): void => (clock.playing ? clock.pause() : clock.play());
    const acts: Partial<Record<string, () => void>> = {
      play: toggle, reset: () => motion.reset(), full: () => void this.toggleFull(),
    };
    const keys: Partial<Record<string, string>> = { " ": "play", k: "play", r: "reset", f: "full" };
    root.addEventListener("click", (event) => acts[(event.target as Element).closest<HTMLElement>("button")?.dataset["act"] ?? ""]?.());
    host.addEventListener("keydown", (event) => {
      motion.shift = event.shiftKey;
      const act = acts[keys[event.key.toLowerCase()] ?? ""];
      if (event.ctrlKey || event.metaKey || event.altKey || (event.key === " " && (event.composedPath()[0] as Element).matches("button"))) return;
      if (act !== undefined) act();
      else if (!motion.press(event)) return;
      event.preventDefault();
    });
    host.addEventListener("keyup", (event) => {
      motion.shift = event.shiftKey;
      motion.release(event);
    });
    for (const kind of ["pointermove", "pointerdown", "keydown"]) host.addEventListener(kind, () => this.awake());
    const timeline = new Timeline(this.part(".timeline"), clock, null, this.words);
    clock.on("frame", ({ frame, seconds }) => {
      timeline.update(frame);
      this.part(".now").textContent = clockText(seconds);
    });
    for (const name of ["play", "pause"] as const) clock.on(name, () => this.showPlaying(clock.playing));
    this.part(".total").textContent = `/ ${clockText(clock.duration)}`;
    this.part(".veil").classList.remove("busy");
    this.part(".poster").classList.add("gone");
    host.classList.add("begun");
    this.hint.show(true, this.words);
    this.showPlaying(clock.playing);
  }

  protected mayHide(): boolean {
    return this.clock?.playing === true;
  }

  protected override showPlaying(playing: boolean): void {
    super.showPlaying(playing);
    this.awake();
  }
}
