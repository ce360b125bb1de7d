/** Text from values: numbers, and rows of Help. */

/** Minutes, seconds and tenths, rounded. */
export function clock(seconds: number): string {
  const tenths = Math.round(10 * seconds);
  const rest = String(Math.floor(tenths / 10) % 60).padStart(2, "0");
  return `${Math.floor(tenths / 600)}:${rest}.${tenths % 10}`;
}

export function bytes(count: number): string {
  if (count < 1e6) return `${(count / 1e3).toFixed(0)} KB`;
  return count < 1e9 ? `${(count / 1e6).toFixed(1)} MB` : `${(count / 1e9).toFixed(2)} GB`;
}

export const milliseconds = (value: number): string => (value === 0 ? "–" : `${value.toFixed(value < 10 ? 1 : 0)} ms`);

export const count = (value: number): string => value.toLocaleString("en-US");

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
