/** The shapes of curves in a plot, without the page: ranges and SVG paths. */

export type Series = readonly (number | null)[];

/** The place of a frame in a plot, 0 to 1, as on the player's timeline. */
export const placeOf = (frame: number, count: number): number => (count > 1 ? frame / (count - 1) : 0.5);

/** The frame at a place, 0 to 1. */
export const frameAt = (place: number, count: number): number =>
  Math.max(0, Math.min(count - 1, Math.round(place * (count - 1))));

/** Whole numbers around all values, at least 2 apart; null if there are none. */
export function curveRange(...series: readonly Series[]): [number, number] | null {
  const known = series.flat().filter((value) => value !== null);
  if (known.length === 0) return null;
  const low = Math.floor(Math.min(...known));
  return [low, Math.max(Math.ceil(Math.max(...known)), low + 2)];
}

/** The range from zero to the first tick at or above all values. */
export function sizeRange(series: Series): [number, number] | null {
  const known = series.filter((value) => value !== null);
  if (known.length === 0) return null;
  const top = Math.max(...known, 1e-9);
  const step = ticks(0, top, 4)[1];
  return [0, Number((step * Math.ceil(top / step - 1e-9)).toPrecision(12))];
}

/** Round values from low to high: steps of 1, 2 or 5 times a power of ten, about `count` of them. */
export function ticks(low: number, high: number, count: number): number[] {
  const least = (high - low) / count;
  if (!(least > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * ([1, 2, 5, 10].find((one) => one * power >= least * (1 - 1e-9)) ?? 10);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

/** A curve through the known values in a box of `width` by 100; gaps where values are missing. */
export function linePath(series: Series, [low, high]: readonly [number, number], width: number): string {
  let path = "";
  let open = false;
  series.forEach((value, frame) => {
    if (value === null) {
      open = false;
      return;
    }
    const x = (placeOf(frame, series.length) * width).toFixed(2);
    const y = (100 - (100 * (value - low)) / (high - low)).toFixed(2);
    // a value alone is still a dot
    path += open ? `L${x} ${y}` : `M${x} ${y}h0.01`;
    open = true;
  });
  return path;
}

/** Steps from one frame to the next, filled down to zero. */
export function areaPath(series: Series, high: number, width: number): string {
  const count = series.length;
  const half = count > 1 ? width / (count - 1) / 2 : width / 2;
  let path = "";
  series.forEach((value, frame) => {
    if (value === null) return;
    const x = placeOf(frame, count) * width;
    const [left, right] = [Math.max(0, x - half), Math.min(width, x + half)].map((place) => place.toFixed(2)) as [string, string];
    path += `M${left} 100V${(100 - (100 * value) / high).toFixed(2)}H${right}V100Z`;
  });
  return path;
}
