/** Formats numbers for display. */

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
