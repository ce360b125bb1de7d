/** An error whose message is one sentence for the person who watches. */
export class StreamError extends Error {
  override readonly name = "StreamError";
  /** Whether trying again may help: the network failed, not the data. */
  readonly transient: boolean;

  constructor(message: string, transient = false) {
    super(message);
    this.transient = transient;
  }
}

/** The message of anything that was thrown. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
