"""Masks from matting models: tiny models whose matte is 0.25 R + 0.5 G + 0.25 B of what they see (data/README.md)."""

import builtins
import importlib.util
import shutil
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from studio.capture import CaptureSpec, FunctionMatteSource, open_footage
from studio.capture.mattes.matte_cache import MatteCache
from studio.capture.mattes.onnx_model import OnnxModel, OnnxSettings, first_picture, input_size, prepared, providers
from studio.errors import StudioError

DATA = Path(__file__).parent / "data"
PLAIN = OnnxSettings(mean=(0.0, 0.0, 0.0), std=(1.0, 1.0, 1.0), device="cpu")


def noisy(height: int = 64, width: int = 96, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def weighted(values: np.ndarray) -> np.ndarray:
    """What the models compute."""
    return values.astype(np.float64) @ np.array([0.25, 0.5, 0.25])


def test_the_matte_is_the_models_output_that_is_a_picture() -> None:
    """free.onnx gives the channels' means first, which are no picture."""
    image = noisy()
    matte = OnnxModel(DATA / "free.onnx", PLAIN)(image)
    assert matte.shape == (64, 96)
    assert np.abs(matte - weighted(image / 255)).max() < 1e-6


def test_normalization_and_sigmoid() -> None:
    image = noisy()
    settings = OnnxSettings(mean=(0.5, 0.4, 0.3), std=(0.5, 0.25, 0.2), sigmoid=True, device="cpu")
    seen = (image / 255 - [0.5, 0.4, 0.3]) / [0.5, 0.25, 0.2]
    matte = OnnxModel(DATA / "free.onnx", settings)(image)
    assert np.abs(matte - 1 / (1 + np.exp(-weighted(seen)))).max() < 1e-6
    assert prepared(image, (96, 64), settings)[0].transpose(1, 2, 0) == pytest.approx(seen, abs=1e-5)


@pytest.mark.parametrize(("file", "wanted"), [("fixed.onnx", 0), ("fixed.onnx", 96), ("free.onnx", 128)])
def test_pictures_are_resized_for_the_model_and_mattes_back(file: str, wanted: int) -> None:
    """A ramp over a picture survives both resizes away from its border, whatever the sizes are."""
    columns = np.broadcast_to((np.arange(300) + 0.5) / 300, (150, 300))
    image = np.repeat(np.rint(255 * columns)[..., None], 3, axis=2).astype(np.uint8)
    settings = OnnxSettings(wanted, PLAIN.mean, PLAIN.std, device="cpu")
    matte = OnnxModel(DATA / file, settings)(image)
    assert matte.shape == (150, 300)
    assert np.abs(matte - columns)[:, 8:-8].max() < 0.004


def test_input_sizes() -> None:
    path = Path("m.onnx")
    assert input_size(path, 0, (None, None), 1920, 1080) == (1920, 1088)
    assert input_size(path, 512, (None, None), 1920, 1080) == (512, 288)
    assert input_size(path, 512, (None, None), 1080, 1920) == (288, 512)
    assert input_size(path, 64, (None, None), 1000, 10) == (64, 32)
    assert input_size(path, 0, (1024, 1024), 1920, 1080) == (1024, 1024)
    with pytest.raises(StudioError, match=r"has fixed its pictures to 320x320, but capture.mask_model_size is 512"):
        input_size(path, 512, (320, 320), 1920, 1080)


def test_first_picture() -> None:
    vector, small, matte = np.zeros((1, 8)), np.zeros((1, 1, 1, 1)), np.ones((1, 1, 4, 6))
    color, classes = np.zeros((1, 3, 4, 6)), np.zeros((2, 4, 6))
    found = first_picture([vector, small, color, classes, matte, 0 * matte])
    assert found is not None
    assert found.shape == (4, 6)
    assert found.min() == 1
    assert first_picture([vector, color]) is None


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("recurrent.onnx", r"wants 2 inputs \(picture, before\); only models that see one picture at a time"),
        ("no_matte.onnx", r"gives 1x3; one output must be a matte, 1x1xHxW"),
        ("channels_last.onnx", r"wants tensor\(float\) 1xhxwx3; it must be floats, 1x3xHxW"),
    ],
)
def test_models_that_are_no_matting_models(file: str, words: str) -> None:
    with pytest.raises(StudioError, match=words):
        OnnxModel(DATA / file, PLAIN)(noisy())


