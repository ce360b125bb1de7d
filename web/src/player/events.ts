/** What a player reports to those that show it. */

import type { View } from "../render/camera.ts";
import type { StreamInfo } from "../worker/messages.ts";

export interface PlayerEvents {
  /** The manifest has been read; the first image is loading. */
  opened: StreamInfo;
  /** The first image is on the canvas. */
  ready: undefined;
  play: undefined;
  pause: undefined;
  /** Another frame is shown. */
  frame: { readonly frame: number; readonly seconds: number };
  seeked: { readonly frame: number };
  /** The canvas was rendered; it can be copied in the handler. */
  rendered: { readonly frame: number };
  /** The end was reached without looping. */
  ended: undefined;
  looped: undefined;
  waiting: boolean;
  view: View;
  fetched: { readonly groups: readonly number[] };
  /** A live stream has more frames, or is complete. */
  grown: StreamInfo;
  /** Sound was loaded, muted, or blocked by the browser; see `Player.sound`. */
  sound: undefined;
  /** Another bake has taken the stream's place; open it again to see that one. */
  updated: undefined;
  /** A message for the viewer; playback continues. */
  notice: string;
  /** Nothing can be played. */
  failed: string;
}
