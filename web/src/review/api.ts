/** Messages between the page and `v3studio serve --review`, as in `pipelines/review/messages.py`. */

import { isVector, type Vector } from "../stream/metadata.ts";

export const VERSION = 1;

/** A metric by frame; null where a frame was not measured. */
export interface MetricCurves {
  readonly title: string;
  readonly unit: string;
  readonly digits: number;
  readonly trained: readonly (number | null)[];
  readonly decoded: readonly (number | null)[];
  readonly by_camera: Readonly<Record<string, readonly (number | null)[]>>;
  /** The values from which an image is good, and from which its loss is visible rather than bad; null: no words. */
  readonly words: readonly [good: number, visible: number] | null;
}

export interface QualityCurves {
  /** The metrics that were measured; the first is plotted. */
  readonly metrics: readonly MetricCurves[];
  readonly bytes: readonly (number | null)[];
  readonly held_out: boolean;
}

export interface ReviewCamera {
  readonly name: string;
  readonly width: number;
  readonly height: number;
  readonly K: readonly (readonly number[])[];
  readonly world_to_camera: readonly (readonly number[])[];
  readonly undistorted: boolean;
}

export interface ReviewData {
  readonly version: number;
  readonly frame_count: number;
  readonly quality: QualityCurves | null;
  readonly cameras: readonly ReviewCamera[];
  readonly background: readonly [number, number, number];
  readonly problems: readonly string[];
}

/** The place from which a mark was made, in world coordinates, and what was compared. */
export interface MarkView {
  readonly eye: Vector;
  readonly target: Vector;
  /** Vertical field of view, degrees. */
  readonly fov: number;
  /** The camera that was looked through; "" for a free view. */
  readonly camera: string;
  /** Position of the line between footage and stream, 0 to 1; null: they were not compared. */
  readonly wipe: number | null;
  /** Whether the camera's whole image was shown, rather than the performer. */
  readonly whole: boolean;
  /** The point that the note is about, in world coordinates; null: the whole image. */
  readonly place: Vector | null;
}

export interface MarkContent {
  readonly note: string;
  readonly author: string;
  /** null: of a version that did not keep it. */
  readonly view: MarkView | null;
}

export interface Mark extends MarkContent {
  readonly frame: number;
}

export interface Change {
  readonly frame: number;
  /** null removes the mark. */
  readonly mark: MarkContent | null;
  /** The frame's mark as it was when the change was begun. */
  readonly replaces: MarkContent | null;
}

/** A mark from the server, without its view if that cannot be shown. */
export function readMark(mark: Mark): Mark {
  const { eye, target, fov, place } = mark.view ?? {};
  const apart = isVector(eye) && isVector(target) && eye.some((value, k) => value !== target[k]);
  const fits = apart && fov !== undefined && fov > 0 && fov < 180 && (place === null || isVector(place));
  return fits ? mark : { ...mark, view: null };
}

/** A refused change, with the marks as they are; null if the answer does not say. */
export class Refused extends Error {
  constructor(message: string, readonly marks: readonly Mark[] | null) {
    super(message);
  }
}

export class ReviewServer {
  private tag = "";

  /** @param base - the folder `.review/` beside the stream */
  constructor(private readonly base: URL) {}

  async data(): Promise<ReviewData> {
    const data = (await (await this.get("data.json")).json()) as ReviewData;
    if (data.version !== VERSION) throw new Error("The server is of another version; reload the page.");
    return data;
  }

  async picture(camera: string, frame: number, signal: AbortSignal): Promise<ImageBitmap> {
    const answer = await this.get(`frames/${encodeURIComponent(camera)}/${frame}.jpg`, { signal });
    return createImageBitmap(await answer.blob());
  }

  /** All marks; null if they are as they were at the last call. */
  async marks(): Promise<readonly Mark[] | null> {
    const answer = await this.get("marks", { headers: this.tag === "" ? {} : { "If-None-Match": this.tag }, cache: "no-store" });
    if (answer.status === 304) return null;
    this.tag = answer.headers.get("etag") ?? "";
    return ((await answer.json()) as { marks: Mark[] }).marks.map(readMark);
  }

  /** Adds, changes or removes a mark, and returns all marks. Refused: the server did not accept it. */
  async change(change: Change): Promise<readonly Mark[]> {
    const answer = await this.ask("marks", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(change),
    });
    const kind = answer.headers.get("content-type") ?? "";
    if (!kind.startsWith("application/json")) throw new Refused(`The server answers ${answer.status}.`, null);
    const { problem, ...found } = (await answer.json()) as { marks: Mark[] | null; problem: string | null };
    const marks = found.marks === null ? null : found.marks.map(readMark);
    if (!answer.ok || marks === null) throw new Refused(problem ?? `The server answers ${answer.status}.`, marks);
    this.tag = answer.headers.get("etag") ?? "";
    return marks;
  }

  private async get(path: string, options: RequestInit = {}): Promise<Response> {
    const answer = await this.ask(path, options);
    if (!answer.ok && answer.status !== 304) throw new Error(`The server answers ${answer.status}.`);
    return answer;
  }

  private async ask(path: string, options: RequestInit): Promise<Response> {
    try {
      return await fetch(new URL(path, this.base), options);
    } catch (error) {
      if (options.signal?.aborted === true) throw error;
      // The browser's own words, such as "Failed to fetch", help nobody.
      throw new Error("The server cannot be reached; check the connection.", { cause: error });
    }
  }
}
