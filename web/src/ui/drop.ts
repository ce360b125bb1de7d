/** Files that are dropped onto the player: streams in one file (`.v3s`). */

/** Opens a dropped stream. `refused`: called with the name of a file of another kind. */
export function acceptDrops(
  target: HTMLElement,
  open: (file: File) => void,
  refused: (name: string) => void,
  signal: AbortSignal,
): void {
  target.addEventListener("dragover", (event) => {
    if (event.dataTransfer?.types.includes("Files") === true) event.preventDefault();
  }, { signal });
  target.addEventListener("drop", (event) => {
    const file = event.dataTransfer?.files[0];
    if (file === undefined) return;
    event.preventDefault();
    if (/\.v3s$/i.test(file.name)) open(file);
    else refused(file.name);
  }, { signal });
}
