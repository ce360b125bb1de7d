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
  switch (data.type) {
    case "open": {
      session?.close();
      const opened = (session = new Session(post, channel, data.path, data.maxTexture, data.loop));
      opened.open(data.url, data.files, data.archive, data.early).catch((error: unknown) => {
        if (session === opened) post({ type: "failed", message: messageOf(error) });
      });
      break;
    }
    case "present":
      session?.present(data.frame, data.axis, data.seek);
      break;
    case "sort":
      session?.sort(data.request, data.frame, data.axis);
      break;
    case "loop":
      session?.setLoop(data.loop);
      break;
    case "playing":
      session?.setPlaying(data.playing);
      break;
    case "played":
      session?.played(data.group, data.shown, data.dropped);
      break;
    case "recycle":
      session?.recycle(data.buffers);
      break;
    case "retry":
      session?.retry();
      break;
    case "forget-setup":
      session?.forgetSetup();
      break;
    case "video-frame":
    case "video-error":
      channel.receive(data);
      break;
  }
};
