/** Views, camera paths and what the controls write. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { FADE, OrbitCamera, type Pinhole, placeIn, visibility } from "../src/render/camera.ts";
import type { Player } from "../src/player/player.ts";
import type { Camera, Vector } from "../src/stream/metadata.ts";
import { clock } from "../src/ui/format.ts";
import { readPath, spline } from "../src/ui/intro.ts";
import { parseView } from "../src/ui/link.ts";
import { ticks } from "../src/review/curves.ts";
import { pointAt } from "../src/ui/pins.ts";
import { summaryOf, wordOf, worstFrames } from "../src/review/words.ts";

/** A figure of 1.8 m that walks 1.4 m; z is up. */
const BOX = { min: [-0.7, -0.5, 0] as Vector, max: [0.7, 0.5, 1.8] as Vector };
const UP: Vector = [0, 0, 1];
/** 4 m in front of its middle, where y points away from it. */
const FRONT: Camera = {
  width: 1600,
  height: 900,
  K: [[1400, 0, 800], [0, 1400, 450], [0, 0, 1]],
  worldToCamera: [[1, 0, 0, 0], [0, 0, -1, 0.9], [0, 1, 0, 4], [0, 0, 0, 1]],
};

function pixel({ rotation: r, translation: t, fx, fy, cx, cy }: Pinhole, point: Vector): [number, number] {
  const [x, y, z] = [0, 1, 2].map((k) => r[3 * k] * point[0] + r[3 * k + 1] * point[1] + r[3 * k + 2] * point[2] + t[k]);
  return [(fx * x) / z + cx, (fy * y) / z + cy];
}

function opened(): OrbitCamera {
  const camera = new OrbitCamera();
  camera.frame(BOX, FRONT, UP);
  return camera;
}

void test("the figure is large on a phone and on a wide screen", () => {
  const camera = opened();
  for (const [width, height] of [[390, 844], [320, 568], [820, 1180], [1440, 900], [3840, 2160]]) {
    const pinhole = camera.pinhole(width, height);
    const [[, head], [, feet]] = [pixel(pinhole, [0, 0, 1.8]), pixel(pinhole, [0, 0, 0])];
    assert.ok(head > 0 && feet < height, `cut at ${width}x${height}`);
    assert.ok((feet - head) / height > 0.45, `${Math.round((100 * (feet - head)) / height)}% of ${width}x${height}`);
    assert.ok(Math.abs(pixel(pinhole, [0, 0, 0.9])[0] - width / 2) < 1);
  }
});

/** A camera under the ceiling, 3 m from the middle of the stage; everybody fills the image. */
function ceiling(middle: Vector, degrees: number): Camera {
  const [s, c] = [Math.sin((degrees * Math.PI) / 180), Math.cos((degrees * Math.PI) / 180)];
  const rows: Vector[] = [[1, 0, 0], [0, -s, -c], [0, c, -s]];
  const eye = [middle[0], middle[1] - 3 * c, middle[2] + 3 * s];
  const worldToCamera = rows.map((row) => [...row, -(row[0] * eye[0] + row[1] * eye[1] + row[2] * eye[2])]);
  return { width: 1600, height: 900, K: [[1000, 0, 800], [0, 1000, 450], [0, 0, 1]], worldToCamera: [...worldToCamera, [0, 0, 0, 1]] };
}

void test("everybody is seen from eye level at first, on any screen", () => {
  const stage = { min: [-1.4, -0.8, 0] as Vector, max: [1.4, 0.8, 1.8] as Vector };
  for (const degrees of [0, 35, 60]) {
    const camera = new OrbitCamera();
    camera.frame(stage, ceiling([0, 0, 0.9], degrees), UP);
    assert.ok(Math.abs(camera.elevation) <= 10.001);
    for (const [width, height] of [[390, 844], [844, 390], [820, 1180], [1440, 900]])
      for (const x of [stage.min[0], stage.max[0]])
        for (const y of [stage.min[1], stage.max[1]])
          for (const z of [0, 1.8]) {
            const [column, row] = pixel(camera.pinhole(width, height), [x, y, z]);
            assert.ok(column >= 0 && column <= width && row >= 0 && row <= height, `${degrees}°: ${x}, ${y}, ${z} at ${width}x${height}`);
          }
  }
});

