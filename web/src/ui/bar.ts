/** Behavior that the controls of a player and of a cast's page have in common: labels, notices, full screen, and hiding while
 * nobody looks for them. */

import { messageOf } from "../stream/errors.ts";
import { languageOf } from "./first_words.ts";
import * as ICONS from "./icons.ts";
import { inLanguage, type Words, wordsOf } from "./words.ts";

const IDLE = 3000; // milliseconds without user input until the controls hide
const NOTICE = 5000;

export abstract class Bar<Host extends HTMLElement = HTMLElement> {
  protected readonly words: Words;
  private idleTimer = 0;
  private noticeTimer = 0;

  constructor(readonly host: Host, protected readonly root: ShadowRoot) {
    this.words = wordsOf(host);
  }

  /** Whether the controls may hide now. */
  protected abstract mayHide(): boolean;

  /** Shows the controls for a while. */
  awake(): void {
    this.host.classList.remove("idle");
    clearTimeout(this.idleTimer);
    this.idleTimer = window.setTimeout(() => {
      if (this.mayHide()) this.host.classList.add("idle");
    }, IDLE);
  }

  notice(message: string): void {
    const element = this.part(".notice");
    element.textContent = inLanguage(message, languageOf(this.host));
    element.classList.add("shown");
    clearTimeout(this.noticeTimer);
    this.noticeTimer = window.setTimeout(() => element.classList.remove("shown"), NOTICE);
  }

  async toggleFull(): Promise<void> {
    try {
      if (document.fullscreenElement === this.host) await document.exitFullscreen();
      else await this.host.requestFullscreen();
    } catch (error) {
      this.notice(this.words.unavailable(this.words.full, messageOf(error)));
    }
  }

  protected clearTimers(): void {
    clearTimeout(this.idleTimer);
    clearTimeout(this.noticeTimer);
  }

  protected showPlaying(playing: boolean): void {
    this.relabel("play", playing ? ICONS.pause : ICONS.play, playing ? this.words.pause : this.words.play);
  }

  protected relabel(act: string, icon: string, label: string): void {
    const button = this.part(`.bar [data-act='${act}']`);
    button.innerHTML = icon;
    button.title = label;
    button.setAttribute("aria-label", label);
  }

  protected part(selector: string): HTMLElement {
    return this.root.querySelector<HTMLElement>(selector)!;
  }
}
