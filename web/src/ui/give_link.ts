/** Gives a link to the viewer: by the share sheet of the system, or by the clipboard. */

export const canShare = (): boolean => typeof (navigator as Partial<Navigator>).share === "function";

/** Opens the share sheet; call it while handling an input of the viewer. Returns whether the link was passed on or the viewer
 * has closed the sheet; false: copy it instead. */
export async function shareLink(url: string, title: string): Promise<boolean> {
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
export async function copyText(text: string, root: ParentNode & Node): Promise<boolean> {
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
