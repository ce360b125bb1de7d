/** The sheets over the image: one is open at a time, and closing it returns the focus to what opened it. */

export type SheetName = "settings" | "help" | "info" | "copy" | "which";

export class Sheets {
  /** The one that is open. */
  open: SheetName | null = null;
  private opener: HTMLElement | null = null;

  /** @param changed - called with the sheet that is open now; null: none */
  constructor(private readonly root: ShadowRoot, private readonly changed: (name: SheetName | null) => void) {}

  show(name: SheetName): void {
    const active = this.root.activeElement;
    // A sheet that was opened from another one leads back to what opened that.
    if (active instanceof HTMLElement && active.closest(".sheet") === null) this.opener = active;
    this.change(name);
    this.sheet(name).focus({ preventScroll: true });
  }

  toggle(name: SheetName): void {
    if (this.open === name) this.close();
    else this.show(name);
  }

  /** @param returnFocus - false: the viewer has chosen another place */
  close(returnFocus = true): void {
    if (this.open === null) return;
    const inside = this.sheet(this.open).contains(this.root.activeElement);
    this.change(null);
    if (!returnFocus || !inside) return;
    const visible = this.opener?.isConnected === true && this.opener.checkVisibility();
    (visible ? this.opener! : this.root.querySelector<HTMLElement>(".stage")!).focus({ preventScroll: true });
  }

  private change(name: SheetName | null): void {
    if (this.open !== null) this.sheet(this.open).hidden = true;
    if (name !== null) this.sheet(name).hidden = false;
    this.open = name;
    this.changed(name);
  }

  private sheet(name: SheetName): HTMLElement {
    return this.root.querySelector<HTMLElement>(`.sheet.${name}`)!;
  }
}
