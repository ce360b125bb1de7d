/** An error whose message is a sentence for the viewer. */
export class StreamError extends Error {
  override readonly name = "StreamError";

  /** @param transient - whether retrying may help: the network failed, not the data */
  constructor(message: string, readonly transient = false) {
    super(message);
  }
}

/** Another bake has taken the stream's place. */
export class Rebaked extends StreamError {
  constructor() {
    super("This take was updated.");
  }
}

/** A promise of the same result, which fails if it takes longer. */
export function inTime<T>(work: Promise<T>, milliseconds: number, late: () => Error): Promise<T> {
  let timer: ReturnType<typeof setTimeout> | undefined;
  const never = new Promise<never>((_, reject) => {
    timer = setTimeout(() => reject(late()), milliseconds);
  });
  return Promise.race([work, never]).finally(() => clearTimeout(timer));
}

/** The message of any thrown value. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
