/** Shares links to the time and view on the screen. A page with a review asks which link: its own address would let others
 * change marks, so it is shared only when it is asked for by name. */

import type { View } from "../render/camera.ts";
import { copyText } from "./copy.ts";
import { linkTo } from "./link.ts";
import { shareLink } from "./share.ts";
import type { Sheets } from "./sheets.ts";

export interface LinkHost {
  readonly root: ShadowRoot;
  /** Where the stream can be watched without the review, relative to the page; null: on this page. */
  readonly watching: () => string | null;
  /** Time in seconds and view on the screen; null before the stream is open. */
  readonly place: () => { readonly seconds: number; readonly view: View } | null;
  readonly notice: (message: string) => void;
  readonly sheets: () => Sheets;
}

export class LinkSheet {
  /** Further URL parameters of links to the review. */
  reviewParameters: () => Readonly<Record<string, string>> = () => ({});

  constructor(private readonly host: LinkHost) {}

  /** Shares the page's link, or asks which one. */
  async share(): Promise<void> {
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
    this.host.sheets().toggle("which");
  }

  async toWatch(): Promise<void> {
    const base = new URL(this.host.watching() ?? "", document.baseURI).href;
    await this.give(this.address(base), "Link to watch copied. It opens this moment without the review.");
  }

  async toReview(): Promise<void> {
    const address = this.address(location.href, this.reviewParameters());
    await this.give(address, "Link to this review copied. Anyone who has it sees the footage and can change marks.");
  }

  private address(base: string, more: Readonly<Record<string, string>> = {}): string {
    const { seconds, view } = this.host.place()!;
    return linkTo(base, seconds, view, more);
  }

  private async give(address: string, done: string): Promise<void> {
    const { root } = this.host;
    this.host.sheets().close();
    if (await shareLink(address, document.title)) return;
    if (await copyText(address, root)) {
      this.host.notice(done);
      return;
    }
    // To be copied by hand.
    this.host.sheets().show("copy");
    const field = root.querySelector<HTMLInputElement>(".address")!;
    field.value = address;
    field.focus({ preventScroll: true });
    field.select();
  }
}
