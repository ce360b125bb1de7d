"""Matting models: tiny models whose mask is 0.25 R + 0.5 G + 0.25 B of their input (data/README.md)."""

import importlib.util
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.checks import check_footage
from v3studio.studio.masks import FunctionMaskSource
from v3studio.studio.masks.matting_model import KINDS, Kind, MattingModel, largest_components, preprocess, providers

DATA = Path(__file__).parent / "data"


def noisy(height: int = 64, width: int = 96, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def model_of(file: Path, kind: str = "plain") -> MattingModel:
    return MattingModel(file, kind, device="cpu")


def weighted(values: np.ndarray) -> np.ndarray:
    """The output of the models."""
    return values.astype(np.float64) @ np.array([0.25, 0.5, 0.25])


def test_the_mask_is_the_first_output_of_one_channel() -> None:
    """The first output of free.onnx is the mean per channel, which is not an image."""
    image = noisy()
    mask = model_of(DATA / "free.onnx")(image)
    assert mask.shape == (64, 96)
    assert np.abs(mask - weighted(image / 255)).max() < 1e-6


def test_a_lite_model_has_the_same_mask() -> None:
    """A model without onnxruntime, at the size of its kind."""
    image, model = noisy(256, 256), MattingModel(DATA / "lite.tflite", "selfie")
    assert np.abs(model(image) - weighted(image / 255)).max() < 1e-6
    assert model(image[:100]).shape == (100, 256)


def test_normalization_and_sigmoid(monkeypatch: pytest.MonkeyPatch) -> None:
    image = noisy()
    monkeypatch.setitem(KINDS, "plain", Kind((0.5, 0.4, 0.3), (0.5, 0.25, 0.2), 0, logits=True))
    seen = (image / 255 - [0.5, 0.4, 0.3]) / [0.5, 0.25, 0.2]
    mask = model_of(DATA / "free.onnx")(image)
    assert np.abs(mask - 1 / (1 + np.exp(-weighted(seen)))).max() < 1e-6
    assert preprocess(image, (96, 64), KINDS["plain"])[0].transpose(1, 2, 0) == pytest.approx(seen, abs=1e-5)


@pytest.mark.parametrize(("file", "wanted"), [("fixed.onnx", 0), ("free.onnx", 128)])
def test_images_are_resized_for_models_and_masks_back(file: str, wanted: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Away from the border a linear ramp is invariant to both resizes, whatever the sizes."""
    columns = np.broadcast_to((np.arange(300) + 0.5) / 300, (150, 300))
    image = np.repeat(np.rint(255 * columns)[..., None], 3, axis=2).astype(np.uint8)
    monkeypatch.setitem(KINDS, "plain", replace(KINDS["plain"], side=wanted))
    mask = model_of(DATA / file)(image)
    assert mask.shape == (150, 300)
    assert np.abs(mask - columns)[:, 8:-8].max() < 0.004


@pytest.mark.parametrize(
    ("file", "code", "value"),
    [
        ("recurrent.onnx", "mask.model_inputs", ("picture", "before")),
        ("no_matte.onnx", "mask.model_outputs", "1x3"),
        ("channels_last.onnx", "mask.model_inputs", "tensor(float) 1xhxwx3"),
    ],
)
def test_models_that_are_not_matting_models(file: str, code: str, value: object) -> None:
    with refuses(code, file=DATA / file, value=value, setting="capture.mask_model"):
        model_of(DATA / file)(noisy())


def test_files_that_are_missing_or_broken(tmp_path: Path) -> None:
    with refuses("mask.model_missing", file=tmp_path / "nowhere.onnx", setting="capture.mask_model"):
        MattingModel(tmp_path / "nowhere.onnx")
    for file, kind in (("free.onnx", "plain"), ("lite.tflite", "selfie")):
        broken = tmp_path / file
        broken.write_bytes((DATA / file).read_bytes()[:100])
        with refuses("mask.model_unloadable", file=broken, setting="capture.mask_model"):
            model_of(broken, kind)(noisy())


def test_values_outside_0_to_1() -> None:
    """A mean and standard deviation that differ from the model's, or logits."""
    with refuses("mask.model_values", file=DATA / "free.onnx", setting="capture.mask_model") as caught:
        MattingModel(DATA / "free.onnx", device="cpu")(noisy())
    low, high = caught.value.value
    assert low < 0 < 1 < high


def test_without_onnxruntime_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with refuses("mask.runtime_missing", file=DATA / "free.onnx", package="onnxruntime"):
        MattingModel(DATA / "free.onnx")


def test_execution_providers() -> None:
    both = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    assert providers("cpu", both) == ["CPUExecutionProvider"]
    assert providers("auto", both[1:]) == ["CPUExecutionProvider"]
    assert providers("auto", both)[0] == ("CUDAExecutionProvider", {"device_id": 0})
    assert providers("cuda:1", both)[0] == ("CUDAExecutionProvider", {"device_id": 1})
    with refuses("mask.no_cuda", value="cuda", setting="run.device"):
        providers("cuda", both[1:])


@pytest.fixture
def capture(tmp_path: Path, make: SimpleNamespace) -> Path:
    for frame in range(2):
        for camera in ("a", "b"):
            make.image(tmp_path / "images" / camera / f"{frame}.png", noisy(seed=frame))
    shutil.copy(DATA / "free.onnx", tmp_path / "model.onnx")
    return tmp_path


def spec_of(root: Path, mask_model: str | None = "plain:model.onnx", **values: object) -> CaptureSettings:
    return CaptureSettings(root=root, masks="model", mask_model=mask_model, **values)  # type: ignore[arg-type]


def test_a_capture_with_a_model(capture: Path, make: SimpleNamespace) -> None:
    exact = np.rint(255 * weighted(noisy(seed=1) / 255))
    footage = open_footage(spec_of(capture))
    assert "matting model model.onnx" in footage.description
    assert np.abs(footage.mask("b", 1) - exact).max() <= 1  # rounding of .5
    absolute = open_footage(spec_of(capture, mask_model=f"plain:{capture / 'model.onnx'}"))
    assert np.array_equal(absolute.mask("b", 1), footage.mask("b", 1))
    kept = np.zeros((64, 96), np.uint8)
    kept[:30] = 255
    make.image(capture / "garbage" / "b.png", kept)
    inside = open_footage(spec_of(capture, garbage_masks="garbage/{camera}.png"))
    assert inside.mask("b", 1)[30:].max() == 0
    assert np.array_equal(inside.mask("b", 1)[:30], footage.mask("b", 1)[:30])
    with refuses("mask.model_not_set", setting="capture.mask_model"):
        open_footage(spec_of(capture, mask_model=None))


def test_masks_are_computed_once_per_model(capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compute, cache = Mock(side_effect=MattingModel.__call__), capture / "cache"
    monkeypatch.setattr(MattingModel, "__call__", lambda *given: compute(*given))

    def mask(threads: int = 0, **values: object) -> np.ndarray:
        footage = open_footage(spec_of(capture, **values), cache_folder=cache, device="cpu", threads=threads)
        return footage.mask("a", 0)

    first = mask()
    for threads in (0, 1):  # they do not affect the masks
        assert np.array_equal(mask(threads), first)
        assert compute.call_count == 1
    (file,) = (cache / "masks").iterdir()
    file.write_bytes(file.read_bytes()[:200])  # truncated: recomputed
    assert np.array_equal(mask(), first)
    assert compute.call_count == 2
    mask(mask_model="birefnet:model.onnx")
    assert compute.call_count == 3
    shutil.copy(DATA / "fixed.onnx", capture / "model.onnx")
    mask()
    assert compute.call_count == 4


def test_a_function_that_fails_names_camera_frame_and_line() -> None:
    def failing(image: np.ndarray, camera: str, frame: int) -> np.ndarray:
        raise KeyError(camera, frame)

    source = FunctionMaskSource(failing)
    assert source.files() == [Path(__file__)], "changing the function makes a take stale"
    with refuses("mask.function_failed", file=Path(__file__), camera="a", frame=3) as caught:
        source.mask("a", 3, noisy())
    assert isinstance(caught.value.__cause__, KeyError)
    assert "KeyError: ('a', 3)" in caught.value.problem


@pytest.mark.parametrize(
    ("returned", "value"),
    [
        (np.zeros((4, 4)), "(4, 4) float64"),
        (np.zeros((64, 96), np.int64), "(64, 96) int64"),
        (np.eye(64, 96, dtype=np.uint8), 1),
        (np.full((64, 96), np.nan), None),
        (np.full((64, 96), 255.0), (255, 255)),
    ],
)
def test_functions_that_do_not_return_a_mask(returned: np.ndarray, value: object) -> None:
    with refuses("mask.function_output", file=Path(__file__), value=value, camera="a", frame=3) as caught:
        FunctionMaskSource(lambda *_: returned).mask("a", 3, noisy())
    assert caught.value.problem.startswith("<lambda>, ")


def test_only_the_largest_component_is_kept() -> None:
    mask = cv2.GaussianBlur(cv2.circle(np.zeros((64, 96)), (30, 30), 14, 1.0, -1), (0, 0), 1)
    both = mask.copy()
    both[50:60, 80:90] = 1.0
    wanted, given = (np.rint(255 * alpha).astype(np.uint8) for alpha in (mask, both))
    assert np.array_equal(largest_components(given, 1), wanted)


MODULE = """
import numpy as np
import v3studio as v3

def plain(image, camera, frame):
    return image.mean(axis=2) / 255

bright = v3.FunctionMaskSource(plain)

@v3.FunctionMaskSource
def of_some(image, camera, frame):
    return plain(image, camera, frame) if camera != "cam2" else None

of_some.cameras = ["cam1", "cam10", "another"]
by_call = v3.FunctionMaskSource(plain, files=[__file__ + ".txt"])

@v3.FunctionMaskSource(files=[__file__ + ".txt"])
def reads_a_file(image, camera, frame):
    return plain(image, camera, frame)

class Constant:
    def mask(self, camera, frame, image):
        return np.full(image.shape[:2], 255, np.uint8)

    def files(self):
        return []

constant = Constant()
in_no_module = [v3.FunctionMaskSource(plain)]
of_none = v3.FunctionMaskSource(lambda *_: None)
of_none.cameras = ["another"]
"""


def test_a_source_by_import_path(three_videos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = tmp_path / "own_masks_of_a_test.py"
    module.write_text(MODULE)

    def settings(name: str = "bright", **values: object) -> CaptureSettings:
        return CaptureSettings(root=three_videos, masks=f"{module.stem}:{name}", **values)  # type: ignore[arg-type]

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    for entry in ("", str(tmp_path)):  # the first is that of an interactive Python
        monkeypatch.syspath_prepend(entry)
        with refuses("mask.cannot_import", value=settings().masks):
            open_footage(settings())  # what lies in the working directory is not run: it may be anybody's
    monkeypatch.chdir(tmp_path.parent)
    footage = open_footage(settings())
    assert np.abs(footage.mask("cam1", 6) - footage.image("cam1", 6).mean(axis=2)).max() <= 0.5
    assert module in footage.files()
    for name in ("plain", "nothing", "np"):
        with refuses("mask.not_a_source"):
            open_footage(settings(name))
    some = open_footage(settings("of_some"))
    assert some.camera_names == ("cam1", "cam10")
    assert "'cam2'" in some.description
    held_out = open_footage(settings("of_some", held_out=("cam2", "cam10")))
    assert (held_out.camera_names, held_out.measured_cameras) == (("cam1", "cam2", "cam10"), ("cam10",))
    asked = {problem.fields["camera"] for problem in check_footage(held_out)}
    assert asked == {"cam1", "cam10"}, "the mask of frame 0 is empty; cam2 has none"
    with refuses("mask.missing", camera="cam2"):
        held_out.mask("cam2", 6)
    with refuses("mask.no_camera", value=f"{module.stem}:of_none"):
        open_footage(settings("of_none"))
    own = importlib.import_module(module.stem)
    for name in ("bright", "by_call", "reads_a_file", "constant"):  # the object stands for its path
        assert CaptureSettings(masks=getattr(own, name)).masks == f"{module.stem}:{name}"
    assert own.reads_a_file.files() == own.by_call.files() == [module, module.with_name(f"{module.name}.txt")]
    with refuses("settings.invalid", setting="masks"):
        CaptureSettings(masks=own.in_no_module[0])
    with refuses("mask.cannot_import"):
        open_footage(CaptureSettings(root=three_videos, masks="no_such_module_here:bright"))
