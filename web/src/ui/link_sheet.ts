/** Shares links to the time and view on the screen. A page with a review, which has `data-link`, asks which link: its own
 * address would let others change marks, so it is shared only when it is asked for by name. */

import type { View } from "../render/camera.ts";
import { linkTo } from "./link.ts";
import { copyText, shareLink } from "./share.ts";
import type { Sheets } from "./sheets.ts";

/** The element whose time and view are shared. */
export interface LinkHost extends HTMLElement {
  readonly engine: { readonly seconds: number; readonly view: View } | null;
  notice(message: string): void;
}

export class LinkSheet {
  /** Further URL parameters of links to the review. */
  reviewParameters: () => Readonly<Record<string, string>> = () => ({});

  constructor(private readonly element: LinkHost, private readonly sheets: () => Sheets) {}

  /** Shares the page's link, or asks which one. */
  async share(): Promise<void> {
    if (!this.element.hasAttribute("data-link")) {
      const address = this.address(location.href);
      try {
        history.replaceState(null, "", address);
      } catch {
        // some browsers forbid it on pages that were opened from the disk
      }
      await this.give(address, "Link to this time and view copied.");
      return;
    }
    this.sheets().toggle("which");
  }

  async toWatch(): Promise<void> {
    const base = new URL(this.element.getAttribute("data-link") ?? "", document.baseURI).href;
    await this.give(this.address(base), "Link to watch copied. It opens this moment without the review.");
  }

  async toReview(): Promise<void> {
    const address = this.address(location.href, this.reviewParameters());
    await this.give(address, "Link to this review copied. Anyone who has it sees the footage and can change marks.");
  }

  private address(base: string, more: Readonly<Record<string, string>> = {}): string {
    const { seconds, view } = this.element.engine!;
    return linkTo(base, seconds, view, more);
  }

  private async give(address: string, done: string): Promise<void> {
    const root = this.element.shadowRoot!;
    this.sheets().close();
    if (await shareLink(address, document.title)) return;
    if (await copyText(address, root)) {
      this.element.notice(done);
      return;
    }
    // To be copied by hand.
    this.sheets().show("copy");
    const field = root.querySelector<HTMLInputElement>(".address")!;
    field.value = address;
    field.focus({ preventScroll: true });
    field.select();
  }
}
