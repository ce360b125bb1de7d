/** Makes elements, adds style sheets, and remembers values. Text is always set as text, never as HTML: notes come from others. */

type Attributes = Readonly<Record<string, string>>;

export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: readonly (Node | string)[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

export function draw(tag: "svg" | "path" | "line", attributes: Attributes = {}): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

const sheets = new Map<string, CSSStyleSheet>();

/** Adds a style sheet, which all players of a page share; not by <style>, which a page's Content-Security-Policy may forbid. */
export function addStyle(root: ShadowRoot, css: string): void {
  let sheet = sheets.get(css);
  if (sheet === undefined) {
    sheet = new CSSStyleSheet();
    sheet.replaceSync(css);
    sheets.set(css, sheet);
  }
  root.adoptedStyleSheets.push(sheet);
}

/** The text that an attribute names: of the element `#ID`, or at an address. */
export async function textAt(place: string): Promise<string> {
  if (place.startsWith("#")) return document.querySelector(place)?.textContent ?? "";
  return (await fetch(new URL(place, document.baseURI))).text();
}

/** A value that this browser keeps, from now on `value`; "" if there is none. A browser may forbid storage. */
export function remembered(key: string, value?: string): string {
  try {
    if (value !== undefined) localStorage.setItem(key, value);
    return localStorage.getItem(key) ?? "";
  } catch {
    return "";
  }
}
