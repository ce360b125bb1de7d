/** An error whose message is a sentence for the viewer. */
export class StreamError extends Error {
  override readonly name = "StreamError";

  /** @param transient - whether retrying may help: the network failed, not the data */
  constructor(message: string, readonly transient = false) {
    super(message);
  }
}

/** The message of any thrown value. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
