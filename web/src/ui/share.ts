/** Passes a link on: with the system's share sheet where there is one, else by copying. */

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
