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
let closing = new AbortController();
let opening: Promise<Session | null> = Promise.resolve(null);

scope.onmessage = ({ data }) => {
  if (data.type !== "open") {
    opening.then((session) => session?.receive(data)).catch(reportError); // reaches the page's `onerror`
    return;
  }
  closing.abort();
  closing = new AbortController();
  const report: Report = (type, value, transfer) =>
    scope.postMessage({ number: data.number, type, value } as FromWorker, transfer);
  opening = Session.open(report, data, closing.signal).catch((error: unknown) => {
    report("failed", messageOf(error));
    return null;
  });
};
