/** The lines of *Help*. */

/** An action's name, and how it is done with fingers, and with mouse and keys. HTML. */
export interface HelpLine {
  readonly what: string;
  readonly touch?: string;
  readonly keys?: string;
}

export const helpRow = ({ what, touch, keys }: HelpLine): string => {
  const only = touch === undefined ? "keys" : keys === undefined ? "touch" : "";
  const cells = [touch && `<span class="touch">${touch}</span>`, keys && `<span class="keys">${keys}</span>`].join("");
  return `<tr class="${only}"><th scope="row">${what}</th><td>${cells}</td></tr>`;
};
