/**
 * The benchmark (`?benchmark`): plays 300 frames while the camera orbits, then draws the last one repeatedly, waiting for
 * the GPU each time.
 */

import type { Player } from "../player/player.ts";
import type { Series } from "../player/statistics.ts";

const FRAMES = 300;
const DRAWS = 60;
/** Degrees that the camera orbits per frame. */
const TURN = 0.6;

export interface Summary {
  /** What the device does where nothing else keeps it busy. */
  readonly p5: number;
  readonly median: number;
  readonly p95: number;
}

export interface BenchmarkResult {
  readonly format: "v3player-benchmark";
  readonly version: 1;
  readonly device: Record<string, string | number | boolean>;
  readonly stream: Record<string, string | number>;
  /** 5th, 50th and 95th percentiles, milliseconds. */
  readonly milliseconds: Record<string, Summary>;
  readonly frames: {
    readonly shown: number;
    readonly dropped: number;
    readonly stalls: number;
    /** Per second, over the whole run. */
    readonly rate: number;
    readonly wanted: number;
  };
  readonly picture: { readonly width: number; readonly height: number };
}

const round = (value: number): number => Math.round(value * 100) / 100;
const summary = (series: Series): Summary => ({
  p5: round(series.quantile(0.05)),
  median: round(series.quantile(0.5)),
  p95: round(series.quantile(0.95)),
});

function graphics(): string {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (gl === null) return "none";
  const extension = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(extension?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

/** Runs the benchmark on a player that has shown its first image. */
export async function benchmark(player: Player, progress: (part: number) => void): Promise<BenchmarkResult> {
  const info = player.info!;
  const { statistics } = player;
  player.loop = true;
  player.speed = 1;
  statistics.clear();
  const began = performance.now();
  await new Promise<void>((resolve) => {
    let done = false;
    player.on("frame", () => {
      if (done) return;
      player.camera.orbit(TURN, 0);
      player.moved();
      progress(Math.min(1, statistics.shown / FRAMES));
      if (statistics.shown >= FRAMES) {
        done = true;
        resolve();
      }
    });
    player.play();
  });
  const seconds = (performance.now() - began) / 1000;
  player.pause();
  const draws: number[] = [];
  for (let n = 0; n < DRAWS; n++) {
    await new Promise(requestAnimationFrame);
    player.camera.orbit(TURN, 0);
    draws.push(player.timeDraw());
  }
  draws.sort((a, b) => a - b);
  const [width, height] = player.drawSize;
  return {
    format: "v3player-benchmark",
    version: 1,
    device: {
      browser: navigator.userAgent,
      graphics: graphics(),
      cores: navigator.hardwareConcurrency,
      pixelRatio: window.devicePixelRatio,
      screen: `${screen.width}x${screen.height}`,
      secure: window.isSecureContext,
      decoding: player.path ?? "none",
    },
    stream: {
      profile: info.profile,
      codec: info.codec,
      frames: info.frameCount,
      splats: player.splats.all,
      shDegree: player.group?.shDegree ?? info.shDegree,
      bytesPerFrame: Math.round((player.group?.bytes ?? 0) / (player.group?.frames ?? 1)),
    },
    milliseconds: {
      decode: summary(statistics.decode),
      dequantize: summary(statistics.dequantize),
      sort: summary(statistics.sort),
      "prepare a group": summary(statistics.prepare),
      upload: summary(statistics.upload),
      "draw (CPU)": summary(statistics.draw),
      "draw (until done)": {
        p5: round(draws[Math.floor(DRAWS * 0.05)]),
        median: round(draws[DRAWS >> 1]),
        p95: round(draws[Math.floor(DRAWS * 0.95)]),
      },
      "main thread": summary(statistics.main),
      "between frames": summary(statistics.interval),
    },
    frames: {
      shown: statistics.shown,
      dropped: statistics.dropped,
      stalls: statistics.stalls,
      rate: round(statistics.shown / seconds),
      wanted: info.fps,
    },
    picture: { width, height },
  };
}
