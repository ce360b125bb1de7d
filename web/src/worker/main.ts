/** The entry point of the worker. */

import { messageOf } from "../stream/errors.ts";
import type { FromWorker, ToWorker } from "./messages.ts";
import { Session } from "./session.ts";
import { VideoChannel } from "./video_pictures.ts";

/** The used part of DedicatedWorkerGlobalScope, which the DOM types do not include. */
interface Scope {
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
}

const scope = self as unknown as Scope;
const post = (message: FromWorker, transfer?: Transferable[]): void => scope.postMessage(message, transfer);
const channel = new VideoChannel(post);
let session: Session | null = null;

scope.onmessage = ({ data }) => {
  if (data.type === "open") {
    session?.close();
    const opened = (session = new Session(post, channel, data));
    opened.open().catch((error: unknown) => {
      if (session === opened) post({ type: "failed", message: messageOf(error) });
    });
  } else if (data.type === "video-frame" || data.type === "video-error") channel.receive(data);
  else session?.receive(data);
};
