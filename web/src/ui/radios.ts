/** Groups of radio buttons: one of each is in the tab order, and arrow keys choose the next one. */

const STEPS: Partial<Record<string, number>> = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

/** Shows which one is chosen. */
export function checkRadio(all: Iterable<HTMLElement>, chosen: (radio: HTMLElement) => boolean): void {
  const radios = [...all];
  const found = radios.findIndex(chosen);
  radios.forEach((radio, index) => {
    radio.setAttribute("aria-checked", String(index === found));
    radio.tabIndex = index === Math.max(found, 0) ? 0 : -1;
  });
}

/** Chooses the neighbor of a radio button for an arrow key; whether the key was one for it. */
export function moveRadio(from: Element, key: string): boolean {
  const step = STEPS[key];
  const group = from.closest("[role=radiogroup]");
  if (step === undefined || group === null) return false;
  const radios = [...group.querySelectorAll<HTMLElement>("[role=radio]:not([hidden])")];
  const next = radios.at((radios.indexOf(from as HTMLElement) + step) % radios.length);
  next?.focus();
  next?.click();
  return true;
}
