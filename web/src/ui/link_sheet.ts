/**
 * Copies links to the time and view on the screen. A page with a review asks which link: its own address would let
 * others change marks, so it is copied only when it is asked for by name.
 */

import type { View } from "../render/camera.ts";
import { copyText } from "./copy.ts";
import { linkTo } from "./link.ts";

export interface LinkHost {
  readonly root: ShadowRoot;
  /** Where the stream can be watched without the review, relative to the page; null: on this page. */
  readonly watching: () => string | null;
  /** Time in seconds and view on the screen; null before the stream is open. */
  readonly place: () => { readonly seconds: number; readonly view: View } | null;
  readonly notice: (message: string) => void;
}

export class LinkSheet {
  /** Further URL parameters of links to the review. */
  reviewParameters: () => Readonly<Record<string, string>> = () => ({});

  constructor(private readonly host: LinkHost) {}

  /** Copies the page's link, or asks which one. */
  async copy(): Promise<void> {
    const watching = this.host.watching();
    if (watching === null) {
      const address = this.address(location.href);
      try {
        history.replaceState(null, "", address);
      } catch {
        // some browsers forbid it on pages that were opened from the disk
      }
      await this.give(address, "Link to this time and view copied.");
      return;
    }
    this.show(null);
    const open = this.part(".which").hidden;
    this.part(".which").hidden = !open;
    if (open) this.part(".which [data-act='link-watch']").focus({ preventScroll: true });
  }

  async copyToWatch(): Promise<void> {
    const base = new URL(this.host.watching() ?? "", document.baseURI).href;
    await this.give(this.address(base), "Link to watch copied. It opens this moment without the review.");
  }

  async copyToReview(): Promise<void> {
    const address = this.address(location.href, this.reviewParameters());
    await this.give(address, "Link to this review copied. Anyone who has it sees the footage and can change marks.");
  }

  hide(): void {
    this.part(".which").hidden = true;
    this.show(null);
  }

  private address(base: string, more: Readonly<Record<string, string>> = {}): string {
    const { seconds, view } = this.host.place()!;
    return linkTo(base, seconds, view, more);
  }

  private async give(address: string, done: string): Promise<void> {
    this.part(".which").hidden = true;
    if (await copyText(address, this.host.root)) {
      this.show(null);
      this.host.notice(done);
    } else this.show(address);
  }

  /** Shows a link to be copied by hand; null hides it. */
  private show(address: string | null): void {
    this.part(".copy").hidden = address === null;
    if (address === null) return;
    const field = this.part<HTMLInputElement>(".address");
    field.value = address;
    field.focus({ preventScroll: true });
    field.select();
  }

  // The caller knows the element's type from the template.
  // eslint-disable-next-line @typescript-eslint/no-unnecessary-type-parameters
  private part<T extends HTMLElement = HTMLElement>(selector: string): T {
    return this.host.root.querySelector<T>(selector)!;
  }
}
