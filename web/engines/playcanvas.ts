/** A performer in a PlayCanvas scene. */

import {
  type AppBase, BoundingBox, Entity, GSplatData, GSplatResource, Quat, Vec3, WORKBUFFER_UPDATE_ALWAYS,
} from "playcanvas";
import { SplatPlayback } from "../src/player/splat_playback.ts";
import type { StreamOptions } from "../src/player/stream.ts";
import type { Splats, StreamInfo } from "../src/worker/messages.ts";

/** An entity with the component `gsplat`, whose splats are those of the frame that is due. */
export class V3Performer extends Entity {
  readonly playback: SplatPlayback;
  private resource: GSplatResource | null = null;
  /** Values by the names of a PLY file. */
  private values = new Map<string, Float32Array>();
  private readonly stop: { off(): unknown };

  constructor(private readonly app: AppBase, options: StreamOptions = {}) {
    super("performer", app);
    this.playback = new SplatPlayback((splats) => this.show(splats), options);
    this.stop = app.on("update", () => this.playback.advance(performance.now()));
    this.addComponent("gsplat", {});
    this.gsplat!.workBufferUpdate = WORKBUFFER_UPDATE_ALWAYS; // else it copies splats only when their number changes
  }

  /**
   * Opens a stream and turns its up direction into +y.
   *
   * @throws StreamError - there is no stream, or it cannot be decoded here
   */
  async open(address: string): Promise<StreamInfo> {
    const info = await this.playback.open(address);
    if (info.up !== null) this.setLocalRotation(new Quat().setFromDirections(new Vec3(...info.up).normalize(), Vec3.UP));
    return info;
  }

  /** The box of the whole take, in the coordinates of the parent; the floor is at its minimum of y. */
  get box(): { readonly min: Vec3; readonly max: Vec3 } {
    const whole = new BoundingBox();
    const { info } = this.playback;
    if (info !== null) {
      const own = new BoundingBox();
      own.setMinMax(new Vec3(...info.box.min), new Vec3(...info.box.max));
      whole.setFromTransformedAabb(own, this.getLocalTransform());
    }
    return { min: whole.getMin(), max: whole.getMax() };
  }

  override destroy(): void {
    this.stop.off();
    this.playback.dispose();
    super.destroy();
    this.resource?.destroy();
  }

  private show(splats: Splats): void {
    const bands = this.resource?.shBands;
    const fits = this.resource?.numSplats === splats.count && bands === splats.shDegree;
    if (!fits) this.values = new Map(namesOf(splats.shDegree).map((name) => [name, new Float32Array(splats.count)]));
    this.fill(splats);
    if (!fits) {
      this.replace(splats.count);
      return;
    }
    const resource = this.resource!;
    const data = resource.gsplatData as GSplatData;
    resource.updateTransformData(data);
    resource.updateColorData(data);
    if (splats.shDegree > 0) resource.updateSHData(data);
    data.calcAabb(resource.aabb);
    resource.centers = data.getCenters();
    resource.centersVersion++;
  }

  /** Another number of splats needs another resource. */
  private replace(count: number): void {
    const properties = [...this.values].map(([name, storage]) => ({ type: "float", name, storage, byteSize: 4 }));
    const data = new GSplatData([{ name: "vertex", count, properties }]);
    data.activated = true; // scales are lengths, opacities 0 to 1
    const before = this.resource;
    this.resource = new GSplatResource(this.app.graphicsDevice, data);
    this.gsplat!.resource = this.resource;
    before?.destroy();
  }

  private fill({ means, quats, scales, opacities, sh, shDegree, count }: Splats): void {
    const copy = (name: string, from: Float32Array, stride: number, first: number): void => {
      const to = this.values.get(name)!;
      for (let i = 0, at = first; i < count; i++, at += stride) to[i] = from[at];
    };
    const coefficients = (shDegree + 1) ** 2;
    ["x", "y", "z"].forEach((name, k) => copy(name, means, 3, k));
    for (let k = 0; k < 4; k++) copy(`rot_${k}`, quats, 4, k);
    for (let k = 0; k < 3; k++) copy(`scale_${k}`, scales, 3, k);
    copy("opacity", opacities, 1, 0);
    for (let color = 0; color < 3; color++) {
      copy(`f_dc_${color}`, sh, 3 * coefficients, color);
      for (let k = 1; k < coefficients; k++)
        copy(`f_rest_${color * (coefficients - 1) + k - 1}`, sh, 3 * coefficients, 3 * k + color);
    }
  }
}

function namesOf(shDegree: number): string[] {
  const rest = Array.from({ length: 3 * ((shDegree + 1) ** 2 - 1) }, (_, k) => `f_rest_${k}`);
  const names = ["x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity"];
  return [...names, "f_dc_0", "f_dc_1", "f_dc_2", ...rest];
}
