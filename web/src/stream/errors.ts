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

/** The message of any thrown value. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
