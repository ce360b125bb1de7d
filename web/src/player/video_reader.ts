/** Reads luma from <video> elements on the page; the worker requests images by time. texImage2D returns the luma of
 * full-range H.264 with neutral chroma exactly; four values are packed into each pixel that is read back. */

import { contextOf, Program, resize } from "../render/gl.ts";
import { FULL_VERTEX } from "../render/shaders.ts";
import { inTime, messageOf, StreamError } from "../stream/errors.ts";
import type { Video, VideoTime } from "../worker/messages.ts";

const PATIENCE = 20_000; // milliseconds to wait for an image
/** Milliseconds to wait if the browser may not report presented images: on hidden pages, or if it does not support that. */
const UNREPORTED = 2_000;

const FRAGMENT = `#version 300 es
precision highp float; precision highp sampler2D;
uniform sampler2D video;
out vec4 four;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy) * ivec2(4, 1);
  four = vec4(texelFetch(video, at, 0).r, texelFetch(video, at + ivec2(1, 0), 0).r,
              texelFetch(video, at + ivec2(2, 0), 0).r, texelFetch(video, at + ivec2(3, 0), 0).r);
}`;

export class VideoReader {
  private readonly players = new Set<VideoPlayer>();
  private gl: WebGL2RenderingContext | null = null;

  /** Answers what comes through the video's port. */
  open(video: Video): void {
    const player = new VideoPlayer(video);
    const { port } = video;
    this.players.add(player);
    port.onmessage = ({ data }: MessageEvent<VideoTime | null>) => {
      if (data === null) {
        this.players.delete(player);
        player.close();
        return;
      }
      player.reach(data).then(() => this.readBack(player.element, video)).then(
        (luma) => port.postMessage(luma, [luma]),
        (error: unknown) => port.postMessage(messageOf(error)),
      );
    };
  }

  dispose(): void {
    for (const player of this.players) player.close();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }

  private readBack(element: HTMLVideoElement, { width, height }: Video): ArrayBuffer {
    const gl = (this.gl ??= this.makeContext());
    resize(gl.canvas, width / 4, height);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, element);
    gl.viewport(0, 0, width / 4, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const luma = new Uint8Array(width * height);
    gl.readPixels(0, 0, width / 4, height, gl.RGBA, gl.UNSIGNED_BYTE, luma);
    return luma.buffer;
  }

  private makeContext(): WebGL2RenderingContext {
    const gl = contextOf(document.createElement("canvas"), { antialias: false, depth: false });
    new Program(gl, FULL_VERTEX, FRAGMENT).use();
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.disable(gl.BLEND);
    return gl;
  }
}

/** A <video> element, and which image it shows. "seeked" is not enough: on a busy machine it fires while the element still
 * shows the image from before the seek. */
class VideoPlayer {
  readonly element = document.createElement("video");
  private readonly address: string;
  private readonly opened: Promise<void>;
  private readonly reports = "requestVideoFrameCallback" in this.element;
  /** Presentation time of the image in seconds; null before the first. */
  private mediaTime: number | null = null;
  private changed: (() => void) | null = null;

  constructor(private readonly video: Video) {
    const { element } = this;
    element.muted = true;
    element.playsInline = true;
    element.preload = "auto";
    this.address = element.src = URL.createObjectURL(video.file);
    if (this.reports) this.listen();
    this.opened = this.open();
    this.opened.catch(() => undefined);
  }

  close(): void {
    this.video.port.close();
    this.element.removeAttribute("src");
    this.element.load();
    URL.revokeObjectURL(this.address);
  }

  private async open(): Promise<void> {
    const { element, video } = this;
    await happened(element, "loadeddata");
    if (element.videoWidth !== video.width || element.videoHeight !== video.height)
      throw new StreamError(
        `The video is ${element.videoWidth}x${element.videoHeight} here, but the manifest specifies ${video.width}x${video.height}.`,
      );
  }

  /** Waits for an image. */
  async reach({ time, duration }: VideoTime): Promise<void> {
    const { element } = this;
    await this.opened;
    if (Math.abs(element.currentTime - time) > 1e-4) {
      const seeked = happened(element, "seeked");
      element.currentTime = time;
      await seeked;
    }
    if (!this.reports) return;
    const there = (): boolean =>
      this.mediaTime !== null && Math.abs(this.mediaTime + duration / 2 - time) < duration / 2;
    if (there()) return;
    const reported = this.mediaTime !== null && !document.hidden;
    const arrival = new Promise<void>((resolve) => {
      this.changed = (): void => {
        if (there()) resolve();
      };
    });
    try {
      await inTime(arrival, reported ? PATIENCE : UNREPORTED, noPicture);
    } catch (error) {
      if (reported && !document.hidden) throw error;
    } finally {
      this.changed = null;
    }
  }

  private listen(): void {
    this.element.requestVideoFrameCallback((_now, { mediaTime }) => {
      this.mediaTime = mediaTime;
      this.listen();
      this.changed?.();
    });
  }
}

const noPicture = (): StreamError => new StreamError("The browser's video element does not deliver a picture.");

/** Resolves on the event; rejects on an error or a timeout. */
async function happened(element: HTMLVideoElement, event: "loadeddata" | "seeked"): Promise<void> {
  const stop = new AbortController();
  const done = new Promise<void>((resolve, reject) => {
    element.addEventListener(event, () => resolve(), { signal: stop.signal });
    element.addEventListener("error", () => {
      reject(new StreamError(`This browser cannot play the video (${element.error?.message ?? "unknown reason"}).`));
    }, { signal: stop.signal });
  });
  await inTime(done, PATIENCE, noPicture).finally(() => stop.abort());
}
