/** Images of the footage: the frame on the screen first, then the next ones, as many as fit in memory. */

import { messageOf } from "../stream/errors.ts";
import type { ReviewServer } from "./api.ts";

const MAX_BYTES = 128e6;
const AHEAD = 6;
const RETRY = 3000; // milliseconds until an image that could not be fetched is asked for again

export class Pictures {
  private readonly kept = new Map<string, ImageBitmap>();
  private readonly failed = new Map<string, number>();
  private wanted: { camera: string; frame: number; count: number } | null = null;
  private loading: AbortController | null = null;
  /** Why the last image could not be fetched; "" if it could. */
  problem = "";

  constructor(private readonly server: ReviewServer, private readonly arrived: () => void) {}

  /** The image if it is here; it is fetched otherwise. */
  ask(camera: string, frame: number, count: number): ImageBitmap | null {
    this.wanted = { camera, frame, count };
    this.load();
    return this.kept.get(`${camera}/${frame}`) ?? null;
  }

  /** Fetches no more. */
  stop(): void {
    this.wanted = null;
    this.loading?.abort();
  }

  private load(): void {
    if (this.loading !== null || this.wanted === null) return;
    const { camera, frame, count } = this.wanted;
    const now = performance.now();
    for (let step = 0; step <= Math.min(AHEAD, count - 1); step++) {
      const next = (frame + step) % count;
      const key = `${camera}/${next}`;
      if (this.kept.has(key) || now - (this.failed.get(key) ?? -Infinity) < RETRY) continue;
      const control = (this.loading = new AbortController());
      void this.fetch(camera, next, key, control).finally(() => {
        this.loading = null;
        this.arrived();
        this.load();
      });
      return;
    }
  }

  private async fetch(camera: string, frame: number, key: string, control: AbortController): Promise<void> {
    try {
      const picture = await this.server.picture(camera, frame, control.signal);
      this.problem = "";
      this.kept.set(key, picture);
      this.evict(4 * picture.width * picture.height);
    } catch (error) {
      if (control.signal.aborted) return;
      this.failed.set(key, performance.now());
      this.problem = messageOf(error);
    }
  }

  private evict(bytes: number): void {
    for (const [key, picture] of this.kept) {
      if (this.kept.size * bytes <= MAX_BYTES || this.kept.size <= AHEAD + 1) return;
      picture.close();
      this.kept.delete(key);
    }
  }
}
