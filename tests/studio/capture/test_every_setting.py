"""Every setting of the footage and its masks changes something: none is read by nobody."""

import hashlib
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.sounds import clicks, write_wav
from v3studio.pipelines.stages.camera_file import camera_file
from v3studio.studio.cameras import Rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import open_footage
from v3studio.studio.settings import affected

MODELS = Path(__file__).parents[1] / "masks" / "data"
HEIGHT, WIDTH = 64, 96

PLATES = {"masks": "clean_plate"}
SCREEN = {"root": "screen", "masks": "chroma_key"}
VIDEO = {"root": "video", "masks": "none"}

CHANGES: dict[str, tuple[Any, dict[str, Any]]] = {
    "root": ("screen", {"masks": "none"}),
    "images": ("other_images/{camera}/{frame}.png", {"masks": "none"}),
    "masks": ("none", {}),
    "mask_files": ("other_masks/{camera}.png", {"masks": "files", "frames": ":1"}),
    "mask_labels": ((7,), {"mask_files": "labels/{camera}.png", "masks": "files", "frames": ":1"}),
    "clean_plates": ("other_plates/{camera}.png", PLATES),
    "audio": ("a.wav", {}),
    "audio_offset": (0.5, {"audio": "a.wav"}),
    "mask_sensitivity": (0.1, PLATES),
    "mask_shadows": ("none", PLATES),
    "mask_components": (1, PLATES),
    "key_color": ((0.9, 0.2, 0.1), SCREEN),
    "garbage_masks": ("garbage.yaml", {}),
    "fps": (24.0, {}),
    "color_matrix": ("bt709", VIDEO),
    "transfer": ("linear", {}),
    "cameras": (("a", "b"), {}),
    "held_out": (("b",), {}),
    "scale": (0.5, {}),
    "frames": ("1::2", {}),
    "offsets": ({"b": 1}, {"frames": "1:2", "masks": "none"}),
    "size_rule": ("stretch", {"size_rule": "crop", "rig": "wide"}),
}
"""Another value of each setting, and what else has to be set for it to matter. What is seen: see `shown`."""

OTHERWISE = {"rig", "mask_model", "set"}
"""Settings with tests of their own."""


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory, make: SimpleNamespace) -> Path:
    """Three cameras: a performer with a shadow and a ball, cut out of a set; before a green screen; and as videos."""
    folder = tmp_path_factory.mktemp("captures")
    rng = np.random.default_rng(3)
    plate = np.repeat(np.repeat(rng.integers(110, 150, (8, 12, 3)), 8, 0), 8, 1).astype(np.uint8)
    root = folder / "plain"
    for number, camera in enumerate("abc"):
        make.image(root / "clean_plates" / f"{camera}.png", plate)
        make.image(root / "other_plates" / f"{camera}.png", np.full_like(plate, 230))
        make.image(root / "other_masks" / f"{camera}.png", np.full((HEIGHT, WIDTH), 255, np.uint8))
        labels = np.zeros((HEIGHT, WIDTH), np.uint8)
        labels[10:44, 30:50], labels[20:30, 70:80] = 7, 8
        make.image(root / "labels" / f"{camera}.png", labels)
        for frame in range(4):
            image = plate.copy()
            image[44:56, 10:60] = plate[44:56, 10:60] * 0.6
            image[10 + frame : 44, 30:50] = (200, 40 * number, 60)
            image[20:30, 70:80] = (30, 60, 220)
            inside = np.zeros((HEIGHT, WIDTH), np.uint8)
            inside[10 + frame : 44, 30:50] = 255
            make.image(root / "images" / camera / f"{frame}.png", image)
            make.image(root / "other_images" / camera / f"{frame}.png", image[:, ::-1])
            make.image(root / "masks" / camera / f"{frame}.png", inside)
            green = np.full((HEIGHT, WIDTH, 3), (60, 190, 80), np.uint8)
            green[10:50, 28:60] = (150, 190, 130)  # spill
            green[12:48, 30:58] = (220, 180, 170)
            green[30:40, 36:50] = (230, 50, 25)
            make.image(folder / "screen" / "images" / camera / f"{frame}.png", green)
        if number < 2:
            make.video(folder / "video" / "videos" / f"{camera}.mp4", [image, image])
    (root / "garbage.yaml").write_text("a: {remove: [[[0, 0], [40, 0], [40, 64], [0, 64]]]}")
    for model in ("free.onnx", "fixed.onnx"):
        shutil.copy(MODELS / model, root)
    write_wav(root / "a.wav", clicks(1.0, []))
    return folder


def shown(captures: Path, make: SimpleNamespace, **values: Any) -> str:
    """Digest of what the footage says and shows, or the code of its error."""
    values = {"root": "plain", **values}
    wide = values.pop("rig", "") == "wide"
    spec = CaptureSettings(**{**values, "root": captures / values["root"]})
    rig = Rig(tuple(make.camera(name, 128, HEIGHT) for name in "abc")) if wide else None
    try:
        footage = open_footage(spec, rig)
        parts: list[Any] = [footage.camera_names, footage.held_out_cameras, footage.frames, footage.fps]
        parts += [] if footage.sound is None else [footage.sound.path, footage.sound.start]
        parts += [camera.K.tolist() for camera in footage.rig] if wide else []
        digest = hashlib.sha256(repr(parts).encode())
        for camera in footage.camera_names:
            for seen in (footage.image, footage.mask, footage.evaluation_mask):
                digest.update(seen(camera, footage.frames[0]).tobytes())
            plate = footage.plate(camera)
            digest.update(b"" if plate is None else plate.tobytes())
    except StudioError as error:
        return error.code
    return digest.hexdigest()


def test_rig_chooses_the_camera_file(captures: Path) -> None:
    root = captures / "plain"
    (root / "mine.json").touch()
    files = [camera_file(CaptureSettings(root=root, rig=rig)) for rig in ("auto", "mine.json")]
    assert files == [None, root / "mine.json"]


def test_mask_model_chooses_the_file(captures: Path) -> None:
    """Both models give the same masks."""
    root, names = captures / "plain", ("free.onnx", "fixed.onnx")
    specs = [CaptureSettings(root=root, masks="model", mask_model=f"plain:{name}") for name in names]
    assert [open_footage(spec).mask_source.files() for spec in specs] == [[root / name] for name in names]


def test_there_is_a_row_for_every_setting() -> None:
    assert sorted([*CHANGES, *OTHERWISE]) == sorted(affected(CaptureSettings))


@pytest.mark.parametrize("name", CHANGES)
def test_the_setting_changes_the_footage(name: str, captures: Path, make: SimpleNamespace) -> None:
    value, others = CHANGES[name]
    before = shown(captures, make, **others)
    assert len(before) == 64, f"{before}: the footage can be read before the change"
    after = shown(captures, make, **{**others, name: value})
    assert len(after) == 64, after
    assert after != before
