/** Order of display and order of decoding, which differ where there are B-frames. */

import { StreamError } from "../stream/errors.ts";

/** Place of each packet in the order of display, which is that of the time stamps. */
export function inDisplayOrder(packets: readonly { readonly timestamp: number }[]): number[] {
  const order = packets.map((_, at) => at).sort((a, b) => packets[a].timestamp - packets[b].timestamp);
  const places = new Array<number>(packets.length);
  order.forEach((at, picture) => {
    if (picture > 0 && packets[at].timestamp === packets[order[picture - 1]].timestamp)
      throw new StreamError("two of its pictures have the same time");
    places[at] = picture;
  });
  return places;
}

/** For each image: how many packets hold it and all images before it. B-frames need some that come later. */
export function packetsNeeded(packets: readonly { readonly picture: number }[]): number[] {
  const needed = new Array<number>(packets.length).fill(0);
  packets.forEach(({ picture }, at) => {
    needed[picture] = at + 1;
  });
  for (let picture = 1; picture < needed.length; picture++)
    needed[picture] = Math.max(needed[picture], needed[picture - 1]);
  return needed;
}
