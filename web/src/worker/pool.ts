/** A pool of reusable buffers, so that playback creates no garbage. */

const KEPT = 12;

export class Pool {
  private readonly free: ArrayBuffer[] = [];

  /** A buffer of exactly `bytes` bytes with undefined content. */
  take(bytes: number): Uint8Array<ArrayBuffer> {
    const at = this.free.findIndex((buffer) => buffer.byteLength === bytes);
    const buffer = at < 0 ? new ArrayBuffer(bytes) : this.free.splice(at, 1)[0];
    return new Uint8Array(buffer);
  }

  give(data: Uint8Array<ArrayBuffer> | ArrayBuffer): void {
    const buffer = data instanceof ArrayBuffer ? data : data.buffer;
    if (buffer.byteLength === 0) return;
    this.free.push(buffer);
    if (this.free.length > KEPT) this.free.shift();
  }
}
