/** The module `@v3studio/player/stream`: a stream without an element. */

export { SplatPlayback } from "./player/splat_playback.ts";
export { type StreamEvents, type StreamOptions, V3Stream } from "./player/stream.ts";
export type { PlayerEvents } from "./player/events.ts";
export { StreamError } from "./stream/errors.ts";
export type { Splats, StreamInfo } from "./worker/messages.ts";
