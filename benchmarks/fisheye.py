"""Turns the frames of a rendered pinhole capture into those of fisheye lenses of 130 degrees, exactly.

    .venv/bin/python benchmarks/fisheye.py FOOTAGE FOLDER [FRAMES]

FOOTAGE has `cameras.json`, `videos/` and `bg/`, as the data that `sample_captures` is made from. Each pixel of a
fisheye looks up where its ray meets the pinhole's image. Rays beyond that image meet a box with a pattern of its own,
so that the surroundings fill the lens. FOLDER gets `wide/` (fisheyes, two kinds), `narrow/` (the same frames through
the pinholes) and `board/` (a chessboard of 9 x 6 squares of 120 mm before each fisheye).
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Camera, Rig, distorted

KINDS = (np.array([0.03, -0.008, 0.001, 0.0]), np.array([-0.02, 0.004, -0.001, 0.0002]))
BOX = np.array([7.0, 7.0, 4.0])  # half the sides in meters, around (0, 0, 1.5)
SQUARES, SQUARE = (9, 6), 0.12
random = np.random.default_rng(0)
PATTERN = cv2.resize(
    random.integers(0, 256, (6, 160, 160, 3), np.uint8).transpose(1, 2, 0, 3).reshape(160, 160, 18), (1280, 1280)
)


def fisheye(camera: Camera, number: int) -> Camera:
    """The lens of 130 degrees across with the focal length of `camera`."""
    distortion = KINDS[number % 2]
    reach = distorted(np.array([[np.tan(np.radians(65)), 0.0]]), distortion, True)[0, 0]
    width = 2 * round(camera.fx * float(reach))
    height = 2 * round(width * camera.height / camera.width / 2)
    K = np.array([[camera.fx, 0, width / 2 + 4], [0, camera.fx, height / 2 - 3], [0, 0, 1]])
    return Camera(camera.name, width, height, K, camera.world_to_camera, distortion, fisheye=True)


def rays(camera: Camera) -> np.ndarray:
    """(H, W, 3) directions in camera axes, NaN where there are none."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    xy = camera.normalized(np.column_stack([columns.ravel(), rows.ravel()]))
    return np.column_stack([xy, np.ones(len(xy))]).reshape(camera.height, camera.width, 3)


def surroundings(camera: Camera, directions: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: the box."""
    world = directions @ camera.rotation
    start = camera.center - [0, 0, 1.5]
    with np.errstate(all="ignore"):
        distances = np.where(world > 0, (BOX - start) / world, (-BOX - start) / world)
    face = np.nanargmin(np.nan_to_num(distances, nan=1e9), axis=-1)
    far = np.take_along_axis(distances, face[..., None], -1)
    at = np.nan_to_num((start + far * world) / BOX)
    side = 2 * face + (np.take_along_axis(world, face[..., None], -1)[..., 0] > 0)
    shown = np.zeros((*face.shape, 3), np.uint8)
    for number in range(6):
        axes = [axis for axis in range(3) if axis != number // 2]
        place = ((at[..., axes] + 1) * 639.5).astype(np.float32)
        face_pattern = np.ascontiguousarray(PATTERN[..., 3 * number : 3 * number + 3])
        drawn = cv2.remap(face_pattern, place[..., 0].copy(), place[..., 1].copy(), cv2.INTER_LINEAR)
        shown[side == number] = drawn[side == number]
    return shown


def through(camera: Camera, image: np.ndarray, directions: np.ndarray, around: np.ndarray) -> np.ndarray:
    """The pinhole's image through the fisheye, and the surroundings where it has none."""
    place = (directions @ camera.K.T)[..., :2].astype(np.float32) - 0.5
    known = np.nan_to_num(place, nan=-9)
    drawn = cv2.remap(image, known[..., 0].copy(), known[..., 1].copy(), cv2.INTER_CUBIC)
    inside = ((place >= 0) & (place <= [camera.width - 1, camera.height - 1])).all(-1)
    return np.where(inside[..., None], drawn, around)


def board_image(directions: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """A chessboard at a (4, 4) pose, board to camera, by intersection of each ray with its plane."""
    normal, origin = pose[:3, 2], pose[:3, 3]
    depth = (normal @ origin) / (directions @ normal)
    xy = (depth[..., None] * directions - origin) @ pose[:3, :2] / SQUARE
    on = ((xy >= 0) & (xy < SQUARES)).all(-1) & (depth > 0)
    margin = ((xy >= -1) & (xy < np.add(SQUARES, 1))).all(-1) & (depth > 0)
    dark = (np.floor(xy).sum(-1) % 2 == 0) & on
    drawn = np.where(dark, 20, np.where(margin, 235, 110)).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(drawn, (0, 0), 0.7))


def board_images(directions: np.ndarray, folder: Path) -> None:
    """Thirty images of a chessboard, up to 60 degrees from the axis."""
    moves = np.random.default_rng(7)
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(30):
        across, down = moves.uniform([-60, -32], [60, 32])
        facing = cv2.Rodrigues(np.radians([0, across, 0.0]))[0] @ cv2.Rodrigues(np.radians([-down, 0, 0.0]))[0]
        pose = np.eye(4)
        pose[:3, :3] = facing @ cv2.Rodrigues(moves.normal(size=3) * 0.35)[0]
        pose[:3, 3] = facing[:, 2] * moves.uniform(0.9, 1.6) - pose[:3, :2] @ np.array(SQUARES) * SQUARE / 2
        cv2.imwrite(str(folder / f"{number:06}.png"), board_image(directions, pose))


def main() -> None:
    footage, folder = Path(sys.argv[1]), Path(sys.argv[2])
    frames = range(int(sys.argv[3]) if len(sys.argv) > 3 else 3)
    rig = read_rig(footage / "cameras.json")
    wides = Rig(tuple(fisheye(camera, number) for number, camera in enumerate(rig)))
    for name, cameras in (("wide", wides), ("narrow", rig)):
        (folder / name).mkdir(parents=True, exist_ok=True)
        write_rig(cameras, folder / name / "cameras.json")
    for camera, wide in zip(rig, wides, strict=True):
        directions = rays(wide)
        around = surroundings(wide, directions)
        video = cv2.VideoCapture(str(footage / "videos" / f"{camera.name}.mp4"))
        plate = cv2.imread(str(footage / "bg" / f"{camera.name}.png"))
        images = {f"images/{camera.name}/{frame:06}.png": np.asarray(video.read()[1]) for frame in frames}
        images[f"bg/{camera.name}.png"] = np.asarray(plate)
        for path, image in images.items():
            for part in ("wide", "narrow"):
                (folder / part / path).parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / "narrow" / path), image)
            cv2.imwrite(str(folder / "wide" / path), through(camera, image, directions, around))
        board_images(directions, folder / "board" / wide.name)


if __name__ == "__main__":
    main()