def test_files_that_are_missing_or_broken(tmp_path: Path) -> None:
    with pytest.raises(StudioError, match=r"nowhere.onnx is not there; give its ONNX file in capture.mask_model"):
        OnnxModel(tmp_path / "nowhere.onnx")
    broken = tmp_path / "broken.onnx"
    broken.write_bytes((DATA / "free.onnx").read_bytes()[:100])
    with pytest.raises(StudioError, match=r"broken.onnx cannot be loaded \(.*give a whole ONNX file"):
        OnnxModel(broken, PLAIN)(noisy())


def test_values_that_are_no_matte() -> None:
    """Another mean and deviation than the model's, or logits."""
    with pytest.raises(StudioError, match=r"gives values from -.*set capture.mask_model_sigmoid to true"):
        OnnxModel(DATA / "free.onnx", OnnxSettings(device="cpu"))(noisy())


def test_without_onnxruntime_the_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(StudioError, match=r"pip install 'v3studio\[matting\]'"):
        OnnxModel(DATA / "free.onnx")


def test_what_models_run_on() -> None:
    both = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    assert providers("cpu", both) == ["CPUExecutionProvider"]
    assert providers("auto", both[1:]) == ["CPUExecutionProvider"]
    assert providers("auto", both)[0] == ("CUDAExecutionProvider", {"device_id": 0})
    assert providers("cuda:1", both)[0] == ("CUDAExecutionProvider", {"device_id": 1})
    with pytest.raises(StudioError, match="the installed onnxruntime has no CUDA"):
        providers("cuda", both[1:])


@pytest.fixture
def capture(tmp_path: Path, make: SimpleNamespace) -> Path:
    for frame in range(2):
        for camera in ("a", "b"):
            make.image(tmp_path / "images" / camera / f"{frame}.png", noisy(seed=frame))
    shutil.copy(DATA / "free.onnx", tmp_path / "model.onnx")
    return tmp_path


def spec_of(root: Path, **values: object) -> CaptureSpec:
    given = {"mask_model": "model.onnx", "mask_model_mean": PLAIN.mean, "mask_model_std": PLAIN.std, **values}
    return CaptureSpec(root, masks="model", mask_device="cpu", **given)  # type: ignore[arg-type]


def test_a_capture_with_a_model(capture: Path, make: SimpleNamespace) -> None:
    exact = np.rint(255 * weighted(noisy(seed=1) / 255))
    footage = open_footage(spec_of(capture))
    assert "by the model model.onnx" in footage.description
    assert np.abs(footage.matte("b", 1) - exact).max() <= 1  # rounding of .5
    absolute = open_footage(spec_of(capture, mask_model=str(capture / "model.onnx")))
    assert np.array_equal(absolute.matte("b", 1), footage.matte("b", 1))
    kept = np.zeros((64, 96), np.uint8)
    kept[:30] = 255
    make.image(capture / "garbage" / "b.png", kept)
    inside = open_footage(spec_of(capture, garbage_mattes="garbage/{camera}.png"))
    assert inside.matte("b", 1)[30:].max() == 0
    assert np.array_equal(inside.matte("b", 1)[:30], footage.matte("b", 1)[:30])
    with pytest.raises(StudioError, match="none is given; set mask_model"):
        open_footage(spec_of(capture, mask_model=""))
    with pytest.raises(StudioError, match="mask_model_size is 500; it must be a multiple of 32"):
        spec_of(capture, mask_model_size=500)


