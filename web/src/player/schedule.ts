/** The choice of the frame after another one: over skipped groups, around the end of a loop, up to the newest of a live stream. */

import { groupOfFrame, type Span } from "../stream/manifest.ts";

export interface Course {
  readonly groups: readonly Span[];
  readonly frameCount: number;
  readonly live: boolean;
  /** Whether the first frame follows the last one. */
  readonly looping: boolean;
  /** Groups that are skipped. */
  readonly leftOut: ReadonlyMap<number, string>;
}

/** The frame itself, or the first one of the next group that is not skipped, also around the end; null if there is none. */
export function playable({ groups, leftOut }: Course, frame: number): number | null {
  const first = groupOfFrame(groups, frame);
  if (!leftOut.has(first)) return frame;
  for (let step = 1; step <= groups.length; step++) {
    const group = (first + step) % groups.length;
    if (!leftOut.has(group)) return groups[group].firstFrame;
  }
  return null;
}

/** Decides what to show when `frame` is due, which may be past the end: "end" if playback stops, "wait" if frames may still come.
 * Returns the frame; what to add to it on a clock that continues past the end; whether groups are skipped. */
export function dueFrame(course: Course, frame: number): { frame: number; lap: number; skips: boolean } | "wait" | "end" {
  const past = frame >= course.frameCount;
  const wanted = past ? 0 : frame;
  const found = playable(course, wanted);
  const around = past || found === null || found < wanted;
  if (found === null || (around && course.live)) return "wait";
  if (around && !course.looping) return "end";
  return { frame: found, lap: around ? course.frameCount : 0, skips: found !== wanted };
}
