/** An error whose message is a sentence for the viewer. */
export class StreamError extends Error {
  override readonly name = "StreamError";
  /** Whether retrying may help: the network failed, not the data. */
  readonly transient: boolean;

  constructor(message: string, transient = false) {
    super(message);
    this.transient = transient;
  }
}

/** The message of any thrown value. */
export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
