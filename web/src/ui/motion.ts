/** Camera control by touch, mouse, trackpad, keyboard and gamepad, with inertia. */

import type { OrbitCamera, PartialView, View } from "../render/camera.ts";
import type { Camera } from "../stream/metadata.ts";

const TURN = 0.42; // degrees per pixel of finger movement, for an image of 500 pixels
const GLIDE = 0.28; // seconds in which inertia decays to about a third
/** Time in milliseconds and distance in pixels within which two taps are a double tap and a touch is a tap. */
const DOUBLE = 320;
const NEAR = 32;
const TAP = 250;
const FLY = 420;
const PRESS = 0.04; // seconds of turning that a short press of a key is worth

/** The part of a player that is moved: its camera, and playback for the gamepad. */
export interface Viewed {
  readonly camera: OrbitCamera;
  get view(): View;
  set view(view: PartialView);
  set fixedCamera(camera: Camera | null);
  readonly playing: boolean;
  readonly stop: AbortController;
  play(): void;
  pause(): void;
}

export interface MotionEvents {
  /** Called on a tap or click without movement, with its place in the window. */
  tap(pointer: string, x: number, y: number): void;
  /** Called when the user touches the image, turns the wheel or uses the gamepad. */
  input(): void;
  /** Called when the user has moved the camera. */
  touched(): void;
}

interface Finger {
  x: number;
  y: number;
}

export class Motion {
  private readonly fingers = new Map<number, Finger>();
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");
  /** `scrolls`: a finger that has not moved sideways yet may come to scroll the page. */
  private began = { x: 0, y: 0, at: 0, moved: false, scrolls: false };
  private lastTap = { x: 0, y: 0, at: -Infinity };
  private velocity = { x: 0, y: 0, at: 0 };
  /** Keys that are held, by their place on the keyboard: what a key means may change before it is released. */
  private readonly keys = new Map<string, string>();
  private flight: { from: View; to: View; began: number } | null = null;
  private handle = 0;
  private last = 0;
  private pressed: readonly boolean[] = [];
  /** Whether the wheel zooms; otherwise it scrolls the page around the player. */
  ownsWheel: () => boolean = () => true;

