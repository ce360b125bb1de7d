/** Tells first-time viewers that the view can be turned, until they have turned it once. */

import { remembered } from "./dom.ts";
import type { Words } from "./words.ts";

const KEY = "v3-has-turned"; // in this browser, somebody has moved a view before
const ALWAYS = 10_000; // milliseconds until the hint goes and comes with the controls

/** The hint that a page with several players shows: one is enough. */
let shown: HTMLElement | null = null;

export class Hint {
  private timer = 0;
  private done = false;

  /** @param element - hidden and empty; a live region, so that its text is read when it appears */
  constructor(private readonly element: HTMLElement) {}

  /** Shows it if the view was never turned in this browser. `wheel`: whether the wheel zooms, rather than scrolls the page
   * around the player. */
  show(wheel: boolean, words: Words): void {
    if (this.done || remembered(KEY) !== "" || (shown !== null && shown !== this.element)) return;
    shown = this.element;
    this.element.classList.add("shown");
    const fingers = matchMedia("(any-pointer: coarse)").matches;
    this.element.querySelector("b")!.textContent = words.drag;
    this.element.querySelector("small")!.textContent = fingers ? words.pinch : wheel ? words.scroll : "";
    this.timer = setTimeout(() => this.element.classList.add("brief"), ALWAYS);
  }

  /** The view was turned: it is not shown again. */
  turned(): void {
    if (this.done) return;
    this.done = true;
    remembered(KEY, "1");
    this.hide();
  }

  hide(): void {
    clearTimeout(this.timer);
    this.element.classList.remove("shown");
    if (shown === this.element) shown = null;
  }
}
