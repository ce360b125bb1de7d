/** Keeps the page above a phone's keyboard while something is written. Safari lays the keyboard over the page; browsers that
 * know `interactive-widget=resizes-content` make the page smaller themselves. */

const fit = (): void => {
  const { visualViewport: seen, document: { body } } = window;
  // Not while the viewer has zoomed in.
  if (seen === null || seen.scale > 1.01) return;
  body.style.height = `${seen.height}px`;
  window.scrollTo(0, 0);
};

export function fitToKeyboard(writing: boolean): void {
  const { visualViewport: seen } = window;
  if (seen === null) return;
  for (const name of ["resize", "scroll"] as const)
    if (writing) seen.addEventListener(name, fit);
    else seen.removeEventListener(name, fit);
  if (writing) fit();
  else document.body.style.height = "";
}
