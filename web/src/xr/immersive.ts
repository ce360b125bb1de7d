/** A WebXR session: VR (the stream stands on the floor) or AR (it is placed on a surface). Both eyes are rendered into an
 * XRWebGLLayer. One sort, from the center of the head, serves both. */

import type { DrawnView, Renderer } from "../render/renderer.ts";
import type { Player } from "../player/player.ts";
import { Resolution } from "../player/resolution.ts";
import { StreamError } from "../stream/errors.ts";
import { footing, Placement } from "./placement.ts";

export type Immersion = "vr" | "ar";

const MODES = { vr: "immersive-vr", ar: "immersive-ar" } as const;
const RATE = 72; // assumed where the session does not say
/** Per second at full deflection of a stick: radians, and doublings. */
const TURN_RATE = 1.5;
const ZOOM_RATE = 1;
const REST = 0.15; // deflection below which a stick is at rest
/** Indices in `gamepad.axes` and `gamepad.buttons` of the mapping xr-standard. */
const STICK = [2, 3] as const;
const FIRST_BUTTON = 4;

/** Older browsers lack it on all pages, others on insecure ones, whatever the types promise. */
const system = (): XRSystem | undefined => (navigator as Partial<Navigator>).xr;

/** Whether the device has such sessions. */
export async function hasImmersion(kind: Immersion): Promise<boolean> {
  return (await system()?.isSessionSupported(MODES[kind]).catch(() => false)) === true;
}

/** A point of the two that pinch and turn: fingers on the screen, or hands and controllers in the room. */
type Point = readonly [number, number];

export class Immersive {
  /** Starts a session. Call it from a click: browsers start sessions only then. `hint`: for the viewer, in AR on top of the camera's image. */
  static async start(
    kind: Immersion, player: Player, overlay: HTMLElement, hint: (placed: boolean) => void, ended: () => void,
  ): Promise<Immersive> {
    const session = await system()!.requestSession(MODES[kind], {
      requiredFeatures: [kind === "ar" ? "hit-test" : "local-floor"],
      optionalFeatures: ["local-floor", "hand-tracking", ...(kind === "ar" ? ["dom-overlay"] : [])],
      domOverlay: { root: overlay },
    });
    let space: XRReferenceSpace;
    try {
      space = await session.requestReferenceSpace("local-floor").catch(() => session.requestReferenceSpace("local"));
      const canvas = document.createElement("canvas");
      const renderer = player.screen.renderer.forSession(canvas);
      const layer = new XRWebGLLayer(session, renderer.gl, { antialias: false, depth: false, stencil: false });
      await session.updateRenderState({ baseLayer: layer });
      const viewer = kind === "ar" ? await session.requestReferenceSpace("viewer") : null;
      const hits = viewer === null ? null : await session.requestHitTestSource?.({ space: viewer });
      return new Immersive(kind, session, space, layer, renderer, hits ?? null, player, overlay, hint, ended);
    } catch (error) {
      await session.end();
      throw error;
    }
  }

  readonly placement: Placement;
  /** Fraction of the layer's resolution that is drawn. */
  readonly resolution = new Resolution();
  /** The eyes' cameras of the last frame and their places in the layer, for tests. */
  views: readonly DrawnView[] = [];
  private readonly stop = new AbortController();
  /** Whether it stands where it is; if not, it follows the surface that the viewer looks at, or waits for a first pose. */
  private placed = false;
  private seen = false;
  private last: number | null = null;
  private pinch: readonly [Point, Point] | null = null;
  /** Whether the touches or selections in progress were a pinch, and must not place anything when they end. */
  private pinched = false;
  private readonly touches = new Map<number, Point>();
  private readonly selecting = new Set<XRInputSource>();
  private pressed = false;

  private constructor(
    private readonly kind: Immersion,
    private readonly session: XRSession,
    private readonly space: XRReferenceSpace,
    private readonly layer: XRWebGLLayer,
    private readonly renderer: Renderer,
    private readonly hits: XRHitTestSource | null,
    private readonly player: Player,
    overlay: HTMLElement,
    private readonly hint: (placed: boolean) => void,
    ended: () => void,
  ) {
    const { info } = player;
    if (info === null) throw new StreamError("The stream is not open yet.");
    this.placement = new Placement(footing(info.box, player.camera.up, player.camera.ahead), kind === "ar");
    this.resolution.budget = 1000 / (session.frameRate ?? RATE);
    const { showsSet } = player;
    if (kind === "ar") player.showsSet = false;
    session.addEventListener("end", () => {
      this.stop.abort();
      hits?.cancel();
      player.showsSet = showsSet;
      player.leaveImmersion();
      ended();
    });
    session.addEventListener("select", () => this.selected());
    session.addEventListener("selectstart", ({ inputSource }) => {
      this.restartPinch();
      this.selecting.add(inputSource);
    });
    session.addEventListener("selectend", ({ inputSource }) => {
      this.selecting.delete(inputSource);
      this.pinch = null;
    });
    this.listenToTouches(overlay);
    player.enterImmersion(renderer);
    if (kind === "ar") hint(false);
    session.requestAnimationFrame(this.frame);
  }

  end(): void {
    void this.session.end();
  }

  private selected(): void {
    if (this.kind !== "ar" || !this.seen || this.pinched) return;
    this.placed = !this.placed;
    this.hint(this.placed);
  }