void test("the studio can choose where to begin", () => {
  const camera = opened();
  camera.begin({ azimuth: 40, elevation: 25 });
  camera.orbit(30, 10);
  camera.reset();
  assert.deepEqual([camera.azimuth, camera.elevation], [40, 25]);
});

void test("links may leave out what stays as it is", () => {
  assert.deepEqual(parseView("30,10"), { azimuth: 30, elevation: 10 });
  assert.deepEqual(parseView("30,10,2.5"), { azimuth: 30, elevation: 10, distance: 2.5 });
  for (const wrong of ["30", "30,10,0", "30,10,2,0", "30,x", "1,2,3,4,5,6,7"]) assert.equal(parseView(wrong), null, wrong);
});

void test("times are rounded", () => {
  assert.deepEqual([0.48, 0.44, 59.96, 61.25, 3599.99].map(clock), ["0:00.5", "0:00.4", "1:00.0", "1:01.3", "60:00.0"]);
});

void test("the spline passes through its points with continuous velocity", () => {
  const [times, values] = [[0, 1, 1.5, 4], [2, -1, 0, 5]];
  const curve = spline(times, values);
  times.forEach((time, i) => { assert.ok(Math.abs(curve(time) - values[i]) < 1e-12); });
  const speed = (time: number, step: number): number => (curve(time + step) - curve(time)) / step;
  for (const time of [1, 1.5]) assert.ok(Math.abs(speed(time, 1e-5) - speed(time, -1e-5)) < 1e-3);
  // No bend at the ends, and a straight line stays straight.
  const bend = (curve(0.002) - 2 * curve(0.001) + curve(0)) / 1e-6;
  assert.ok(Math.abs(bend) < 0.1, String(bend));
  assert.ok(Math.abs(spline([0, 1, 3], [0, 2, 6])(2) - 4) < 1e-12);
  assert.deepEqual([curve(-1), curve(9)], [2, 5]);
});

void test("an intro shows what its cameras see", () => {
  const camera = opened();
  const right = { ...FRONT, worldToCamera: [[0, 1, 0, 0], [0, 0, -1, 0.9], [-1, 0, 0, 3], [0, 0, 0, 1]] };
  const values = (one: Camera): object => ({ ...one, worldToCamera: undefined, world_to_camera: one.worldToCamera });
  const keys = [FRONT, right].map((one, i) => ({ time: 5 + 2 * i, camera: values(one) }));
  const text = JSON.stringify({ format: "v3studio-camera-path", version: 1, keys });
  const path = readPath(text, { camera } as unknown as Player);
  assert.equal(path.seconds, 2);
  for (const [seconds, { K, worldToCamera: w }] of [[0, FRONT], [2, right]] as const) {
    camera.view = path.at(seconds);
    const pinhole = camera.pinhole(1600, 900);
    const given = { ...pinhole, fx: K[0][0], fy: K[1][1], rotation: w.slice(0, 3).flatMap((row) => row.slice(0, 3)), translation: w.slice(0, 3).map((row) => row[3]) as unknown as Vector };
    // In the plane of the subject, each point is where the camera sees it.
    for (const point of [[0, 0, 0.9], [0, 0, 0.4]] as Vector[])
      pixel(pinhole, point).forEach((value, k) => { assert.ok(Math.abs(value - pixel(given, point)[k]) < 1, `${point.join()} at ${seconds}`); });
  }
  const halfway = path.at(1);
  assert.ok(Math.abs(Math.abs(halfway.azimuth) - 45) < 1);
  for (const wrong of ["", "[]", "{}", text.replace("1400", "-1").replace("1400", "-1"), text.replace('"time":7', '"time":5'), text.replace('"keys":[', '"keys":[null,'), text.replace('"time"', '"easing":"bounce","time"')])
    assert.throws(() => readPath(wrong, { camera } as unknown as Player), /camera path/, wrong.slice(0, 60));
});

