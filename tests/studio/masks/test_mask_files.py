"""Masks as other programs write them: the same mask in many encodings, and captures in which some are missing."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.studio.capture.test_transfer import exr as write_exr
from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.checks import check_footage
from v3studio.studio.yaml_text import parse_yaml

WIDTH, HEIGHT = 96, 64
INSIDE = np.zeros((HEIGHT, WIDTH), bool)
INSIDE[16:48, 30:60] = True
SECOND = INSIDE & (np.arange(WIDTH) >= 45)  # another person
LABELS = INSIDE.astype(np.uint8) + SECOND
SOFT = cv2.GaussianBlur(np.where(INSIDE, 255, 0).astype(np.uint8), (0, 0), 2.5)

Write = Callable[[Path], None]


def pillow(values: np.ndarray, mode: str | None = None, **options: object) -> Write:
    return lambda path: Image.fromarray(values, mode).save(path, **options)


def opencv(values: np.ndarray) -> Write:
    return lambda path: path.write_bytes(cv2.imencode(path.suffix, values)[1].tobytes())


def palette(indices: np.ndarray, colors: list[int], **options: object) -> Write:
    def write(path: Path) -> None:
        image = Image.fromarray(indices, "P")
        image.putpalette(colors)
        image.save(path, **options)

    return write


def exr(values: np.ndarray) -> Write:
    return lambda path: write_exr(path, np.atleast_3d(values).astype(np.float32))


GRAYS = [value for index in range(256) for value in (index, index, index)]
ONE = INSIDE.astype(np.uint8)
WITHIN = cv2.erode(ONE, np.ones((3, 3), np.uint8))
RED = np.where(INSIDE[..., None], (128, 0, 0), 0).astype(np.uint8)

ENCODINGS: dict[str, tuple[str, Write]] = {
    "0 and 255": (".png", pillow(ONE * 255)),
    "0 and 255, capitals": (".PNG", pillow(ONE * 255)),
    "0 and 1": (".png", pillow(ONE)),
    "0 and 1, TIFF": (".tif", pillow(ONE)),
    "0 and 1, capitals, TIFF": (".TIFF", pillow(ONE)),
    "0 and 1, BMP": (".bmp", pillow(ONE)),
    "one bit": (".png", pillow(INSIDE)),
    "one bit, TIFF": (".tif", pillow(INSIDE)),
    "16 bits, 0 and 1": (".png", pillow(ONE.astype(np.uint16))),
    "16 bits, 0 and 255": (".png", pillow(ONE.astype(np.uint16) * 255)),
    "16 bits, 0 and 65535": (".png", pillow(ONE.astype(np.uint16) * 65535)),
    "16 bits, 0 and 65535, TIFF": (".tif", pillow(ONE.astype(np.uint16) * 65535)),
    "16 bits, instances as in Cityscapes": (".png", pillow((LABELS.astype(np.uint16) + 24000) * INSIDE)),
    "16 bits of color, 0 and 1": (".png", opencv(np.dstack([ONE.astype(np.uint16)] * 3))),
    "32 bits": (".tif", pillow(ONE.astype(np.int32))),
    "floats, TIFF": (".tif", pillow(ONE.astype(np.float32))),
    "floats to 255, TIFF": (".tif", pillow(ONE.astype(np.float32) * 255)),
    "floats of color, TIFF": (".tiff", opencv(np.dstack([ONE.astype(np.float32)] * 3))),
    "floats, EXR": (".exr", exr(ONE)),
    "object index, EXR": (".exr", exr(LABELS)),
    "alpha, EXR": (".exr", exr(np.dstack([ONE * 0.2] * 3 + [ONE]))),
    "instance 30": (".png", pillow(ONE * 30)),
    "two people": (".png", pillow(LABELS)),
    "two people of 127 and 255": (".png", pillow(np.array([0, 127, 255], np.uint8)[LABELS])),
    "a person and its outline as 255, as in VOC": (".png", pillow(np.where(WITHIN > 0, 1, ONE * 255).astype(np.uint8))),
    "palette, dark red": (".png", palette(ONE, [0, 0, 0, 128, 0, 0])),
    "palette, two colors": (".png", palette(LABELS, [0, 0, 0, 128, 0, 0, 0, 128, 0])),
    "palette, white": (".png", palette(ONE, [0, 0, 0, 255, 255, 255])),
    "palette, white is first": (".png", palette(1 - ONE, [255, 255, 255, 0, 0, 0])),
    "palette of grays": (".png", palette(ONE, GRAYS)),
    "palette, black performer": (".png", palette(ONE, [200, 200, 200, 0, 0, 0])),
    "palette, transparent background": (".png", palette(ONE, [255, 0, 255, 9, 9, 9], transparency=0)),
    "palette, TIFF": (".tif", palette(ONE, [0, 0, 0, 128, 0, 0])),
    "dark red": (".png", pillow(RED)),
    "white with alpha": (".png", pillow(np.dstack([np.full((HEIGHT, WIDTH, 3), 255, np.uint8), ONE * 255]))),
    "cut out": (".png", pillow(np.dstack([RED, ONE * 255]))),
    "gray and alpha": (".png", pillow(np.dstack([ONE * 90, ONE * 255]), "LA")),
    "opaque": (".png", pillow(np.dstack([ONE * 255] * 3 + [np.full_like(ONE, 255)]))),
    "WebP": (".webp", pillow(ONE * 255, lossless=True)),
    "JPEG": (".jpg", pillow(ONE * 255, quality=95)),
}


def capture(
    root: Path, make: SimpleNamespace, extension: str, write: Write, cameras: str = "ab", masked: str = "abcdef"
) -> Path:
    """Two frames of these cameras, with masks for those in `masked`."""
    for camera in cameras:
        (root / "masks" / camera).mkdir(parents=True)
        for frame in range(2):
            make.image(root / "images" / camera / f"{frame}.png", make.numbered(frame))
            if camera in masked:
                write(root / "masks" / camera / f"{frame}{extension}")
    return root


@pytest.mark.parametrize("name", ENCODINGS)
def test_encodings(tmp_path: Path, make: SimpleNamespace, name: str) -> None:
    footage = open_footage(CaptureSettings(root=capture(tmp_path, make, *ENCODINGS[name])))
    mask = footage.mask("a", 1)
    assert np.array_equal(mask > 127, INSIDE)
    assert set(np.unique(mask)) == {0, 255} or name == "JPEG"
    assert footage.warnings == []
    assert check_footage(footage) == []


@pytest.mark.parametrize(
    ("extension", "write"),
    [
        *((".png", pillow(values)) for values in (SOFT, SOFT.astype(np.uint16), SOFT.astype(np.uint16) * 257)),
        (".tif", pillow(SOFT.astype(np.float32) / 255)), (".tif", pillow(SOFT.astype(np.float32))),
        (".exr", exr(SOFT / 255)), (".png", pillow(np.dstack([SOFT * 0, SOFT]), "LA")),
        (".png", palette(255 - SOFT, GRAYS[::-1])),
    ],
)  # fmt: skip
def test_soft_masks_stay_soft(tmp_path: Path, make: SimpleNamespace, extension: str, write: Write) -> None:
    footage = open_footage(CaptureSettings(root=capture(tmp_path, make, extension, write)))
    assert np.abs(footage.mask("a", 0).astype(int) - SOFT).max() <= 1
    assert "soft" in footage.description


def test_chosen_labels(tmp_path: Path, make: SimpleNamespace) -> None:
    root = capture(tmp_path, make, ".png", palette(LABELS, [0, 0, 0, 128, 0, 0, 0, 128, 0]))
    footage = open_footage(CaptureSettings(root=root, mask_labels=(2,)))
    assert np.array_equal(footage.mask("a", 0) > 0, SECOND)
    with refuses("mask.no_label", setting="capture.mask_labels"):
        open_footage(CaptureSettings(root=root, mask_labels=(3,)))
    soft = capture(tmp_path / "soft", make, ".png", pillow(SOFT))
    with refuses("mask.no_label", setting="capture.mask_labels"):
        open_footage(CaptureSettings(root=soft, mask_labels=(1,)))


@pytest.mark.parametrize(
    ("write", "code"),
    [(pillow(255 - ONE * 255), "mask.inverted"), (pillow((SOFT * 0.3).astype(np.uint8)), "mask.weak")],
)
def test_masks_that_look_wrong(tmp_path: Path, make: SimpleNamespace, write: Write, code: str) -> None:
    spec = CaptureSettings(root=capture(tmp_path, make, ".png", write))
    for kind in ("auto", "none"):  # those of the evaluation, too
        warnings = open_footage(spec.replace(masks=kind), evaluation_masks="masks/{camera}/{frame}.png").warnings
        assert {warning.code for warning in warnings} == {code}
        assert warnings[0].fields["cameras"] == ("a", "b")


@pytest.mark.parametrize(
    "write",
    [
        pillow(255 - ONE * 255), pillow(255 - SOFT), pillow(1 - ONE), pillow(9 - 9 * ONE), pillow(1 + ONE),
        pillow(np.where(INSIDE, 255, 1).astype(np.uint8)), pillow(1000 * (1 + ONE.astype(np.uint16))),
    ],
)  # fmt: skip
def test_masks_can_be_inverted(tmp_path: Path, make: SimpleNamespace, write: Write) -> None:
    """Masks are read as the warning advises."""
    spec = CaptureSettings(root=capture(tmp_path, make, ".png", write))
    (warning,) = open_footage(spec).warnings
    advice = warning.fix.split("capture.mask_labels to ")[1].rstrip(".")
    footage = open_footage(spec.replace(mask_labels=parse_yaml(advice)))
    assert ((footage.mask("a", 0) > 127) != INSIDE).mean() < 0.01  # but for soft corners
    assert footage.warnings == []


def test_masks_that_cannot_be_read_are_named(tmp_path: Path, make: SimpleNamespace) -> None:
    capture(tmp_path, make, ".npy", lambda path: np.save(path, ONE))
    assert "'masks'" in open_footage(CaptureSettings(root=tmp_path)).description
    with refuses("mask.not_found"):
        open_footage(CaptureSettings(root=tmp_path, masks="files"))


def test_cameras_without_masks_are_named_with_a_setting_that_works(tmp_path: Path, make: SimpleNamespace) -> None:
    root = capture(tmp_path, make, ".png", pillow(ONE), "abcdef", masked="acdf")
    with refuses("mask.missing", cameras=("b", "e"), setting="capture.cameras") as caught:
        open_footage(CaptureSettings(root=root, masks="files"))
    advice = str(caught.value).split("capture.cameras to ")[1].rstrip(".")
    assert open_footage(CaptureSettings(root=root, cameras=parse_yaml(advice))).camera_names == tuple("acdf")
    footage = open_footage(CaptureSettings(root=root))
    assert footage.camera_names == tuple("acdf")
    assert "'b' and 'e'" in footage.description
    with refuses("mask.missing", cameras=("e",), camera="e"):
        open_footage(CaptureSettings(root=root, masks="files", cameras=("a", "c", "e")))


def test_a_few_cameras_with_masks_are_not_the_capture(tmp_path: Path, make: SimpleNamespace) -> None:
    root = capture(tmp_path, make, ".png", pillow(ONE), "abcd", masked="d")
    with refuses("mask.missing", cameras=("a", "b", "c")):
        open_footage(CaptureSettings(root=root))


@pytest.mark.parametrize("form", ["segmentation/{c}.png", "sam/v2/{c}_fg.png"])
def test_masks_that_transforms_json_names(tmp_path: Path, make: SimpleNamespace, form: str) -> None:
    names = [f"cam{index}" for index in range(3)]
    frames = [{"file_path": f"images/{name}.png", "mask_path": form.format(c=name)} for name in names]
    for files in frames:
        make.image(tmp_path / files["file_path"], make.numbered(1))
        make.image(tmp_path / files["mask_path"], ONE * 255)
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    footage = open_footage(CaptureSettings(root=tmp_path))
    np.testing.assert_array_equal(footage.mask("cam1", 0) > 127, INSIDE)
    assert form.format(c="{camera}") in footage.description


def test_an_opaque_alpha_channel_is_no_mask(tmp_path: Path, make: SimpleNamespace) -> None:
    root = capture(tmp_path, make, ".png", pillow(ONE))
    for file in (root / "images").glob("*/*.png"):
        Image.open(file).convert("RGBA").save(file)
    assert np.array_equal(open_footage(CaptureSettings(root=root)).mask("a", 0) > 0, INSIDE)
    assert "opaque" in open_footage(CaptureSettings(root=root, masks="alpha")).description


def test_masks_of_objects_are_joined(tmp_path: Path, make: SimpleNamespace) -> None:
    """A folder per object, as video segmentation writes them; one appears later, and one file per object as well."""
    root = capture(tmp_path, make, ".png", pillow(ONE * 255))
    for path in sorted((root / "masks").rglob("*.png")):
        for number, part in enumerate((INSIDE & ~SECOND, SECOND)):
            target = path.parent / f"{number:03d}" / path.name
            target.parent.mkdir(exist_ok=True)
            Image.fromarray(np.where(part, 255, 0).astype(np.uint8)).save(target)
        path.unlink()
    footage = open_footage(CaptureSettings(root=root))
    assert "2 objects" in footage.description
    for camera in footage.camera_names:
        assert ((footage.mask(camera, footage.frames[0]) > 127) == INSIDE).all()


@pytest.mark.parametrize("frames", [None, ":3"])
def test_masks_from_0_beside_images_from_1(tmp_path: Path, make: SimpleNamespace, frames: str | None) -> None:
    for frame in range(4):
        for camera in ("a", "b"):
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[20:40, 10 * frame : 10 * frame + 20] = 255
            make.image(tmp_path / f"images/{camera}/{frame + 1:04d}.png", make.numbered(frame))
            make.image(tmp_path / f"masks/{camera}/{frame:04d}.png", mask)
    footage = open_footage(CaptureSettings(root=tmp_path, frames=frames))
    for frame in footage.frames:
        assert np.flatnonzero(footage.mask("a", frame)[30] > 127)[0] == 10 * (frame - 1)
    (tmp_path / "masks/a/0003.png").unlink()
    with refuses("mask.other_numbers", camera="a"):
        open_footage(CaptureSettings(root=tmp_path, frames=":3"))
