/** Shares links to the time and view on the screen. A page with a review, which has `data-link`, asks which link: its own
 * address would let others change marks, so it is shared only when it is asked for by name. */

import type { View } from "../render/camera.ts";
import { linkTo } from "./link.ts";
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

export const canShare = (): boolean => typeof (navigator as Partial<Navigator>).share === "function";

/** Opens the share sheet; call it while handling an input of the viewer. Returns whether the link was passed on or the viewer
 * has closed the sheet; false: copy it instead. */
async function shareLink(url: string, title: string): Promise<boolean> {
  if (!canShare()) return false;
  try {
    await navigator.share({ url, title });
    return true;
  } catch (error) {
    return error instanceof DOMException && error.name === "AbortError";
  }
}

/** Copies text, also where there is no clipboard API: browsers give it to secure (HTTPS) pages only. `root`: where a field may
 * be put meanwhile; inside what is shown in full screen. Returns whether the text was copied. */
async function copyText(text: string, root: ParentNode & Node): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Without the API, this runs in the same turn, as part of the click that allows it.
    return copySelection(text, root);
  }
}

function copySelection(text: string, root: ParentNode & Node): boolean {
  const before = (root as Partial<ShadowRoot>).activeElement ?? null;
  const field = document.createElement("textarea");
  field.value = text;
  field.readOnly = true;
  field.style.cssText = "position:fixed;top:0;left:0;width:1px;height:1px;opacity:0;font-size:16px";
  root.append(field);
  field.select();
  field.setSelectionRange(0, text.length);
  try {
    // Deprecated, but all browsers have it, and the clipboard API is missing on http pages.
    // eslint-disable-next-line @typescript-eslint/no-deprecated
    return document.execCommand("copy");
  } catch {
    return false;
  } finally {
    field.remove();
    if (before instanceof HTMLElement) before.focus({ preventScroll: true });
  }
}