  /** Another finger or hand: what came before must not be compared with what follows. */
  private restartPinch(): void {
    if (this.selecting.size + this.touches.size === 0) this.pinched = false;
    this.pinch = null;
  }

  /** Two fingers on a phone's screen; taps on buttons must not place anything. */
  private listenToTouches(overlay: HTMLElement): void {
    const { signal } = this.stop;
    const at = (event: PointerEvent): Point => [event.clientX, event.clientY];
    overlay.addEventListener("pointerdown", (event) => {
      this.restartPinch();
      this.touches.set(event.pointerId, at(event));
    }, { signal });
    overlay.addEventListener("pointermove", (event) => {
      if (this.touches.has(event.pointerId)) this.touches.set(event.pointerId, at(event));
    }, { signal });
    for (const kind of ["pointerup", "pointercancel"] as const)
      overlay.addEventListener(kind, (event) => {
        this.touches.delete(event.pointerId);
        this.pinch = null;
      }, { signal });
    overlay.addEventListener("beforexrselect", (event) => {
      const onButton = event.composedPath().some((element) => element instanceof HTMLButtonElement);
      if (onButton) event.preventDefault();
    }, { signal });
  }

  private readonly frame = (now: number, frame: XRFrame): void => {
    const { session, layer, player, placement } = this;
    session.requestAnimationFrame(this.frame);
    const elapsed = this.last === null ? 0 : now - this.last;
    this.last = now;
    const pose = frame.getViewerPose(this.space);
    if (pose === undefined) return;
    if (this.kind === "vr" && !this.placed) {
      placement.faceViewer(pose.transform.matrix);
      this.placed = this.seen = true;
    }
    this.lookAtSurface(frame, pose);
    this.pinchAndTurn(frame);
    this.readGamepads(Math.min(elapsed, 100) / 1000);
    const views = pose.views.flatMap((view) => {
      const viewport = layer.getViewport(view);
      if (viewport === undefined || viewport.width === 0) return [];
      const scale = this.resolution.scale(viewport.width, viewport.height);
      const [width, height] = [viewport.width, viewport.height].map((size) => Math.max(1, Math.round(size * scale)));
      return [{ pinhole: placement.pinhole(view.transform.inverse.matrix, view.projectionMatrix, width, height), viewport }];
    });
    if (views.length === 0) return;
    const head = placement.pinhole(pose.transform.inverse.matrix, pose.views[0].projectionMatrix, 2, 2);
    player.advanceImmersion(now, head);
    this.views = views;
    const background = this.kind === "vr" ? (player.background ?? ([0, 0, 0] as const)) : null;
    if (this.seen) this.renderer.drawViews(views, layer.framebuffer, background);
    if (elapsed > 0) this.resolution.measured(elapsed);
  };

  /** Puts the stream where the viewer looks, in AR until it is placed. */
  private lookAtSurface(frame: XRFrame, pose: XRViewerPose): void {
    if (this.hits === null || this.placed) return;
    const hit = frame.getHitTestResults(this.hits).at(0)?.getPose(this.space);
    if (hit === undefined) return;
    const { x, y, z } = hit.transform.position;
    this.placement.turnTo([x, y, z], pose.transform.matrix);
    this.seen = true;
  }

  /** Two fingers, or two hands or controllers while both select, scale and turn it. */
  private pinchAndTurn(frame: XRFrame): void {
    const points = this.touches.size > 0 ? [...this.touches.values()] : this.hands(frame);
    const now = points.length === 2 ? ([points[0], points[1]] as const) : null;
    if (this.pinch !== null && now !== null) {
      const [before, after] = [this.pinch, now].map(([a, b]) => [b[0] - a[0], b[1] - a[1]]);
      const [size, newSize] = [Math.hypot(...before), Math.hypot(...after)];
      if (size > 0 && newSize > 0) {
        this.placement.zoom(newSize / size);
        // Angles grow clockwise seen from above: on the screen, and in the plane of the room's x and z.
        this.placement.turn += Math.atan2(before[1], before[0]) - Math.atan2(after[1], after[0]);
      }
    }
    this.pinch = now;
    this.pinched ||= now !== null;
  }

  private hands(frame: XRFrame): Point[] {
    return [...this.selecting].flatMap((source) => {
      const position = frame.getPose(source.gripSpace ?? source.targetRaySpace, this.space)?.transform.position;
      return position === undefined ? [] : [[position.x, position.z] as const];
    });
  }

  /** Sticks turn and scale; the first button plays and pauses. */
  private readGamepads(seconds: number): void {
    let pressed = false;
    for (const { gamepad } of this.session.inputSources) {
      if (gamepad === undefined) continue;
      const [x, y] = STICK.map((axis) => gamepad.axes[axis] ?? 0).map((value) => (Math.abs(value) < REST ? 0 : value));
      this.placement.turn += TURN_RATE * x * seconds;
      this.placement.zoom(2 ** (-ZOOM_RATE * y * seconds));
      pressed ||= gamepad.buttons.at(FIRST_BUTTON)?.pressed === true;
    }
    if (pressed && !this.pressed) {
      if (this.player.playing) this.player.pause();
      else this.player.play();
    }
    this.pressed = pressed;
  }
}
