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
import sys
import tempfile
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # many small products: threads would only wait for each other

import av
import numpy as np
from captures import CAPTURES, Capture
from rig import BOX_MARGIN, Camera, write_rig_files
from sensor import developed, recorded, to_bytes, write_matte, write_video

if TYPE_CHECKING:
    from scene import Scene

PLATE_SAMPLES = 24
FEATHER = 0.75 * BOX_MARGIN  # widths of the image at the edges of a frame's box over which it becomes the plate


def main() -> int:
    about, form = "render a capture with exact ground truth", argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=form)
    listed = "\n".join(f"{name}: {capture.about}" for name, capture in CAPTURES.items())
    parser.add_argument("name", choices=CAPTURES, metavar="NAME", help=listed)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--frames", type=int, help="fewer or more frames than the capture has")
    parser.add_argument("--cameras", help="names of the cameras to render, separated by commas")
    parser.add_argument("--scale", type=float, default=1.0, help="of the images' width and height")
    parser.add_argument("--samples", type=int, default=8, help="light paths per pixel (default: 8)")
    given = parser.parse_args()
    capture = CAPTURES[given.name]
    chosen = given.cameras.split(",") if given.cameras else [camera.name for camera in capture.cameras]
    cameras = tuple(scaled(camera, given.scale) for camera in capture.cameras if camera.name in chosen)
    if len(cameras) < len(chosen):
        parser.error(f"--cameras: {given.name} has {', '.join(camera.name for camera in capture.cameras)}")
    capture = replace(capture, cameras=cameras, frames=given.frames or capture.frames)
    Production(capture, given.folder, given.samples).make()
    return 0


def scaled(camera: Camera, scale: float) -> Camera:
    """The camera with another resolution; sizes are even."""
    return replace(camera, width=2 * round(camera.width * scale / 2), height=2 * round(camera.height * scale / 2))


