/** Notes of the author that are published with a stream: each is about a frame, seen from a view, and may point at a place. */

import type { Player } from "../player/player.ts";
import { isVector, type Vector } from "../stream/metadata.ts";
import type { Controls } from "./controls.ts";
import { textAt } from "./dom.ts";
import { Pins } from "./pins.ts";
import type { Words } from "./words.ts";

interface Note {
  readonly frame: number;
  readonly note: string;
  readonly view: { readonly eye: Vector; readonly target: Vector; readonly place?: Vector | null };
}

function isNote(value: unknown): value is Note {
  const { frame, note, view } = (value ?? {}) as Record<string, unknown>;
  const { eye, target, place } = (view ?? {}) as Record<string, unknown>;
  return Number.isInteger(frame) && typeof note === "string" && isVector(eye) && isVector(target) && (!place || isVector(place));
}

/** Shows the notes at `place`, an address or `#ID` of an element: marks on the timeline, and *Next*, which goes to them in turn. */
export async function addNotes(place: string, root: ShadowRoot, player: Player, controls: Controls, words: Words): Promise<void> {
  const notes = (JSON.parse(await textAt(place)) as unknown[]).filter(isNote).sort((a, b) => a.frame - b.frame);
  if (notes.length === 0) return;
  const caption = root.querySelector<HTMLElement>(".caption")!;
  const [count, text] = caption.querySelectorAll("span");
  let at = -1;
  const show = (): void => {
    const here = at >= 0 && notes[at].frame === player.frame;
    text.textContent = here ? notes[at].note : "";
    count.textContent = here ? words.of(String(at + 1), String(notes.length)) : words.notes(notes.length);
  };
  caption.querySelector("[data-act='note']")!.addEventListener("click", () => {
    at = (at + 1) % notes.length;
    const { frame, view } = notes[at];
    controls.host.pause();
    controls.timeline.seek(frame);
    controls.motion.flyTo(player.camera.viewFrom(view.eye, view.target));
  }, { signal: player.stop.signal });
  player.on("frame", show);
  new Pins(player).show(notes);
  controls.timeline.mark(notes.map(({ frame }) => frame));
  show();
  caption.hidden = false;
}
