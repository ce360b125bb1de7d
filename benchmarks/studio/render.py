"""Renders a capture with exact ground truth: python benchmarks/studio/render.py NAME FOLDER.

Needs an environment of its own: see README.md beside this file. What is finished is kept, so the command goes on where
it was stopped. The same arguments give the same files on the same machine.

    videos/camNN.mp4            footage: H.264, 4:2:0, with the noise of the sensor
    clean_plates/camNN.png      the empty set, without noise
    mattes/camNN.mkv            exact masks with soft edges (FFV1)
    truth/camNN/NNNNNN.png      held-out cameras without noise, and NNNNNN_depth.png in 1/10,000 m (16 bit)
    meshes/NNNNNN.ply           the performers' surface; vertices correspond from frame to frame
    cameras.json                and transforms.json, intri.yml, extri.yml: the same cameras; clocks.json: when they see
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # many small products: threads would only wait for each other

import numpy as np
from captures import CAPTURES, Capture
from rig import Camera, write_rig_files
from sensor import developed, recorded, to_bytes, write_matte, write_video


def main() -> int:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").split("\n")[0], formatter_class=argparse.RawTextHelpFormatter
    )
    listed = "\n".join(f"{name}: {capture.about}" for name, capture in CAPTURES.items())
    parser.add_argument("name", choices=CAPTURES, metavar="NAME", help=listed)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--frames", type=int, help="fewer or more frames than the capture has")
    parser.add_argument("--cameras", help="names of the cameras to render, separated by commas")
    parser.add_argument("--scale", type=float, default=1.0, help="of the images' width and height")
    parser.add_argument("--samples", type=int, default=10, help="light paths per pixel (default: 10)")
    given = parser.parse_args()
    capture = CAPTURES[given.name]
    chosen = given.cameras.split(",") if given.cameras else [camera.name for camera in capture.cameras]
    cameras = tuple(scaled(camera, given.scale) for camera in capture.cameras if camera.name in chosen)
    if len(cameras) < len(chosen):
        parser.error(f"--cameras: {given.name} has {', '.join(camera.name for camera in capture.cameras)}")
    Production(
        replace(capture, cameras=cameras, frames=given.frames or capture.frames), given.folder, given.samples
    ).make()
    return 0


def scaled(camera: Camera, scale: float) -> Camera:
    """The camera with another resolution; sizes are even."""
    return replace(camera, width=2 * round(camera.width * scale / 2), height=2 * round(camera.height * scale / 2))


class Production:
    """Renders frame by frame into FOLDER/.frames, then writes each camera's files."""

    def __init__(self, capture: Capture, folder: Path, samples: int) -> None:
        self.capture, self.folder, self.samples = capture, folder, samples
        self.frames = folder / ".frames"
        self.scratch = Path(tempfile.mkdtemp(prefix="studio-"))

    def make(self) -> None:
        """Render what is missing and write everything."""
        from scene import Scene  # Blender takes seconds to load

        capture = self.capture
        self.folder.mkdir(parents=True, exist_ok=True)
        write_rig_files(self.folder, list(capture.cameras), capture.fps, capture.frames)
        scene = Scene(capture, self.samples)
        moments = [
            moment
            for camera in capture.cameras
            for frame in range(capture.frames)
            for moment in self._moments(camera, frame)
        ]
        whole = [capture.start + frame / capture.fps for frame in range(capture.frames)]
        scene.skirts(np.array(moments + whole))
        done, started, total = 0, time.monotonic(), len(capture.cameras) * (capture.frames + 1)
        for frame in range(capture.frames):
            self._write_mesh(scene, frame, whole[frame])
            for camera in capture.cameras:
                done += self._once(
                    self.frames / camera.name / f"{frame:06}.npz", lambda c=camera, f=frame: self._shots(scene, c, f)
                )
                self._report(done, total, started, f"{camera.name}, frame {frame}")
        scene.empty()
        for camera in capture.cameras:
            done += self._once(self.frames / camera.name / "plate.npz", lambda c=camera: self._shots(scene, c, None))
            self._report(done, total, started, f"{camera.name}, plate")
        for camera in capture.cameras:
            self._write_camera(camera)
        shutil.rmtree(self.scratch)

    def _moments(self, camera: Camera, frame: int) -> list[float]:
        """Times at which a frame is rendered: one, or several over exposure and readout."""
        first = self.capture.start + frame / self.capture.fps * (1 + camera.drift) + camera.offset
        length = camera.shutter + camera.readout
        return [round(first + length * part, 6) for part in (np.linspace(0, 1, 5) if length else [0.0])]

    def _shots(self, scene: object, camera: Camera, frame: int | None) -> dict[str, np.ndarray]:
        """Light, matte and depth of a frame, or of the empty set; with motion blur and rolling shutter as means of
        moments, by rows."""
        wide, width, height, focal = camera.lens.kind == "brown", camera.width, camera.height, camera.lens.focal
        if wide:  # rendered as a pinhole with a margin, more finely, and then distorted
            width, height, focal = 2 * camera.width, 2 * camera.height, focal / 1.4
        moments = [None] if frame is None else self._moments(camera, frame)
        layers = []
        for moment in moments:
            if moment is not None:
                scene.put(moment)  # type: ignore[attr-defined]
            scene.aim(camera, width, height, focal)  # type: ignore[attr-defined]
            light, matte, depth = scene.shot(self.scratch)  # type: ignore[attr-defined]
            shown = np.dstack([light, matte, np.minimum(depth, 60.0)])
            layers.append(_distorted(shown, camera, focal) if wide else shown)
        weights = _row_weights(camera, len(layers))
        mean = np.einsum("rk,krwc->rwc", weights, np.array(layers))
        return {
            "light": mean[..., :3].astype(np.float16),
            "matte": mean[..., 3].astype(np.float16),
            "depth": mean[..., 4].astype(np.float32),
        }

    def _once(self, path: Path, make: object) -> int:
        """Write a file of arrays unless it is there; returns 1."""
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_suffix(".part")
            with partial.open("wb") as file:
                np.savez_compressed(file, **make())  # type: ignore[operator]
            partial.rename(path)
        return 1

    def _report(self, done: int, total: int, started: float, what: str) -> None:
        passed = time.monotonic() - started
        left = passed / max(done, 1) * (total - done) / 60
        print(
            f"\rrendered {done} of {total} images, {left:.0f} min left ({what})   ", end="", file=sys.stderr, flush=True
        )

    def _write_mesh(self, scene: object, frame: int, moment: float) -> None:
        path = self.folder / "meshes" / f"{frame:06}.ply"
        if path.exists():
            return
        path.parent.mkdir(exist_ok=True)
        scene.put(moment)  # type: ignore[attr-defined]
        parts, faces, start = [], [], 0
        for performer in scene.performers:  # type: ignore[attr-defined]
            for data in performer.meshes():
                vertices = np.empty(len(data.vertices) * 3, np.float32)
                data.vertices.foreach_get("co", vertices)
                quads = np.empty(len(data.polygons) * 4, np.int32)
                data.polygons.foreach_get("vertices", quads)
                parts.append(vertices.reshape(-1, 3))
                corners = quads.reshape(-1, 4) + start
                faces += [corners[:, :3], corners[:, [0, 2, 3]]]
                start += len(data.vertices)
        points, triangles = np.vstack(parts), np.vstack(faces)
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz") + f"element face {len(triangles)}\n"
        head += "property list uchar int vertex_indices\nend_header\n"
        rows = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, triangles
        path.write_bytes(head.encode() + points.astype("<f4").tobytes() + rows.tobytes())

    def _write_camera(self, camera: Camera) -> None:
        """Video, matte, plate, and the truth of a held-out camera."""
        fps = self.capture.fps
        video, matte = self.folder / "videos" / f"{camera.name}.mp4", self.folder / "mattes" / f"{camera.name}.mkv"
        if not video.exists():
            images = (
                recorded(developed(shot["light"], camera), camera, n) for n, shot in enumerate(self._stored(camera))
            )
            write_video(video, images, fps, camera.crf)
        if not matte.exists():
            write_matte(matte, (to_bytes(shot["matte"]) for shot in self._stored(camera)), fps)
        plate = np.load(self.frames / camera.name / "plate.npz")
        _write_png(
            self.folder / "clean_plates" / f"{camera.name}.png",
            to_bytes(developed(plate["light"].astype(np.float32), camera)),
        )
        if camera.held_out:
            for number, shot in enumerate(self._stored(camera)):
                place = self.folder / "truth" / camera.name
                _write_png(place / f"{number:06}.png", to_bytes(developed(shot["light"], camera)))
                _write_png(
                    place / f"{number:06}_depth.png", np.clip(np.rint(shot["depth"] * 1e4), 0, 65535).astype(np.uint16)
                )

    def _stored(self, camera: Camera) -> Iterator[dict[str, np.ndarray]]:
        for frame in range(self.capture.frames):
            with np.load(self.frames / camera.name / f"{frame:06}.npz") as file:
                yield {name: file[name].astype(np.float32) for name in file.files}


