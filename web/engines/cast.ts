/** The page of a cast: several streams with static splats and models, as `cast.json` beside the page says (docs/guides/web.md). */

import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
import { type Box3, CircleGeometry, Color, HemisphereLight, MathUtils, Mesh, MeshStandardMaterial } from "three";
import { type Object3D, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { CastPage } from "./cast_page.ts";
import { CastClock, type Part } from "./cast_clock.ts";
import { ContactShadow } from "./contact_shadow.ts";
import { V3Performer } from "./three.ts";
import { pixelRatio } from "../src/render/gl.ts";
import { messageOf } from "../src/stream/errors.ts";

type Triple = [number, number, number];

interface Item {
  readonly stream?: string;
  readonly splats?: string;
  readonly model?: string;
  readonly position: Triple;
  readonly turn: Triple;
  readonly scale: number;
  readonly start: number;
}

interface Cast {
  readonly background: Triple;
  readonly camera: { readonly position: Triple; readonly target: Triple; readonly fov: number };
  readonly ground: { readonly color: Triple; readonly radius: number; readonly shadow: number } | null;
  readonly items: readonly Item[];
}

const page = new CastPage(document.querySelector<HTMLElement>("v3-cast")!);
const report = (error: unknown): void => page.notice(messageOf(error));
const cast = await page.attempt(async () => (await (await fetch("cast.json")).json()) as Cast);
const renderer = await page.attempt(() => new WebGLRenderer({ canvas: page.canvas }));
const spark = new SparkRenderer({ renderer, blurAmount: 0 });
const scene = new Scene();
scene.background = new Color().setRGB(...cast.background, "srgb");
scene.add(spark, new HemisphereLight(0xffffff, 0x606060, Math.PI));

function place(object: Object3D, { position, turn, scale }: Item): void {
  object.position.set(...position);
  object.rotation.set(...(turn.map(MathUtils.degToRad) as Triple));
  object.scale.setScalar(scale);
  scene.add(object);
}

/** Adds a performer, whose feet are where its item's position is, in a group with its shadow. */
async function addStream(address: string, item: Item, shadow: number): Promise<Part> {
  const performer = new V3Performer();
  await performer.open(address);
  const { playback, box } = performer;
  performer.position.y = -box.min.y;
  const group = new Scene();
  group.add(performer);
  if (shadow > 0) {
    const contact = new ContactShadow(performer.box, shadow);
    performer.onsplats = (splats) => contact.show(splats, performer.matrix);
    group.add(contact);
  }
  place(group, item);
  playback.on("notice", report);
  playback.on("failed", report);
  return { performer, start: item.start };
}

async function addSplats(address: string, item: Item): Promise<null> {
  const mesh = new SplatMesh({ url: address });
  await mesh.initialized;
  place(mesh, item);
  return null;
}

async function addModel(address: string, item: Item): Promise<null> {
  const { scene: model } = await new GLTFLoader().loadAsync(address);
  place(model, item);
  return null;
}

function add(item: Item): Promise<Part | null> {
  if (item.stream !== undefined) return addStream(item.stream, item, cast.ground?.shadow ?? 0);
  return item.splats !== undefined ? addSplats(item.splats, item) : addModel(item.model!, item);
}

if (cast.ground !== null) {
  const color = new Color().setRGB(...cast.ground.color, "srgb");
  scene.add(new Mesh(new CircleGeometry(cast.ground.radius, 96).rotateX(-Math.PI / 2), new MeshStandardMaterial({ color })));
}
const camera = new PerspectiveCamera(cast.camera.fov, 1, 0.05, 200);
camera.position.set(...cast.camera.position);
const controls = new OrbitControls(camera, page.stage);
controls.target = new Vector3(...cast.camera.target);
controls.listenToKeyEvents(page.stage);
controls.update();
controls.saveState();
camera.updateMatrixWorld();
const first = camera.matrixWorldInverse.clone();
const parts: Part[] = [];
for (const result of await Promise.allSettled(cast.items.map(add))) {
  if (result.status === "rejected") report(result.reason);
  else if (result.value !== null) parts.push(result.value);
}

/** How far to the side everybody reaches in the first view: the largest |x / z|. */
function reach(box: Box3): number {
  const { min, max } = box;
  const corners = [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new Vector3(x, y, z))));
  const seen = corners.map((corner) => corner.applyMatrix4(first)).filter(({ z }) => z < 0);
  return Math.max(0, ...seen.map(({ x, z }) => Math.abs(x / z)));
}

scene.updateMatrixWorld();
const wide = 1.05 * Math.max(0, ...parts.map(({ performer }) => reach(performer.box.applyMatrix4(performer.parent!.matrixWorld))));
const half = Math.tan(MathUtils.degToRad(cast.camera.fov / 2));
page.resized((width, height) => {
  camera.aspect = width / height;
  // On a phone, the document's field of view would show the middle only.
  camera.fov = 2 * MathUtils.radToDeg(Math.atan(Math.max(half, wide / camera.aspect)));
  camera.updateProjectionMatrix();
  renderer.setPixelRatio(pixelRatio());
  renderer.setSize(width, height, false);
});
const clock = new CastClock(parts);
page.begin(clock, () => controls.reset());
controls.addEventListener("start", () => page.turned());
let last = performance.now();
renderer.setAnimationLoop(() => {
  const now = performance.now();
  clock.advance(Math.min(now - last, 250) / 1000);
  last = now;
  if (parts.length > 0) spark.preBlurAmount = parts[0].performer.dilation;
  renderer.render(scene, camera);
});
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) clock.play();
Object.assign(globalThis, { cast: { camera, clock, parts, scene } });
