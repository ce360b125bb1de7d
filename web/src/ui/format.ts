/** Formats numbers for display. */

export function clock(seconds: number): string {
  const whole = Math.floor(seconds);
  const rest = String(whole % 60).padStart(2, "0");
  const tenth = Math.floor((seconds - whole) * 10);
  return `${Math.floor(whole / 60)}:${rest}.${tenth}`;
}

export function bytes(count: number): string {
  if (count < 1e6) return `${(count / 1e3).toFixed(0)} kB`;
  return count < 1e9 ? `${(count / 1e6).toFixed(1)} MB` : `${(count / 1e9).toFixed(2)} GB`;
}

export const milliseconds = (value: number): string => (value === 0 ? "–" : `${value.toFixed(value < 10 ? 1 : 0)} ms`);

export const count = (value: number): string => value.toLocaleString("en-US");
