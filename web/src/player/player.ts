/** The player without controls: plays sorted images from the stream's worker with a renderer. The main thread only uploads
 * and draws. */

import { centerOf, depthAxis, OrbitCamera, type PartialView, type Pinhole, pinholeOf, type View, visibility } from "../render/camera.ts";
import { Renderer } from "../render/renderer.ts";
import { messageOf } from "../stream/errors.ts";
import type { Rendition } from "../stream/manifest.ts";
import type { Camera, Vector } from "../stream/metadata.ts";
import type { DepthAxis, GroupSetup, Picture, StreamEvents, StreamInfo, StreamSource } from "../worker/messages.ts";
import { Playback } from "./playback.ts";
import { Screen } from "./screen.ts";
import type { StreamOptions } from "./stream.ts";

const SORT_AGAIN = 1e-3; // relative change of the view that triggers another sort
const UNSORTED: DepthAxis = [0, 0, 0, 0]; // no view has this axis: the next view is sorted for

export class Player extends Playback<Picture> {
  readonly camera = new OrbitCamera();
  /** The group of the frame on the canvas, in the rendition that was chosen for it. */
  group: Rendition | null = null;
  readonly screen: Screen;
  /** Whether a link to a moment was opened: who opens it wants to see it, rather than a large button. */
  isMoment = false;
  private hidden_ = false;
  drawn = 0; // number of splats on the canvas
  private requestedAxis: DepthAxis = UNSORTED; // axis along which the last requested frame is sorted
  /** Axis along which the frame on the canvas was sorted, or is being sorted. */
  private sortedAxis: DepthAxis = UNSORTED;
  private sorting = false;
  private behind: StreamEvents["set"] | null = null;
  private showsSet_ = true;
  /** Setups that came with images that have not been shown yet: one or two. */
  private readonly setups = new Map<number, GroupSetup>();
  /** Whether the renderer is new, or its contents were lost, and images are of no use before their group's setup has come. */
  private needsSetup = false;
  private outside: Renderer | null = null; // the renderer of the page while an immersive session has its own
  private head: Pinhole | null = null; // the center of the viewer's head in an immersive session
  /** The next animation frame's handle; 0 before the first image, until which nothing is due. */
  private handle = 0;
  private handlerTime = 0;

  /** @throws StreamError - the browser cannot render */
  constructor(readonly canvas: HTMLCanvasElement, options: StreamOptions = {}) {
    super(options);
    try {
      const rendered = (): void => this.emit("rendered", { frame: this.frame });
      this.screen = new Screen(new Renderer(canvas), canvas, this.camera, this.statistics, rendered, (view) => this.emit("view", view));
    } catch (error) {
      super.dispose();
      throw error;
    }
    const timed = <T>(handle: (value: T) => void): ((value: T) => void) => (value) => {
      const began = performance.now();
      handle(value);
      this.handlerTime += performance.now() - began;
    };
    this.stream.maxTexture = this.screen.renderer.maxTexture;
    this.stream.on("picture", timed((picture) => this.received(picture)));
    this.stream.on("order", timed((order) => this.sorted(order)));
    this.stream.on("set", (set) => {
      this.behind = set;
      this.screen.renderer.setSet(set);
      this.sortedAxis = UNSORTED;
    });
    canvas.addEventListener("webglcontextrestored", () => this.restore(), { signal: this.stop.signal });
  }

  /** Draws no more to the page: an immersive session draws, with its own renderer, and advances the clock. */
  enterImmersion(renderer: Renderer): void {
    cancelAnimationFrame(this.handle);
    this.outside = this.screen.renderer;
    this.change(renderer);
  }

  /** Advances the clock to `now`, and sorts for the center of the head; the session draws. */
  advanceImmersion(now: number, head: Pinhole): void {
    this.head = head;
    this.advance(now);
    this.follow();
  }

  /** Draws to the page again. */
  leaveImmersion(): void {
    this.head = null;
    this.screen.renderer.dispose();
    const renderer = this.outside;
    this.outside = null;
    if (renderer === null || this.stop.signal.aborted) return;
    this.change(renderer);
    this.run();
  }

  /** Whether nobody can see the canvas: nothing is drawn, and the clock stands still. */
  set hidden(hidden: boolean) {
    if (hidden === this.hidden_) return;
    this.hidden_ = hidden;
    if (this.outside !== null) return;
    this.skipTime();
    cancelAnimationFrame(this.handle);
    this.run();
  }

  private run(): void {
    this.screen.dirty = true;
    if (this.shown !== null && !this.hidden_) this.handle = requestAnimationFrame(this.tick);
  }

  /** The image on the canvas, as an address; null if there is none. */
  snapshot(): string | null {
    if (this.shown === null || this.outside !== null) return null;
    this.screen.render(performance.now());
    return this.canvas.toDataURL("image/jpeg", 0.8);
  }

  /** Uses another renderer, to which everything must be sent again. */
  private change(renderer: Renderer): void {
    this.screen.renderer = renderer;
    this.skipTime();
    if (this.info === null) return;
    renderer.prepare(this.info.shDegree);
    this.restore();
  }

  override open(source: StreamSource): Promise<StreamInfo> {
    this.group = this.behind = null;
    this.drawn = 0;
    const opened = super.open(source);
    this.stream.request({ type: "set", shown: this.showsSet_ });
    return opened;
  }

  get background(): Vector | null {
    return this.screen.background;
  }

  /** RGB, 0 to 1; null for a transparent background. */
  set background(color: Vector | null) {
    this.screen.background = color;
    this.screen.dirty = true;
  }