def test_another_model_is_another_footage(capture: Path) -> None:
    before = open_footage(spec_of(capture)).digest()
    assert open_footage(spec_of(capture)).digest() == before
    shutil.copy(DATA / "fixed.onnx", capture / "model.onnx")
    assert open_footage(spec_of(capture)).digest() != before


def test_mattes_are_made_once_and_again_for_another_model(capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    compute = OnnxModel.__call__

    def counted(self: OnnxModel, image: np.ndarray, /) -> np.ndarray:
        made.append(1)
        return compute(self, image)

    monkeypatch.setattr(OnnxModel, "__call__", counted)
    cache = capture / "cache"

    def matte(**values: object) -> np.ndarray:
        return open_footage(spec_of(capture, **values), cache_folder=cache).matte("a", 0)

    first = matte()
    assert np.array_equal(matte(), first)
    assert len(made) == 1
    assert np.array_equal(matte(mask_threads=1), first)  # where it runs does not count
    assert len(made) == 1
    (file,) = (cache / "mattes").iterdir()
    file.write_bytes(file.read_bytes()[:200])  # cut off: made again
    assert np.array_equal(matte(), first)
    assert len(made) == 2
    matte(mask_model_std=(2.0, 2.0, 2.0))
    assert len(made) == 3
    shutil.copy(DATA / "fixed.onnx", capture / "model.onnx")
    matte()
    assert len(made) == 4


def test_kept_mattes_are_of_one_picture_and_recipe(tmp_path: Path) -> None:
    kept = MatteCache(tmp_path / "k", "one")
    image, matte = noisy(), noisy(seed=3)[..., 0]
    assert kept.read(image) is None
    kept.write(image, matte)
    found = kept.read(image)
    assert found is not None
    assert np.array_equal(found, matte)
    assert kept.read(noisy(seed=1)) is None
    assert kept.read(image.reshape(96, 64, 3)) is None
    assert MatteCache(tmp_path / "k", "two").read(image) is None
    assert [path.suffix for path in (tmp_path / "k").iterdir()] == [".png"]


def test_any_function_makes_mattes(three_videos: Path) -> None:
    def bright(image: np.ndarray, /) -> np.ndarray:
        return image.mean(axis=2) / 255

    footage = open_footage(CaptureSpec(three_videos, masks="none")).with_matte_source(FunctionMatteSource(bright))
    assert np.abs(footage.matte("cam1", 6) - footage.image("cam1", 6).mean(axis=2)).max() <= 0.5


@pytest.mark.parametrize(
    ("gives", "words"),
    [
        (lambda image: np.zeros((4, 4)), r"gave an array of \(4, 4\) float64; a matte is \(height, width\) floats"),
        (lambda image: np.zeros(image.shape[:2], np.uint8), "uint8; a matte is"),
        (lambda image: np.full(image.shape[:2], np.nan), "values that are no numbers"),
        (lambda image: np.full(image.shape[:2], 255.0), "gave values from 255 to 255; a matte's lie in 0 to 1"),
    ],
)
def test_functions_that_give_no_matte(gives: object, words: str) -> None:
    with pytest.raises(StudioError, match=rf"Mine, camera 'a', frame 3: .*{words}"):
        FunctionMatteSource(gives, "Mine").matte("a", 3, noisy())  # type: ignore[arg-type]


def test_only_the_largest_piece_of_a_function_is_kept_where_asked() -> None:
    matte = np.zeros((64, 96))
    cv2.circle(matte, (30, 30), 14, 1.0, -1)
    matte = cv2.GaussianBlur(matte, (0, 0), 1)
    both = matte.copy()
    both[50:60, 80:90] = 1.0
    found = FunctionMatteSource(lambda image: both, components=1).matte("a", 0, noisy())
    assert np.array_equal(found, np.rint(255 * matte).astype(np.uint8))


def test_nothing_is_imported_before_a_model_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def refuse(name: str, *rest: object) -> object:
        assert name != "onnxruntime"
        return real(name, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", refuse)
    OnnxModel(DATA / "free.onnx")
