/** The page of a cast: several streams on a ground, as `cast.json` beside the page says (pipelines/share/cast_folder.py). */

import { Screen } from "../player/screen.ts";
import { SplatPlayback } from "../player/splat_playback.ts";
import { Statistics } from "../player/statistics.ts";
import { boxOf, cornersOf, OrbitCamera, type PartialView, type Vec3, type View } from "../render/camera.ts";
import { CastRenderer, composed, type Lying, placedAt, type Placement } from "../render/cast_renderer.ts";
import { messageOf } from "../stream/errors.ts";
import type { Vector } from "../stream/metadata.ts";
import type { Viewed } from "../ui/motion.ts";
import { CastClock, type Part } from "./clock.ts";
import { CastPage } from "./page.ts";
import { ContactShadow } from "./shadow.ts";

interface Item {
  readonly stream: string;
  /** Seconds until it begins. */
  readonly start: number;
  /** From its coordinates to some with y up in which it stands on y = 0, and from there to the world. */
  readonly standing: Placement;
  readonly place: Placement;
  readonly shadow: boolean;
}

interface Cast {
  readonly background: Vector;
  readonly camera: { readonly position: Vector; readonly target: Vector; readonly fov: number };
  readonly ground: { readonly color: Vec3; readonly radius: number; readonly shadow: number } | null;
  readonly items: readonly Item[];
}

/** A stream of the cast. */
interface Performer extends Part {
  /** Corners of its box in the world. */
  readonly corners: readonly Vector[];
  lying: Lying | null;
}

const page = new CastPage(document.querySelector<HTMLElement>("v3-cast")!);
const report = (error: unknown): void => page.notice(messageOf(error));
const cast = await page.attempt(async () => (await (await fetch("cast.json")).json()) as Cast);
const renderer = await page.attempt(() => new CastRenderer(page.canvas));
const camera = new OrbitCamera();
const screen = new Screen(renderer, page.canvas, camera, new Statistics(), () => undefined, () => undefined);
screen.background = cast.background;

async function add({ stream, start, standing, place, shadow }: Item, number: number): Promise<Performer> {
  const world = composed(place, standing);
  let contact: ContactShadow | null = null;
  const playback = new SplatPlayback((splats) => {
    renderer.show(number, world, splats);
    if (contact !== null) {
      const [x, z] = contact.middle;
      const { half } = contact;
      const pixels = contact.of(splats, standing);
      performer.lying = { place: composed(place, [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, z]), halves: [half, half], color: [0, 0, 0, 1], pixels };
    }
    screen.dirty = true;
  });
  playback.on("notice", report);
  playback.on("failed", report);
  const { box } = await playback.open(stream);
  const corners = cornersOf(box);
  const performer: Performer = { playback, start, corners: corners.map((corner) => placedAt(world, corner)), lying: null };
  const strength = cast.ground?.shadow ?? 0;
  if (shadow && strength > 0) contact = new ContactShadow(boxOf(corners.map((corner) => placedAt(standing, corner))), strength);
  return performer;
}

const performers: Performer[] = [];
for (const result of await Promise.allSettled(cast.items.map(add))) {
  if (result.status === "rejected") report(result.reason);
  else performers.push(result.value);
}
const corners = performers.flatMap((performer) => performer.corners);
const { position, target, fov } = cast.camera;
camera.frame(boxOf([...corners, target]), null, [0, 1, 0]);
camera.look(position, target, fov, corners);
// Static splats are streams of one frame.
const clock = new CastClock(performers.filter(({ playback }) => playback.info!.frameCount > 1));
const viewed: Viewed = {
  camera,
  stop: new AbortController(),
  get view(): View {
    return camera.view;
  },
  set view(view: PartialView) {
    camera.view = { ...camera.view, ...view };
    screen.dirty = true;
  },
  set fixedCamera(_: null) {
    screen.dirty = true; // the viewer has moved the camera
  },
  get playing(): boolean {
    return clock.playing;
  },
  play: () => clock.play(),
  pause: () => clock.pause(),
};
page.begin(clock, viewed);
const { ground } = cast;
const disk: Lying[] = ground === null ? [] : [{ place: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], halves: [ground.radius, ground.radius], color: [...ground.color, 1], pixels: null }];
let last = performance.now();
function tick(now: number): void {
  requestAnimationFrame(tick);
  clock.advance(Math.min(Math.max(now - last, 0), 250) / 1000);
  last = now;
  for (const { playback } of performers) playback.advance(now);
  renderer.lying = [...disk, ...performers.flatMap(({ lying }) => lying ?? [])];
  screen.update(now, !clock.playing);
}
requestAnimationFrame(tick);
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) clock.play();
Object.assign(globalThis, { cast: { camera, clock, performers, renderer, screen } });
