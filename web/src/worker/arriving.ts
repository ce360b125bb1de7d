/** A file while it arrives: its beginning can be used before the rest is there. */

interface Waiting {
  readonly count: number;
  readonly resolve: (data: Uint8Array<ArrayBuffer>) => void;
  readonly reject: (error: unknown) => void;
}

export class Arriving {
  private data: Uint8Array<ArrayBuffer> = new Uint8Array(0);
  private filled = 0;
  /** Whether all of it is there, and verified. */
  complete = false;
  /** Why it will not arrive. */
  failure: Error | null = null;
  private waiting: Waiting[] = [];

  /** @param bytes - its size */
  constructor(readonly bytes: number) {}

  /** The first `filled` bytes of `data` have arrived. */
  readonly arrived = (data: Uint8Array<ArrayBuffer>, filled: number): void => {
    this.data = data;
    this.filled = filled;
    this.answer();
  };

  /** All of it has arrived and is verified. */
  finish(data: Uint8Array<ArrayBuffer>): void {
    this.complete = true;
    this.arrived(data, data.length);
  }

  /** It will not arrive, or is not what it should be. */
  fail(error: Error): void {
    if (this.complete) return;
    this.failure = error;
    for (const { reject } of this.waiting) reject(error);
    this.waiting = [];
  }

  /** At least its first `count` bytes, which are verified only if they are all of it. */
  prefix(count: number): Promise<Uint8Array<ArrayBuffer>> {
    if (this.failure !== null) return Promise.reject(this.failure);
    return new Promise((resolve, reject) => {
      this.waiting.push({ count, resolve, reject });
      this.answer();
    });
  }

  /** All of it, verified. */
  whole(): Promise<Uint8Array<ArrayBuffer>> {
    return this.prefix(Infinity);
  }

  private answer(): void {
    const ready = ({ count }: Waiting): boolean => this.complete || (count <= this.filled && count < this.bytes);
    const answered = this.waiting.filter(ready);
    this.waiting = this.waiting.filter((one) => !ready(one));
    for (const { resolve } of answered) resolve(this.data);
  }
}