def _row_weights(camera: Camera, count: int) -> np.ndarray:
    """(H, K) share of each of K moments in each row: those within the row's exposure."""
    if count == 1:
        return np.ones((camera.height, 1))
    times = np.linspace(0, camera.shutter + camera.readout, count)
    begin = np.linspace(0, camera.readout, camera.height)[:, None]
    width = (camera.shutter + camera.readout) / (count - 1)
    # A moment stands for a hat around its time; its share is the hat within the exposure.
    middle = begin + camera.shutter / 2
    shares = np.maximum(0, 1 - np.maximum(0, np.abs(times - middle) - camera.shutter / 2) / width)
    return shares / shares.sum(axis=1, keepdims=True)


def _distorted(shown: np.ndarray, camera: Camera, focal: float) -> np.ndarray:
    """(H, W, C) of a "brown" lens from a pinhole image with `focal` in its widths, by linear interpolation."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    K = camera.matrix
    normalized = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]], axis=-1)
    straight = camera.lens.undistorted(normalized)
    height, width = shown.shape[:2]
    x = np.clip(straight[..., 0] * focal * width + width / 2 - 0.5, 0, width - 1.001)
    y = np.clip(straight[..., 1] * focal * width + height / 2 - 0.5, 0, height - 1.001)
    left, top = x.astype(int), y.astype(int)
    u, v = (x - left)[..., None], (y - top)[..., None]
    upper = (1 - u) * shown[top, left] + u * shown[top, left + 1]
    return (1 - v) * upper + v * ((1 - u) * shown[top + 1, left] + u * shown[top + 1, left + 1])


def _write_png(path: Path, image: np.ndarray) -> None:
    """Write (H, W, 3) uint8 or (H, W) uint16."""
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    layout = "rgb24" if image.ndim == 3 else "gray16be"
    frame = av.VideoFrame.from_ndarray(image if image.ndim == 3 else image.byteswap(), format=layout)
    context = av.CodecContext.create("png", "w")
    context.width, context.height, context.pix_fmt = frame.width, frame.height, layout
    context.time_base = Fraction(1, 25)
    path.write_bytes(b"".join(bytes(packet) for packet in [*context.encode(frame), *context.encode(None)]))


if __name__ == "__main__":
    sys.exit(main())
