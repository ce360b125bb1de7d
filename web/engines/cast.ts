/** The page of a cast: several streams with static splats and models, as `cast.json` beside the page says (docs/guides/web.md). */

import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
import { CircleGeometry, Color, HemisphereLight, MathUtils, Mesh, MeshStandardMaterial } from "three";
import { type Object3D, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { ContactShadow } from "./contact_shadow.ts";
import { V3Performer } from "./three.ts";

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

/** A stream and when it begins, in seconds of the page's clock. */
interface Part {
  readonly performer: V3Performer;
  readonly start: number;
}

const cast = (await (await fetch("cast.json")).json()) as Cast;
const renderer = new WebGLRenderer();
document.body.prepend(renderer.domElement);
const spark = new SparkRenderer({ renderer, blurAmount: 0 });
const scene = new Scene();
scene.background = new Color().setRGB(...cast.background, "srgb");
scene.add(spark, new HemisphereLight(0xffffff, 0x606060, Math.PI));
const message = document.querySelector("p")!;
const report = (error: unknown): void => {
  message.textContent = error instanceof Error ? error.message : String(error);
};

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
const controls = new OrbitControls(camera, renderer.domElement);
controls.target = new Vector3(...cast.camera.target);
controls.update();
const resize = (): void => {
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(innerWidth, innerHeight);
};
addEventListener("resize", resize);
resize();
const parts: Part[] = [];
for (const result of await Promise.allSettled(cast.items.map(add))) {
  if (result.status === "rejected") report(result.reason);
  else if (result.value !== null) parts.push(result.value);
}

/** Seconds of the page's clock, which begins when everything is there. */
let clock = 0;
let last = performance.now();
let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
const button = document.querySelector("button")!;
const setPlaying = (now: boolean): void => {
  playing = now;
  button.textContent = playing ? "Pause" : "Play";
  if (!playing) for (const { performer } of parts) performer.playback.pause();
};
setPlaying(playing);
button.hidden = false;
button.addEventListener("click", () => setPlaying(!playing));
renderer.setAnimationLoop(() => {
  const now = performance.now();
  if (playing) clock += Math.min(now - last, 250) / 1000;
  last = now;
  // A stream that has not begun shows its first frame.
  if (playing) for (const { performer, start } of parts) if (clock >= start) performer.playback.play();
  if (parts.length > 0) spark.preBlurAmount = parts[0].performer.dilation;
  renderer.render(scene, camera);
});
Object.assign(globalThis, { cast: { camera, parts, scene, setPlaying } });
