/** The entry point of the worker. */

import { messageOf } from "../stream/errors.ts";
import type { FromWorker, Report, ToWorker } from "./messages.ts";
import { Session } from "./session.ts";

/** The used part of DedicatedWorkerGlobalScope, which the DOM types do not include. */
interface Scope {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
}

const scope = self as unknown as Scope;
const report: Report = (type, value, transfer) => scope.postMessage({ type, value } as FromWorker, transfer);
let session: Session | null = null;

scope.onmessage = ({ data }) => {
  if (data.type !== "open") {
    session?.receive(data);
    return;
  }
  session?.close();
  const opened = (session = new Session(report, data));
  opened.open().catch((error: unknown) => {
    if (session === opened) report("failed", messageOf(error));
  });
};