void test("an intro moves from key to key as its easings say", () => {
  const camera = opened();
  const turned = (degrees: number): number[][] => {
    const [s, c] = [Math.sin((degrees * Math.PI) / 180), Math.cos((degrees * Math.PI) / 180)];
    return FRONT.worldToCamera.map(([x, y, ...rest]) => [c * x - s * y, s * x + c * y, ...rest]);
  };
  const at = (easing: string, seconds: number): number => {
    const keys = [0, 30, 90].map((degrees, i) => ({
      time: i,
      easing: i === 0 ? easing : undefined,
      camera: { ...FRONT, world_to_camera: turned(degrees) },
    }));
    const text = JSON.stringify({ format: "v3studio-camera-path", version: 1, keys });
    const path = readPath(text, { camera } as unknown as Player);
    return Math.abs(path.at(seconds).azimuth - path.at(0).azimuth);
  };
  const near = (value: number, wanted: number): void => { assert.ok(Math.abs(value - wanted) < 1e-3, `${value}, not ${wanted}`); };
  // The spline's slope at the first key is 22.5° per second: it is natural, and passes 0°, 30° and 90°.
  const smooth = (share: number): number => 22.5 * share + 7.5 * share ** 3;
  near(at("smooth", 0.25), smooth(0.25));
  near(at("ease", 0.25), smooth(0.25 ** 2 * 2.5));
  near(at("linear", 0.25), 7.5);
  near(at("hold", 0.99), 0);
  for (const easing of ["smooth", "ease", "linear", "hold"]) {
    near(at(easing, 1), 30);
    near(at(easing, 1.5), at("smooth", 1.5));
  }
});

void test("the picture fades where no camera filmed from nearby", () => {
  const range = { center: [1, 2, 3] as Vector, directions: [[1, 0, 0], [0, 1, 0]] as Vector[], angle: 40 };
  const from = (degrees: number): Vector => {
    const turn = (degrees * Math.PI) / 180;
    return [1 + 5 * Math.cos(turn), 2 + 5 * Math.sin(turn), 3];
  };
  for (const inside of [0, 39, 90, 129, -39]) assert.equal(visibility(range, from(inside)), 1, String(inside));
  assert.ok(Math.abs(visibility(range, from(130 + FADE / 2)) - 0.5) < 1e-6);
  for (const outside of [-61, 151, 225]) assert.equal(visibility(range, from(outside)), 0, String(outside));
  assert.equal(visibility(range, [1, 2, 9]), 0, "from above");
  assert.equal(visibility(range, range.center), 1);
});

void test("quality is said in words, and the worst moment of each passage is found", () => {
  const decoded = [33, 30, 26, 30, 33, null, 20, 24, 33, 30.5, 33, 29];
  const rated = { decoded, words: [31, 25] as const };
  assert.deepEqual([0, 1, 5, 6].map((frame) => wordOf(rated, frame)), ["good", "visible loss", null, "bad"]);
  assert.deepEqual(worstFrames(rated, 3), [2, 6, 11]);
  assert.deepEqual(worstFrames({ decoded: [33, 34], words: [31, 25] }, 3), []);
  assert.equal(summaryOf({ decoded: [33, 33, 33, 20], words: [31, 25] }), "Quality: good 75% of the time, bad 25% of the time.");
});

void test("axes have round ticks", () => {
  assert.deepEqual(ticks(27, 34, 3), [30]);
  assert.deepEqual(ticks(0, 1.16, 5), [0, 0.5, 1]);
  assert.deepEqual(ticks(0, 30, 3), [0, 10, 20, 30]);
});

void test("a place in the image is the same place from the same view", () => {
  const pinhole = opened().pinhole(390, 844);
  const point = pointAt(pinhole, 100, 300, [0, 0, 0.9]);
  const place = placeIn(pinhole, point)!;
  assert.ok(Math.hypot(place[0] - 100, place[1] - 300) < 1e-6);
  assert.ok(Math.abs(point[1]) < 0.2, "at the depth of the performer");
});