class Production:
    """Renders frame by frame into FOLDER/.frames, then writes each camera's files."""

    def __init__(self, capture: Capture, folder: Path, samples: int) -> None:
        self.capture, self.folder, self.samples = capture, folder, samples
        self.frames = folder / ".frames"

    def make(self) -> None:
        """Render what is missing and write everything."""
        capture = self.capture
        self._refuse_other_settings()
        write_rig_files(self.folder, list(capture.cameras), capture.fps, capture.frames)
        with tempfile.TemporaryDirectory(prefix="studio-") as scratch:
            self._render(Path(scratch))
        for camera in capture.cameras:
            self._write_camera(camera)

    def _refuse_other_settings(self) -> None:
        """End if the folder has frames of other settings, which would be taken for those of this command."""
        for camera in self.capture.cameras:
            told = repr((camera, replace(self.capture, cameras=(), frames=0), self.samples))
            path = self.frames / camera.name / "settings.txt"
            if path.exists() and path.read_text() != told:
                raise SystemExit(f"{path.parent} has frames with other settings. Name another folder, or remove it.")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(told)

    def _render(self, scratch: Path) -> None:
        """Render frames, plates and meshes that are not there yet."""
        from scene import Scene  # Blender takes seconds to load

        capture = self.capture
        scene = Scene(capture)
        starts = [capture.start + frame / capture.fps for frame in range(capture.frames)]
        moments = [self._moments(camera, frame) for camera in capture.cameras for frame in range(capture.frames)]
        scene.skirts(np.array([*starts, *(moment for several in moments for moment in several)]))
        images = [(camera, frame) for frame in range(capture.frames) for camera in capture.cameras]
        for frame, start in enumerate(starts):
            self._write_mesh(scene, frame, start)
        scene.show_people(False)
        for camera in capture.cameras:
            self._write_shot(scene, camera, None, scratch)
        scene.show_people(True)
        began = time.monotonic()
        for done, (camera, frame) in enumerate(images):
            self._write_shot(scene, camera, frame, scratch)
            left = (time.monotonic() - began) / (done + 1) * (len(images) - done - 1) / 60
            told = f"rendered {done + 1} of {len(images)} images, {left:.0f} min left"
            print(f"\r{told} ({camera.name}, frame {frame})   ", end="", file=sys.stderr, flush=True)

    def _moments(self, camera: Camera, frame: int) -> list[float]:
        """Times at which a frame is rendered: one, or several over exposure and readout."""
        first = self.capture.start + frame / self.capture.fps * (1 + camera.drift) + camera.offset
        length = camera.shutter + camera.readout
        return [round(first + length * part, 6) for part in (np.linspace(0, 1, 5) if length else [0.0])]

    def _frame(self, camera: Camera, frame: int | None) -> Path:
        """The file with the light of a frame; None: of the empty set."""
        return self.frames / camera.name / ("plate.npz" if frame is None else f"{frame:06}.npz")

    def _write_shot(self, scene: "Scene", camera: Camera, frame: int | None, scratch: Path) -> None:
        """Write light, matte and depth of a frame, or of the empty set, unless they are there; with motion blur and
        rolling shutter as means of moments, by rows. Far from people and their shadows, it is the plate."""
        path = self._frame(camera, frame)
        if path.exists():
            return
        wide, width, height, focal = camera.lens.kind == "brown", camera.width, camera.height, camera.lens.focal
        if wide:  # rendered as a pinhole with a margin, more finely, and then distorted
            width, height, focal = 2 * camera.width, 2 * camera.height, focal / 1.4
        if frame is None:
            scene.aim(camera, width, height, focal)
            stored = scene.shot(scratch, None, PLATE_SAMPLES)
            np.save(self._raw_plate(camera), stored)
            layers = [stored]
        else:
            plate, layers = np.load(self._raw_plate(camera)), []
            for moment in self._moments(camera, frame):
                scene.put(moment)
                scene.aim(camera, width, height, focal)
                box = scene.box(camera, width, height, focal)
                layers.append(_pasted(plate, scene.shot(scratch, box, self.samples), box))
        layers = [_distorted(layer, camera, focal) for layer in layers] if wide else layers
        mean = np.einsum("rk,krwc->rwc", _row_weights(camera, len(layers)), np.array(layers))
        light, matte = mean[..., :3].astype(np.float16), mean[..., 3].astype(np.float16)
        partial = path.with_suffix(".part")
        with partial.open("wb") as file:
            np.savez_compressed(file, light=light, matte=matte, depth=mean[..., 4].astype(np.float32))
        partial.rename(path)

    def _raw_plate(self, camera: Camera) -> Path:
        """The file with the empty set as it was rendered, before the lens distorts it."""
        return self.frames / camera.name / "plate.npy"

    def _write_mesh(self, scene: "Scene", frame: int, moment: float) -> None:
        path = self.folder / "meshes" / f"{frame:06}.ply"
        if path.exists():
            return
        path.parent.mkdir(exist_ok=True)
        scene.put(moment)
        points, triangles = scene.surface()
        rows = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, triangles
        head = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
            f"property float x\nproperty float y\nproperty float z\nelement face {len(triangles)}\n"
            "property list uchar int vertex_indices\nend_header\n"
        )
        path.write_bytes(head.encode() + points.astype("<f4").tobytes() + rows.tobytes())

    def _write_camera(self, camera: Camera) -> None:
        """Video, matte, plate, and the truth of a held-out camera."""
        frames = range(self.capture.frames)  # read one by one: a 4K frame has hundreds of megabytes
        images = (recorded(self._picture(camera, frame), camera, frame) for frame in frames)
        write_video(self.folder / "videos" / f"{camera.name}.mp4", images, self.capture.fps, camera.crf)
        mattes = (to_bytes(self._stored(camera, frame)["matte"]) for frame in frames)
        write_matte(self.folder / "mattes" / f"{camera.name}.mkv", mattes, self.capture.fps)
        plate = self.folder / "clean_plates" / f"{camera.name}.png"
        _write_png(plate, to_bytes(self._picture(camera, None)))
        place = self.folder / "truth" / camera.name
        for frame in frames if camera.held_out else ():
            depth = np.clip(np.rint(self._stored(camera, frame)["depth"] * 1e4), 0, 65535).astype(np.uint16)
            _write_png(place / f"{frame:06}.png", to_bytes(self._picture(camera, frame)))
            _write_png(place / f"{frame:06}_depth.png", depth)

    def _picture(self, camera: Camera, frame: int | None) -> np.ndarray:
        """(H, W, 3) in [0, 1], without noise."""
        return developed(self._stored(camera, frame)["light"], camera)

    def _stored(self, camera: Camera, frame: int | None) -> dict[str, np.ndarray]:
        with np.load(self._frame(camera, frame)) as file:
            return {name: file[name].astype(np.float32) for name in file.files}


def _pasted(plate: np.ndarray, part: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """(H, W, C) plate with a part whose light becomes the plate's towards those edges that lie within the image."""
    (left, top, right, bottom), (height, width) = box, plate.shape[:2]
    rows, columns = np.arange(top, bottom) + 0.5, np.arange(left, right) + 0.5
    ramp = np.ones((bottom - top, right - left))
    for inside, distance in (
        (left > 0, columns - left),
        (right < width, right - columns),
        (top > 0, (rows - top)[:, None]),
        (bottom < height, (bottom - rows)[:, None]),
    ):
        if inside:
            ramp = ramp * np.clip(distance / (FEATHER * width), 0, 1)
    whole = plate.copy()
    under = whole[top:bottom, left:right]
    under[..., :3] += ramp[..., None] * (part[..., :3] - under[..., :3])
    under[..., 3:] = part[..., 3:]
    return whole


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
    path.parent.mkdir(parents=True, exist_ok=True)
    layout = "rgb24" if image.ndim == 3 else "gray16be"
    frame = av.VideoFrame.from_ndarray(image if image.ndim == 3 else image.byteswap(), format=layout)
    context = av.CodecContext.create("png", "w")
    context.width, context.height, context.pix_fmt = frame.width, frame.height, layout
    context.time_base = Fraction(1, 25)
    path.write_bytes(b"".join(bytes(packet) for packet in [*context.encode(frame), *context.encode(None)]))


if __name__ == "__main__":
    sys.exit(main())
