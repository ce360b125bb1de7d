/** A performer in a three.js scene, rendered by Spark. */

import { ExtSplats, SplatMesh, utils } from "@sparkjsdev/spark";
import { Box3, Quaternion, Vector3 } from "three";
import { SplatPlayback } from "../src/player/splat_playback.ts";
import type { StreamOptions } from "../src/player/stream.ts";
import type { Splats, StreamInfo } from "../src/worker/messages.ts";

/** Value of the first spherical harmonic. */
const SH0 = 0.28209479177387814;
/** Arrays of a splat's further harmonics: four of RGB in each. */
const HARMONICS = ["sh1", "sh2", "sh3a", "sh3b"] as const;
/** Textures of these arrays, which Spark makes when it first needs them. */
const TEXTURES = ["sh1Texture", "sh2Texture", "sh3TextureA", "sh3TextureB"] as const;

interface Dyno {
  readonly value: { needsUpdate: boolean };
}

/** A `SplatMesh` whose splats are those of the frame that is due. */
export class V3Performer extends SplatMesh {
  readonly playback: SplatPlayback;
  /** The dilation with which the shown splats were trained, square pixels: a SparkRenderer's `preBlurAmount`, without `blurAmount`. */
  dilation = 0.3;

  constructor(options: StreamOptions = {}) {
    super({ extSplats: new ExtSplats(), editable: false });
    this.playback = new SplatPlayback((splats) => this.show(splats), options);
  }

  /**
   * Opens a stream and turns its up direction into +y.
   *
   * @throws StreamError - there is no stream, or it cannot be decoded here
   */
  async open(address: string): Promise<StreamInfo> {
    const info = await this.playback.open(address);
    if (info.up !== null) this.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(...info.up).normalize(), new Vector3(0, 1, 0)));
    return info;
  }

  /** The box of the whole take, in the coordinates of the parent; its `min.y` is the floor. */
  get box(): Box3 {
    const { info } = this.playback;
    if (info === null) return new Box3();
    this.updateMatrix();
    return new Box3(new Vector3(...info.box.min), new Vector3(...info.box.max)).applyMatrix4(this.matrix);
  }

  /** Called by Spark for each image. */
  override update(context: Parameters<SplatMesh["update"]>[0]): void {
    this.playback.advance(performance.now());
    super.update(context);
  }

  override dispose(): void {
    // Spark would go on to draw what is freed.
    this.removeFromParent();
    this.playback.dispose();
    super.dispose();
  }

  private show(splats: Splats): void {
    const target = this.extSplats!;
    const { means, quats, scales, opacities, sh, count, shDegree } = splats;
    this.dilation = splats.dilation;
    const arrays = target.ensureSplats(count);
    target.numSplats = count;
    const width = 3 * (shDegree + 1) ** 2;
    for (let i = 0; i < count; i++) {
      const p = 3 * i;
      const q = 4 * i;
      const c = width * i;
      utils.encodeExtSplat(
        arrays,
        i,
        means[p],
        means[p + 1],
        means[p + 2],
        scales[p],
        scales[p + 1],
        scales[p + 2],
        quats[q + 1],
        quats[q + 2],
        quats[q + 3],
        quats[q],
        opacities[i],
        0.5 + SH0 * sh[c],
        0.5 + SH0 * sh[c + 1],
        0.5 + SH0 * sh[c + 2],
      );
    }
    this.showHarmonics(splats, target);
    // Spark makes the textures of a new size.
    const [first, second] = target.textures;
    if (target.maxSplats === first.image.width * first.image.height * first.image.depth) first.needsUpdate = second.needsUpdate = true;
    else target.initialize({ extArrays: arrays, numSplats: count, extra: target.extra });
    this.updateVersion();
  }

  private showHarmonics({ sh, count, shDegree }: Splats, { extra, maxSplats }: ExtSplats): void {
    const further = (shDegree + 1) ** 2 - 1;
    HARMONICS.forEach((name, group) => {
      if (4 * group >= further) return;
      let words = extra[name] as Uint32Array | undefined;
      if (words?.length !== 4 * maxSplats) {
        extra[name] = words = new Uint32Array(4 * maxSplats);
        extra[TEXTURES[group]] = undefined;
        this.updateGenerator();
      }
      for (let k = 4 * group; k < Math.min(4 * group + 4, further); k++)
        for (let i = 0, c = 3 * (k + 1); i < count; i++, c += 3 * (further + 1))
          words[4 * i + (k % 4)] = utils.encodeExtRgb(sh[c], sh[c + 1], sh[c + 2]);
      const texture = extra[TEXTURES[group]] as Dyno | undefined;
      if (texture !== undefined) texture.value.needsUpdate = true;
    });
  }
}
