/** Plays splats in another engine, which calls `advance` for each image that it renders. */

import type { Splats } from "../worker/messages.ts";
import { Playback } from "./playback.ts";
import type { StreamOptions } from "./stream.ts";

export class SplatPlayback extends Playback<Splats> {
  private held: Splats | null = null;

  /** @param use - gets each frame that is due; its arrays are valid until the next call */
  constructor(private readonly use: (splats: Splats) => void, options: StreamOptions = {}) {
    super(options);
  }

  protected override ask(frame: number, seek: boolean): void {
    this.stream.frame(frame, seek).then(
      (splats) => {
        if (splats !== null) this.arrived(splats);
      },
      () => undefined, // an event has reported it
    );
  }

  protected override put(splats: Splats): void {
    const began = performance.now();
    this.use(splats);
    this.statistics.upload.add(performance.now() - began);
    if (this.held !== null) this.discard(this.held);
    this.held = splats;
  }

  protected override discard(splats: Splats): void {
    this.stream.recycle(splats.means.buffer);
  }
}
