/** The module `@v3studio/player/stream`: a stream without an element. */

export { SplatPlayback } from "./player/splat_playback.ts";
export type { PlayerEvents } from "./player/playback.ts";
export { type StreamOptions, V3Stream } from "./player/stream.ts";
export { StreamError } from "./stream/errors.ts";
export type { Splats, StreamEvents, StreamInfo } from "./worker/messages.ts";
