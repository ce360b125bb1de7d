"""Small images of takes and streams, kept in the user's cache folder. Slow: use on a worker thread."""

import contextlib
import hashlib
from pathlib import Path

import cv2
import numpy as np

from v3studio.gui.models.playback.sources import body_of, first_whole, open_path
from v3studio.gui.models.playback.viewpoint import BACKGROUNDS
from v3studio.gui.models.scene.compose import draw
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.stages import Inputs
from v3studio.gui.models.take.workspace import modified
from v3studio.pipelines.config import load_config
from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.storage.cache import cache_folder
from v3studio.studio.stream import is_address

SIZE = (480, 270)  # width and height of a thumbnail, pixels: enough for a card on a screen of double density
KEPT = 100  # files that are kept in the cache folder
_VERSION = "1"  # to be changed whenever a thumbnail of the same take would look different


def thumbnail(place: str) -> np.ndarray | None:
    """A recent place as (270, 480, 3) uint8 RGB: its first frame, or an image of its footage; None for a URL and where
    there is nothing to see. StudioError if it is damaged."""
    if is_address(place):
        return None
    name = hashlib.sha256(repr((_VERSION, place, _contents(place))).encode()).hexdigest()
    kept = cache_folder() / "thumbnails" / f"{name[:32]}.png"
    image = _read(kept)
    if image is None:
        image = _made(place)
        if image is not None:
            _write(kept, image)
    return image


def _contents(place: str) -> list[int]:
    """Changes with what the thumbnail shows."""
    names = ("", "manifest.json", "stream/manifest.json", "train", "config.yaml", "edits.json")
    return [modified(Path(place) / name) for name in names]


def _made(place: str) -> np.ndarray | None:
    opened = open_path(place)
    if opened.default is not None:
        with contextlib.closing(opened):
            gaussians = first_whole(opened.default)
        orbit = OrbitCamera.showing(body_of(gaussians), opened.up, opened.view)
        return draw(gaussians, orbit.camera(*SIZE), BACKGROUNDS["dark"])
    if opened.take is None:
        return None
    with contextlib.closing(Inputs(opened.take, load_config(opened.take.config)).raw_footage) as footage:
        return cropped(footage.raw_image(footage.camera_names[0], footage.frames[0]))


def cropped(image: np.ndarray) -> np.ndarray:
    """An (h, w, 3) image scaled to fill a thumbnail, its middle."""
    scale = max(SIZE[0] / image.shape[1], SIZE[1] / image.shape[0])
    size = max(round(image.shape[1] * scale), SIZE[0]), max(round(image.shape[0] * scale), SIZE[1])
    scaled = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    left, top = (size[0] - SIZE[0]) // 2, (size[1] - SIZE[1]) // 2
    return np.ascontiguousarray(scaled[top : top + SIZE[1], left : left + SIZE[0]])


def _read(path: Path) -> np.ndarray | None:
    if not path.is_file():
        return None
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None or image.shape != (SIZE[1], SIZE[0], 3):
        return None
    return np.ascontiguousarray(image[..., ::-1])


def _write(path: Path, image: np.ndarray) -> None:
    with contextlib.suppress(OSError):  # without a cache, it is drawn again next time
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, cv2.imencode(".png", image[..., ::-1])[1].tobytes())
        kept = sorted(path.parent.glob("*.png"), key=lambda file: file.stat().st_mtime)
        for old in kept[:-KEPT]:
            old.unlink(missing_ok=True)