  constructor(
    private readonly surface: HTMLElement,
    private readonly player: Viewed,
    private readonly events: MotionEvents,
  ) {
    const { signal } = player.stop;
    signal.addEventListener("abort", () => cancelAnimationFrame(this.handle));
    const on = <K extends keyof HTMLElementEventMap>(kind: K, handler: (event: HTMLElementEventMap[K]) => void): void => {
      surface.addEventListener(kind, handler, { signal, passive: false });
    };
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.up(event, true));
    on("pointercancel", (event) => this.up(event, false));
    on("wheel", (event) => this.wheel(event));
    on("contextmenu", (event) => event.preventDefault());
    on("blur", () => this.keys.clear());
    window.addEventListener("gamepadconnected", () => this.run(), { signal });
  }

  /** Goes back to the initial view, with a short animation unless reduced motion is preferred. */
  reset(): void {
    const { camera } = this.player;
    const from = camera.view;
    camera.reset();
    const to = camera.view;
    camera.view = from;
    this.flyTo(to);
  }

  /** Goes to a view in the same way. */
  flyTo(to: View): void {
    const from = this.player.view;
    this.velocity = { x: 0, y: 0, at: 0 };
    if (this.calm.matches) {
      this.player.view = to;
      return;
    }
    // The shorter way around.
    const azimuth = from.azimuth + (((to.azimuth - from.azimuth + 540) % 360) - 180);
    this.flight = { from, to: { ...to, azimuth }, began: performance.now() };
    this.run();
  }

  /** Handles a key that is pressed; true if it moves the camera. */
  press({ key, code }: KeyboardEvent): boolean {
    if (!/^(Arrow(Left|Right|Up|Down)|\+|-|=)$/.test(key)) return false;
    const held = this.keys.has(code);
    this.keys.set(code, key);
    this.flight = null;
    // It may be released before the next image.
    if (!held) this.keysHeld(PRESS);
    this.run();
    return true;
  }

  release({ code }: KeyboardEvent): void {
    this.keys.delete(code);
  }

  shift = false;

  private touched(): void {
    this.flight = null;
    this.player.fixedCamera = null;
    this.events.touched();
  }

  private get height(): number {
    return this.surface.clientHeight || 1;
  }

  private turn(dx: number, dy: number): void {
    const scale = TURN * (500 / Math.max(300, Math.min(this.height, this.surface.clientWidth)));
    this.player.camera.orbit(dx * scale, dy * scale);
    this.touched();
  }

  private pan(dx: number, dy: number): void {
    this.player.camera.pan(dx / this.height, dy / this.height, this.surface.clientWidth / this.height);
    this.touched();
  }

  private zoom(factor: number): void {
    this.player.camera.zoom(factor);
    this.touched();
  }

  private down(event: PointerEvent): void {
    this.events.input();
    // Events dispatched by scripts have no pointer to capture.
    if (event.isTrusted) this.surface.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.velocity = { x: 0, y: 0, at: 0 };
    this.flight = null;
    if (this.fingers.size === 1) {
      const scrolls = event.pointerType === "touch" && getComputedStyle(this.surface).touchAction !== "none";
      this.began = { x: event.clientX, y: event.clientY, at: event.timeStamp, moved: false, scrolls };
    } else {
      this.began.moved = true;
      this.began.scrolls = false;
    }
  }

  private move(event: PointerEvent): void {
    const finger = this.fingers.get(event.pointerId);
    if (finger === undefined) return;
    const [dx, dy] = [event.clientX - finger.x, event.clientY - finger.y];
    const [across, down] = [event.clientX - this.began.x, event.clientY - this.began.y];
    if (Math.hypot(across, down) > 4) this.began.moved = true;
    if (Math.abs(across) > Math.abs(down)) this.began.scrolls = false;
    if (!this.began.moved || this.began.scrolls) return;
    if (this.fingers.size === 2) {
      const other = [...this.fingers.values()].find((one) => one !== finger)!;
      const before = Math.hypot(finger.x - other.x, finger.y - other.y);
      const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      if (before > 10 && after > 10) this.zoom(before / after);
      this.pan(dx / 2, dy / 2);
    } else if (this.fingers.size === 1) {
      if ((event.buttons & 6) !== 0 || event.shiftKey) this.pan(dx, dy);
      else {
        this.turn(dx, dy);
        const seconds = Math.max((event.timeStamp - this.velocity.at) / 1000, 0.004);
        const blend = this.velocity.at === 0 ? 1 : 0.6;
        this.velocity = {
          x: (1 - blend) * this.velocity.x + (blend * dx) / (this.velocity.at === 0 ? 0.016 : seconds),
          y: (1 - blend) * this.velocity.y + (blend * dy) / (this.velocity.at === 0 ? 0.016 : seconds),
          at: event.timeStamp,
        };
      }
    }
    finger.x = event.clientX;
    finger.y = event.clientY;
  }

  private up(event: PointerEvent, done: boolean): void {
    if (!this.fingers.delete(event.pointerId)) return;
    if (this.fingers.size > 0) {
      this.velocity = { x: 0, y: 0, at: 0 };
      return;
    }
    if (done && !this.began.moved && event.timeStamp - this.began.at < TAP && event.button === 0) {
      const { clientX: x, clientY: y, timeStamp: at } = event;
      if (at - this.lastTap.at < DOUBLE && Math.hypot(x - this.lastTap.x, y - this.lastTap.y) < NEAR) {
        this.lastTap.at = -Infinity;
        this.reset();
      } else {
        this.lastTap = { x, y, at };
        this.events.tap(event.pointerType, x, y);
      }
      return;
    }
    // A touch that is not done has become the browser's own, which scrolls the page.
    const gliding = done && !this.calm.matches && event.timeStamp - this.velocity.at < 60;
    if (gliding && Math.hypot(this.velocity.x, this.velocity.y) > 60) this.run();
    else this.velocity = { x: 0, y: 0, at: 0 };
  }

  private wheel(event: WheelEvent): void {
    if (!this.ownsWheel() && !event.ctrlKey) return;
    event.preventDefault();
    this.events.input();
    const unit = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? this.height : 1;
    const [dx, dy] = [event.deltaX * unit, event.deltaY * unit];
    // Pinching on a trackpad arrives as wheel events with Ctrl; two-finger scrolling has small steps in both directions.
    if (event.ctrlKey) this.zoom(Math.exp(dy * 0.01));
    else if (dx !== 0 || Math.abs(dy) < 40) this.turn(-dx, -dy);
    else this.zoom(Math.exp(Math.sign(dy) * Math.min(Math.abs(dy), 200) * 0.0015));
  }

  private run(): void {
    if (this.handle !== 0) return;
    this.last = performance.now();
    this.handle = requestAnimationFrame(this.tick);
  }

  private readonly tick = (now: number): void => {
    const seconds = Math.min(Math.max((now - this.last) / 1000, 0), 0.1);
    this.last = now;
    const glide = this.fingers.size === 0 && this.glide(seconds);
    const busy = [glide, this.fly(now), this.keysHeld(seconds), this.gamepad(seconds)].some(Boolean);
    this.handle = busy ? requestAnimationFrame(this.tick) : 0;
  };

  private glide(seconds: number): boolean {
    const { velocity } = this;
    if (velocity.x === 0 && velocity.y === 0) return false;
    this.turn(velocity.x * seconds, velocity.y * seconds);
    const left = Math.exp(-seconds / GLIDE);
    velocity.x *= left;
    velocity.y *= left;
    if (Math.hypot(velocity.x, velocity.y) > 8) return true;
    velocity.x = velocity.y = 0;
    return false;
  }

  private fly(now: number): boolean {
    const { flight } = this;
    if (flight === null) return false;
    const part = Math.min(1, (now - flight.began) / FLY);
    const eased = 1 - (1 - part) ** 3;
    const mix = (a: number, b: number): number => a + (b - a) * eased;
    const { from, to } = flight;
    this.player.view = {
      azimuth: mix(from.azimuth, to.azimuth),
      elevation: mix(from.elevation, to.elevation),
      distance: mix(from.distance, to.distance),
      target: [0, 1, 2].map((k) => mix(from.target[k], to.target[k])) as [number, number, number],
    };
    if (part === 1) this.flight = null;
    return this.flight !== null;
  }

  private keysHeld(seconds: number): boolean {
    const names = [...this.keys.values()];
    const held = (name: string): number => (names.includes(name) ? 1 : 0);
    const x = held("ArrowRight") - held("ArrowLeft");
    const y = held("ArrowDown") - held("ArrowUp");
    const z = held("-") - Math.max(held("+"), held("="));
    if (x !== 0 || y !== 0) {
      if (this.shift) this.pan(-x * 300 * seconds, -y * 300 * seconds);
      else this.turn(-x * 220 * seconds, -y * 160 * seconds);
    }
    if (z !== 0) this.zoom(Math.exp(z * 1.4 * seconds));
    return this.keys.size > 0;
  }

  /** Left stick orbits, right stick pans, triggers zoom, the first button toggles playback, the second resets the view. */
  private gamepad(seconds: number): boolean {
    // Missing on insecure pages; entries can be null.
    const pads = (navigator.getGamepads as (() => (Gamepad | null)[]) | undefined)?.call(navigator) ?? [];
    const pad = pads.find((one) => one !== null) ?? null;
    if (pad === null) return false;
    const axis = (index: number): number => {
      const value = pad.axes[index] ?? 0;
      return Math.abs(value) < 0.15 ? 0 : value;
    };
    const [lx, ly, rx, ry] = [axis(0), axis(1), axis(2), axis(3)];
    if ([lx, ly, rx, ry].some((value) => value !== 0) || pad.buttons.some((button) => button.pressed)) this.events.input();
    if (lx !== 0 || ly !== 0) this.turn(-lx * 320 * seconds, -ly * 220 * seconds);
    if (rx !== 0 || ry !== 0) this.pan(-rx * 300 * seconds, -ry * 300 * seconds);
    const zoom = (pad.buttons[6]?.value ?? 0) - (pad.buttons[7]?.value ?? 0);
    if (Math.abs(zoom) > 0.05) this.zoom(Math.exp(zoom * 1.6 * seconds));
    const pressed = pad.buttons.slice(0, 2).map((button) => button.pressed);
    if (pressed[0] && !this.pressed[0]) {
      if (this.player.playing) this.player.pause();
      else this.player.play();
    }
    if (pressed[1] && !this.pressed[1]) this.reset();
    this.pressed = pressed;
    return true;
  }
}
