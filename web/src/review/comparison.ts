/** The controls of the comparison with footage, and views of marks: free ones and those that compare. */

import type { Vector } from "../stream/metadata.ts";
import { depthAxis, dot, pinholeOf } from "../render/camera.ts";
import type { Player } from "../player/player.ts";
import type { V3PlayerElement } from "../ui/element.ts";
import type { MarkView, ReviewCamera, ReviewData, ReviewServer } from "./api.ts";
import { make } from "../ui/dom.ts";
import { cameraOf, whole } from "./framing.ts";
import { WORDS } from "./language.ts";
import type { Plots } from "./plots.ts";
import { Wipe } from "./wipe.ts";

export class Comparison {
  /** Begins and ends it. */
  readonly button = make("button", { type: "button", "aria-pressed": "false", title: `${WORDS.compareWith} (W)` }, WORDS.compareWith);
  /** The choice of what is compared; hidden while nothing is. */
  readonly choices: HTMLElement;
  private readonly wipe: Wipe;
  private readonly select = make("select", { "aria-label": WORDS.camera });
  private readonly all = make("input", { type: "checkbox" });
  private readonly cameras: readonly ReviewCamera[];

  constructor(
    private readonly element: V3PlayerElement,
    private readonly player: Player,
    server: ReviewServer,
    data: ReviewData,
    private readonly plots: Plots,
  ) {
    this.cameras = data.cameras;
    this.select.append(...data.cameras.map(({ name }) => make("option", { value: name }, name)));
    this.choices = make("span", { class: "row", hidden: "" }, this.select, make("label", {}, this.all, ` ${WORDS.whole}`));
    this.button.hidden = data.cameras.length === 0;
    this.wipe = new Wipe(player, server, data.background, () => this.end());
    this.button.addEventListener("click", () => this.toggle());
    for (const control of [this.select, this.all])
      control.addEventListener("change", () => this.begin(this.select.value));
  }

  /** The camera that is compared with; null for none. */
  get camera(): ReviewCamera | null {
    return this.wipe.camera;
  }

  toggle(): void {
    if (this.camera !== null) this.end();
    else if (this.cameras.length > 0) this.begin(this.nearest());
  }

  /** Compares with a camera; one that cannot be compared with ends the comparison. */
  begin(name: string): void {
    this.show(this.cameras.find((camera) => camera.name === name) ?? null);
  }

  end(): void {
    if (this.camera !== null) this.show(null);
  }

  private show(camera: ReviewCamera | null): void {
    if (camera !== null) this.select.value = camera.name;
    this.choices.hidden = camera === null;
    this.button.textContent = camera === null ? WORDS.compareWith : WORDS.endCompare;
    this.button.setAttribute("aria-pressed", String(camera !== null));
    this.wipe.show(camera, this.all.checked);
    this.plots.compare(camera?.name ?? null);
  }

  /** The camera that looks in the direction of the view, or nearly. */
  private nearest(): string {
    const ahead = (camera: ReviewCamera): Vector => camera.world_to_camera[2].slice(0, 3) as unknown as Vector;
    const [x, y, z] = depthAxis(this.player.camera.pinhole(100, 100));
    const along = (camera: ReviewCamera): number => dot(ahead(camera), [x, y, z]);
    return this.cameras.reduce((best, camera) => (along(camera) > along(best) ? camera : best)).name;
  }

  /** The view on the screen, for a mark. */
  get view(): MarkView {
    const { camera, player } = this;
    const orbit = player.camera;
    const view = camera === null ? orbit.view : orbit.viewOf(pinholeOf(cameraOf(camera, whole(camera))));
    const { clientWidth, clientHeight } = player.canvas;
    return {
      eye: orbit.eyeOf(view),
      target: view.target,
      fov: orbit.fieldOfView((clientWidth || 1) / (clientHeight || 1)),
      camera: camera?.name ?? "",
      wipe: camera === null ? null : this.wipe.at,
      whole: this.all.checked,
      place: null,
    };
  }

  /** Shows what a mark was made of. A camera that is not served here is replaced by the view from its place. */
  go({ eye, target, camera, wipe, whole: all }: MarkView): void {
    if (this.cameras.some(({ name }) => name === camera)) {
      this.all.checked = all;
      this.begin(camera);
      // Without a comparison, only the stream.
      this.wipe.place(wipe ?? 0);
      return;
    }
    this.end();
    this.element.setView(this.player.camera.viewFrom(eye, target));
  }
}