  get showsSet(): boolean {
    return this.showsSet_;
  }

  /** Whether the splats behind the performer are shown, if the stream has any. */
  set showsSet(shown: boolean) {
    if (shown === this.showsSet_) return;
    this.showsSet_ = shown;
    this.stream.request({ type: "set", shown });
    this.sortedAxis = UNSORTED;
  }

  get view(): View {
    return this.camera.view;
  }

  /** How much of the image to show from this view, 0 to 1: below 1, no camera filmed from near here. */
  get visibility(): number {
    const range = this.info?.viewRange ?? null;
    return range === null ? 1 : visibility(range, centerOf(this.screen.pinhole()));
  }

  set view(view: PartialView) {
    this.camera.view = { ...this.camera.view, ...view };
    this.fixedCamera = null;
  }

  /** Looks through the given camera, whose image fills the canvas; null returns to the orbit camera. */
  set fixedCamera(camera: Camera | null) {
    this.screen.fixed = camera === null ? null : pinholeOf(camera);
    this.screen.dirty = true;
  }

  override dispose(): void {
    cancelAnimationFrame(this.handle);
    super.dispose();
    this.screen.dispose();
  }

  protected override skipTime(): void {
    super.skipTime();
    this.screen.forget();
  }

  protected override opened(info: StreamInfo): void {
    this.camera.frame(info.box, info.camera, info.up);
    if (info.background !== null) this.screen.background = info.background;
    this.screen.resolution.budget = 1000 / Math.min(60, Math.max(30, info.fps));
    this.screen.dirty = true;
    super.opened(info);
    // The driver compiles while the first image is fetched and decoded.
    this.screen.renderer.prepare(info.shDegree);
  }

  protected override ask(frame: number, seek: boolean): void {
    // Sorted for the current camera: at most one frame old when it is drawn.
    this.requestedAxis = depthAxis(this.head ?? this.screen.pinhole());
    this.stream.request({ type: "present", frame, axis: this.requestedAxis, seek });
  }

  private received(picture: Picture): void {
    if (picture.setup !== null) this.setups.set(picture.group, picture.setup);
    // After a change of the renderer, an image for the one before may still arrive.
    if (this.needsSetup && !this.setups.has(picture.group)) {
      this.discard(picture);
      return;
    }
    if (this.requested?.frame === picture.frame) {
      this.needsSetup = false;
      const { decode, dequantize, sort } = picture.timings;
      this.statistics.decode.add(decode);
      this.statistics.dequantize.add(dequantize);
      this.statistics.sort.add(sort);
    }
    this.arrived(picture);
  }

  protected override put(picture: Picture, now: number): void {
    const { renderer } = this.screen;
    const began = performance.now();
    const setup = this.setups.get(picture.group);
    if (setup !== undefined) {
      renderer.setGroup(setup);
      this.statistics.prepare.add(setup.prepare);
      this.group = setup.group;
      this.setups.clear();
    }
    renderer.setPicture(picture);
    this.sortedAxis = this.requestedAxis;
    this.statistics.upload.add(performance.now() - began);
    const first = this.drawn === 0;
    this.drawn = picture.count;
    this.discard(picture);
    this.screen.dirty = true;
    if (first) this.screen.render(now);
    if (this.handle === 0) this.run();
  }

  protected override discard({ luma, order }: Picture): void {
    this.stream.recycle(luma.buffer, order.buffer);
  }

  private sorted({ frame, order, count, sort }: StreamEvents["order"]): void {
    this.sorting = false;
    if (frame === this.shown?.frame) {
      this.screen.renderer.setOrder(order, count);
      this.drawn = count;
      this.statistics.sort.add(sort);
      this.screen.dirty = true;
    }
    this.stream.recycle(order.buffer);
  }

  private readonly tick = (now: number): void => {
    this.handle = requestAnimationFrame(this.tick);
    const began = performance.now();
    try {
      this.advance(now);
      this.follow();
      if (this.shown !== null) this.screen.update(now, !this.playing && this.requested === null);
    } catch (error) {
      this.fail(messageOf(error));
      cancelAnimationFrame(this.handle);
      this.handle = 0;
    }
    if (this.playing) this.statistics.main.add(performance.now() - began + this.handlerTime);
    this.handlerTime = 0;
  };

  /** Requests a new sort of the frame on the canvas if the camera has moved since it was sorted. */
  private follow(): void {
    if (this.sorting || this.shown === null || this.requested?.seek === true) return;
    // While frames follow one another quickly, each comes sorted for a recent view.
    if (this.playing && this.requested !== null) return;
    const axis = depthAxis(this.head ?? this.screen.pinhole());
    const turned = Math.hypot(axis[0] - this.sortedAxis[0], axis[1] - this.sortedAxis[1], axis[2] - this.sortedAxis[2]);
    const moved = Math.abs(axis[3] - this.sortedAxis[3]);
    if (turned < SORT_AGAIN && moved < SORT_AGAIN * this.camera.distance) return;
    this.sortedAxis = axis;
    this.sorting = true;
    this.stream.request({ type: "sort", frame: this.shown.frame, axis });
  }

  /** Called when the graphics context is restored without its contents, and when the renderer has changed. */
  private restore(): void {
    this.needsSetup = true;
    if (this.behind !== null) this.screen.renderer.setSet(this.behind);
    this.stream.request({ type: "forget-setup" });
    this.setups.clear();
    this.requestAgain();
  }
}
