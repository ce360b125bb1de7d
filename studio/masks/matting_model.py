"""Matting models: ONNX files, run by onnxruntime, and TensorFlow Lite files (.tflite), run by OpenCV."""

import importlib.util
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from v3studio.studio.capture.digest import digest_files
from v3studio.studio.capture.settings import ModelKind
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.filters import keep_components
from v3studio.studio.masks.mask_cache import cached_mask
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource
from v3studio.studio.masks.models import model_named
from v3studio.studio.memory import is_out_of_memory
from v3studio.studio.process import logged
from v3studio.studio.storage import whole_files

_LOG = logging.getLogger(__name__)

STRIDE = 32  # image sides must be multiples of this: networks downsample up to five times by 2
_IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Kind:
    """The way in which a model was trained."""

    mean: tuple[float, float, float]  # (red, green, blue), subtracted from values in 0..1
    deviation: tuple[float, float, float]  # by which they are then divided
    # longer side in pixels, of ONNX files that accept any size; 0: that of the image. Of TensorFlow Lite files, both
    side: int
    logits: bool = False  # whether the output has to be passed through a sigmoid


KINDS: dict[ModelKind, Kind] = {  # as in the code that the models' authors published
    "u2net": Kind(*_IMAGENET, 320),
    "birefnet": Kind(*_IMAGENET, 1024, logits=True),
    "isnet": Kind((0.5, 0.5, 0.5), (1.0, 1.0, 1.0), 1024),
    "modnet": Kind((0.5, 0.5, 0.5), (0.5, 0.5, 0.5), 512),
    "selfie": Kind((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 256),
    "plain": Kind((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0),
}


@dataclass(frozen=True)
class _Loaded:
    """A model that is ready. `fixed`: (height, width) of its input, None where it is dynamic; `run`: all outputs for a
    (1, 3, H, W) float32 image."""

    fixed: tuple[int | None, int | None]
    run: Callable[[np.ndarray], Sequence[np.ndarray]]


class MattingModel:
    """A matting model, an ONNX or TensorFlow Lite file that is loaded with the first image. Thread safe. `device`:
    "cpu", "cuda", "cuda:1", or "auto", CUDA if onnxruntime supports it; `threads`: of the CPU, 0: all cores.

    An ONNX model must have one float input, 1 x 3 x height x width, RGB. Its mask is the first output with one channel
    and two spatial dimensions above 1.
    """

    def __init__(self, path: Path, kind: ModelKind = "u2net", *, device: str = "auto", threads: int = 0) -> None:
        self.device, self.threads, self._given = device, threads, path
        self.kind = KINDS[kind]
        if not path.is_file():
            problem = "matting model not found"
            fix = "Set capture.mask_model to the file of a model."
            raise StudioError("mask.model_missing", problem, file=path, fix=fix, setting="capture.mask_model")
        self._lite = path.suffix == ".tflite"
        if not self._lite and importlib.util.find_spec("onnxruntime") is None:
            problem = "matting models need onnxruntime, which is not installed"
            fix = "Run: pip install onnxruntime (with an NVIDIA GPU: pip install onnxruntime-gpu)."
            raise StudioError("mask.runtime_missing", problem, file=path, fix=fix, package="onnxruntime")
        self.path = whole_files(self.files())[0]
        self._loaded: _Loaded | None = None
        self._lock = threading.Lock()

    def files(self) -> list[Path]:
        """The model's file, and files of external weights next to it. Of objects in a store, the pointers."""
        external = [self._given.with_name(self._given.name + ending) for ending in ("_data", ".data")]
        return [self._given, *(path for path in external if path.is_file())]

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """(H, W) float32 mask in 0..1 of (H, W, 3) uint8 RGB. Raises StudioError: `mask.model_*`, `mask.no_cuda`."""
        import cv2

        with self._lock:
            self._loaded = self._loaded or self._load()
        height, width = image.shape[:2]
        size = input_size(self.kind.side, self._loaded.fixed, width, height)
        given = preprocess(image, size, self.kind)
        try:
            with logged(_LOG, "the matting model"):
                outputs = self._loaded.run(given)
        except Exception as error:  # onnxruntime's errors have no common base class
            if is_out_of_memory(error):
                raise
            problem = f"the matting model fails on an image of {size[0]}x{size[1]} ({_first_line(error)})"
            fix, setting = "Check the kind in capture.mask_model.", "capture.mask_model"
            raise StudioError(
                "mask.model_failed", problem, file=self.path, value=size, fix=fix, setting=setting
            ) from None
        return cv2.resize(self._mask_of(outputs), (width, height), interpolation=cv2.INTER_LINEAR)

    def _load(self) -> _Loaded:
        try:
            if self._lite:
                return _load_lite(self.path, self.kind.side)
            return _load_onnx(self.path, self.device, self.threads)
        except StudioError:
            raise
        except Exception as error:  # as above
            if is_out_of_memory(error):
                raise
            problem, fix = f"cannot load the matting model ({_first_line(error)})", "Replace the file."
            raise StudioError(
                "mask.model_unloadable", problem, file=self.path, fix=fix, setting="capture.mask_model"
            ) from None

    def _mask_of(self, outputs: Sequence[np.ndarray]) -> np.ndarray:
        shaped = [array for array in outputs if array.ndim >= 2 and array.size == array.shape[-1] * array.shape[-2]]
        mask = next((array.reshape(array.shape[-2:]) for array in shaped if min(array.shape[-2:]) > 1), None)
        if mask is None:
            shapes = ", ".join("x".join(map(str, array.shape)) for array in outputs)
            problem = f"the matting model returns {shapes}, none of which is a mask (1x1xHxW)"
            raise StudioError("mask.model_outputs", problem, file=self.path, value=shapes, setting="capture.mask_model")
        mask = np.ascontiguousarray(mask, np.float32)
        if self.kind.logits:
            mask = 1.0 / (1.0 + np.exp(-np.clip(mask, -60.0, 60.0)))
        low, high = float(mask.min()), float(mask.max())
        if not (low >= -0.01 and high <= 1.01):  # NaN too
            problem = f"the matting model returns values from {low:.3g} to {high:.3g}, outside 0 to 1"
            fix = "Correct the kind in capture.mask_model; birefnet if these are logits."
            raise StudioError(
                "mask.model_values", problem, file=self.path, value=(low, high), fix=fix, setting="capture.mask_model"
            )
        return mask


def _load_lite(path: Path, side: int) -> _Loaded:
    """A TensorFlow Lite model with inputs of `side` x `side` pixels."""
    import cv2

    net, lock = cv2.dnn.readNetFromTFLite(str(path)), threading.Lock()

    def run(image: np.ndarray) -> list[np.ndarray]:
        with lock:
            net.setInput(image)
            return [np.array(output) for output in net.forward(net.getUnconnectedOutLayersNames())]

    return _Loaded((side, side), run)


def _load_onnx(path: Path, device: str, threads: int) -> _Loaded:
    """An onnxruntime session."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # no warnings: errors are raised, and warnings only concern the optimizer
    options.intra_op_num_threads = threads
    chosen = providers(device, onnxruntime.get_available_providers())
    session: Any = onnxruntime.InferenceSession(str(path), options, providers=chosen)
    if device.startswith("cuda") and session.get_providers()[0] == "CPUExecutionProvider":
        problem = f"run.device is {device}, but onnxruntime cannot initialize CUDA for the matting model"
        fix = (
            "Install the CUDA and cuDNN versions that your onnxruntime-gpu requires, or set run.device to auto or cpu."
        )
        raise StudioError("mask.no_cuda", problem, file=path, value=device, fix=fix, setting="run.device")
    inputs = session.get_inputs()
    if len(inputs) != 1:
        names = tuple(given_input.name for given_input in inputs)
        problem = f"the matting model has {len(inputs)} inputs ({', '.join(names)}); expected a single RGB image"
        fix = "Recurrent models and models that need a trimap are not supported."
        raise StudioError("mask.model_inputs", problem, file=path, value=names, fix=fix, setting="capture.mask_model")
    (given,) = inputs
    shape = list(given.shape)
    is_image = len(shape) == 4 and _number(shape[1], 3) == 3 and shape[3] != 3
    if given.type not in ("tensor(float)", "tensor(float16)") or not is_image:
        form = f"{given.type} {'x'.join(map(str, shape))}"
        problem = f"the input of the matting model is {form}; expected float, 1x3xHxW (RGB, channels first)"
        raise StudioError("mask.model_inputs", problem, file=path, value=form, setting="capture.mask_model")
    dtype = np.float16 if given.type == "tensor(float16)" else np.float32

    def run(image: np.ndarray) -> list[np.ndarray]:
        outputs = session.run(None, {given.name: image.astype(dtype, copy=False)})
        return [np.asarray(output) for output in outputs]

    return _Loaded((_number(shape[2]), _number(shape[3])), run)


def providers(device: str, available: Sequence[str]) -> list[Any]:
    """The execution providers to pass to onnxruntime, of the `available` ones, for a device as in `MattingModel`."""
    cuda = "CUDAExecutionProvider"
    if device == "cpu" or (device == "auto" and cuda not in available):
        return ["CPUExecutionProvider"]
    if cuda not in available:
        problem = f"run.device is {device}, but the installed onnxruntime does not support CUDA"
        fix = "Replace it with onnxruntime-gpu, or set run.device to auto or cpu."
        raise StudioError("mask.no_cuda", problem, value=device, fix=fix, setting="run.device")
    index = int(device.partition(":")[2] or 0) if device != "auto" else 0
    return [(cuda, {"device_id": index}), "CPUExecutionProvider"]


def input_size(wanted: int, fixed: tuple[int | None, int | None], width: int, height: int) -> tuple[int, int]:
    """(width, height) to which an image is resized for a model: the `fixed` size (height, width) of its input; where
    that is None, multiples of `STRIDE` near the `wanted` longer side, or near the size of the image if that is 0."""

    def near(length: float) -> int:
        return max(STRIDE, STRIDE * round(length / STRIDE))

    scale = wanted / max(width, height) if wanted else 1.0
    down, across = fixed
    return across or near(scale * width), down or near(scale * height)


def preprocess(image: np.ndarray, size: tuple[int, int], kind: Kind) -> np.ndarray:
    """The (1, 3, H, W) float32 model input of an (h, w, 3) uint8 RGB image, resized to `size` (width, height)."""
    import cv2

    if (image.shape[1], image.shape[0]) != size:
        shrinks = size[0] * size[1] < image.shape[0] * image.shape[1]
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    mean, deviation = np.array(kind.mean, np.float32), np.array(kind.deviation, np.float32)
    scaled = (image.astype(np.float32) / 255.0 - mean) / deviation
    return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], np.float32)


def _number(size: Any, otherwise: int | None = None) -> int | None:
    """A fixed dimension; `otherwise` for a dynamic one (a name or None)."""
    return size if isinstance(size, int) and size > 0 else otherwise


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]


def load_model(inputs: MaskInputs) -> MattingModel:
    """The model of `capture.mask_model`. Raises StudioError `mask.model_not_set`, or as `MattingModel`."""
    wanted = inputs.spec.mask_model
    if wanted is None:
        problem = "capture.masks is model, but no model is set"
        fix = "Set capture.mask_model to auto, or to a model of `v3studio models`."
        raise StudioError("mask.model_not_set", problem, fix=fix, setting="capture.mask_model")
    kind, _, file = wanted.partition(":")
    if not file:
        model = model_named("selfie" if kind == "auto" else kind)
        kind, path = model.name, model.file
        if not model.is_here:
            problem, fix = f"the matting model {kind} is not on this machine", f"Run: v3studio models get {kind}"
            raise StudioError("mask.model_missing", problem, file=path, fix=fix, setting="capture.mask_model")
    else:
        path = inputs.spec.root / Path(file).expanduser()
    return MattingModel(path, cast(ModelKind, kind), device=inputs.device, threads=inputs.threads)


class ModelMaskSource(MaskSource):
    """A `MaskSource` that runs a model. Its masks are cached on the disk, if there is a folder for that."""

    def __init__(self, inputs: MaskInputs, model: MattingModel) -> None:
        self._inputs, self.model, files = inputs, model, model.files()
        # the device is not part of the recipe, because masks do not depend on it
        cached = inputs.cache_folder is not None
        self._recipe = f"{digest_files(files[0].parent, files)} {model.kind}" if cached else ""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError as `MattingModel`."""
        image = np.ascontiguousarray(image[:, :, :3])

        def make() -> np.ndarray:
            return np.rint(255 * np.clip(self.model(image), 0.0, 1.0)).astype(np.uint8)

        mask = cached_mask(self._inputs.cache_folder, self._recipe, image, make)
        inside = self._inputs.inside(camera, frame, image)
        if inside is not None:
            mask = mask * inside.astype(np.uint8)
        components = self._inputs.spec.mask_components
        return largest_components(mask, components) if components else mask

    def files(self) -> list[Path]:
        return self.model.files()


def largest_components(mask: np.ndarray, components: int) -> np.ndarray:
    """A soft mask reduced to its largest components, including their soft edges."""
    import cv2

    solid = mask > 127
    kept = keep_components(solid, components, 0)
    reach = max(4, round(0.005 * max(mask.shape)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    gone = solid & (kept == 0)
    around = cv2.dilate(kept, disc) > 0
    return np.where(around & ~gone, mask, 0).astype(np.uint8)


def open_model(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Open masks from a model, for `SOURCES`. Raises StudioError as `load_model`."""
    if not required and inputs.spec.mask_model is None:
        return None
    source = ModelMaskSource(inputs, load_model(inputs))
    return source, f"matting model {source.files()[0].name}"
