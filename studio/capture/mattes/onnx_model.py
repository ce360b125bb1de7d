"""A matting model from an ONNX file, run by onnxruntime."""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studio.errors import StudioError

STRIDE = 32
"""Networks halve the picture up to five times, so sides must be multiples of this."""


@dataclass(frozen=True)
class OnnxSettings:
    """How pictures are put into a model, and what it is run on.

    Attributes:
        size: longer side that pictures are resized to, a multiple of 32; 0 takes the size that the file has fixed, else
            the pictures' own, to the nearest multiples of 32.
        mean, std: (red, green, blue), of values in 0..1: the model sees (value - mean) / std.
        sigmoid: the model gives logits.
        device: "cpu", "cuda", "cuda:1", or "auto": CUDA where onnxruntime has it.
        threads: on the CPU; 0 is all cores.
    """

    size: int = 0
    mean: tuple[float, float, float] = (0.485, 0.456, 0.406)
    std: tuple[float, float, float] = (0.229, 0.224, 0.225)
    sigmoid: bool = False
    device: str = "auto"
    threads: int = 0


class OnnxModel:
    """A `MattingFunction`. The file is loaded when the first picture comes.

    The model has one input of floats, 1 x 3 x height x width, RGB; its matte is the first output of one channel whose
    last two dimensions are a picture's.

    Raises:
        StudioError: the file is not there, or onnxruntime is not installed.
    """

    def __init__(self, path: Path, settings: OnnxSettings | None = None) -> None:
        self.path = path
        self.settings = settings or OnnxSettings()
        if not path.is_file():
            raise StudioError(f"The matting model {path} is not there; give its ONNX file in capture.mask_model.")
        if importlib.util.find_spec("onnxruntime") is None:
            raise StudioError(
                f"The matting model {path} needs onnxruntime, which is not installed: pip install 'v3studio[matting]' "
                "(on a machine with an NVIDIA GPU: pip install onnxruntime-gpu)."
            )
        self._loaded: _Loaded | None = None
        self._lock = threading.Lock()

    def files(self) -> list[Path]:
        """The model's file, and those beside it that hold its weights where they are too large for it."""
        beside = [self.path.with_name(self.path.name + ending) for ending in ("_data", ".data")]
        return [self.path, *(path for path in beside if path.is_file())]

    def __call__(self, image: np.ndarray, /) -> np.ndarray:
        """(H, W) float32 in 0..1 of (H, W, 3) uint8 RGB.

        Raises:
            StudioError: the file is broken or its inputs and outputs are not those of a matting model; the size does
                not suit it; its values leave 0..1.
        """
        import cv2

        with self._lock:
            if self._loaded is None:
                self._loaded = _Loaded(self.path, self.settings)
        height, width = image.shape[:2]
        size = input_size(self.path, self.settings.size, self._loaded.fixed, width, height)
        matte = self._matte_of(self._loaded.run(prepared(image, size, self.settings)))
        return cv2.resize(matte, (width, height), interpolation=cv2.INTER_LINEAR)

    def _matte_of(self, outputs: Sequence[np.ndarray]) -> np.ndarray:
        matte = first_picture(outputs)
        if matte is None:
            shapes = ", ".join("x".join(map(str, output.shape)) for output in outputs)
            raise StudioError(f"The matting model {self.path} gives {shapes}; one output must be a matte, 1x1xHxW.")
        matte = np.ascontiguousarray(matte, np.float32)
        if self.settings.sigmoid:
            return (1.0 / (1.0 + np.exp(-np.clip(matte, -60.0, 60.0)))).astype(np.float32)
        low, high = float(matte.min()), float(matte.max())
        if not (low >= -0.01 and high <= 1.01):  # NaN too
            raise StudioError(
                f"The matting model {self.path} gives values from {low:.3g} to {high:.3g}, a matte's lie in 0 to 1; if "
                "they are logits set capture.mask_model_sigmoid to true, else check capture.mask_model_mean and "
                "mask_model_std."
            )
        return matte


class _Loaded:
    """A session, and what it wants.

    Attributes:
        fixed: (height, width) that the file has fixed, each None where any will do.
    """

    def __init__(self, path: Path, settings: OnnxSettings) -> None:
        import onnxruntime

        self._path = path
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3  # errors come as exceptions; warnings are about its own optimizer
        options.intra_op_num_threads = settings.threads
        try:
            self._session: Any = onnxruntime.InferenceSession(
                str(path), options, providers=providers(settings.device, onnxruntime.get_available_providers())
            )
        except StudioError:
            raise
        except Exception as error:  # each kind of failure is a class of its own there
            raise StudioError(
                f"The matting model {path} cannot be loaded ({_first_line(error)}); give a whole ONNX file."
            ) from None
        if settings.device.startswith("cuda") and self._session.get_providers()[0] == "CPUExecutionProvider":
            raise StudioError(
                f"run.device = {settings.device}, but onnxruntime cannot start CUDA for the matting model {path}; "
                "install the CUDA and cuDNN that your onnxruntime-gpu asks for, or set run.device to auto or cpu."
            )
        inputs = self._session.get_inputs()
        if len(inputs) != 1:
            names = ", ".join(one.name for one in inputs)
            raise StudioError(
                f"The matting model {path} wants {len(inputs)} inputs ({names}); only models that see one picture at a "
                "time can be used, not ones that remember the frames before or need a trimap."
            )
        (self._input,) = inputs
        shape = list(self._input.shape)
        pictures = len(shape) == 4 and _number(shape[1], 3) == 3 and shape[3] != 3
        if self._input.type not in ("tensor(float)", "tensor(float16)") or not pictures:
            raise StudioError(
                f"The matting model {path} wants {self._input.type} {'x'.join(map(str, shape))}; it must be floats, "
                "1x3xHxW (RGB pictures, channels first)."
            )
        self._kind = np.float16 if self._input.type == "tensor(float16)" else np.float32
        self.fixed = (_number(shape[2]), _number(shape[3]))

    def run(self, picture: np.ndarray) -> list[np.ndarray]:
        """All outputs for a (1, 3, H, W) float32 picture."""
        try:
            found = self._session.run(None, {self._input.name: picture.astype(self._kind, copy=False)})
        except Exception as error:  # as above
            raise StudioError(
                f"The matting model {self._path} fails on a picture of {picture.shape[3]}x{picture.shape[2]} "
                f"({_first_line(error)}); try another capture.mask_model_size."
            ) from None
        return [np.asarray(one) for one in found]


def providers(device: str, available: Sequence[str]) -> list[Any]:
    """What onnxruntime is to run on, given what it can.

    Raises:
        StudioError: a GPU is asked for that this onnxruntime cannot use.
    """
    cuda = "CUDAExecutionProvider"
    if device == "cpu" or (device == "auto" and cuda not in available):
        return ["CPUExecutionProvider"]
    if cuda not in available:
        raise StudioError(
            f"run.device = {device}, but the installed onnxruntime has no CUDA, which the matting model needs then: "
            "pip install onnxruntime-gpu in its place, or set run.device to auto or cpu."
        )
    index = int(device.partition(":")[2] or 0) if device != "auto" else 0
    return [(cuda, {"device_id": index}), "CPUExecutionProvider"]


def input_size(
    path: Path, wanted: int, fixed: tuple[int | None, int | None], width: int, height: int
) -> tuple[int, int]:
    """(width, height) that a picture of `width` x `height` is resized to for a model.

    Args:
        path: of the model, for the message.
        wanted: longer side, or 0.
        fixed: the model's (height, width), None where any will do.

    Raises:
        StudioError: the file has fixed another size than the wanted one.
    """

    def near(length: float) -> int:
        return max(STRIDE, STRIDE * round(length / STRIDE))

    scale = wanted / max(width, height) if wanted else 1.0
    down, across = fixed
    if wanted and (down or across) and max(down or 0, across or 0) != wanted:
        raise StudioError(
            f"The matting model {path} has fixed its pictures to {across or 'any'}x{down or 'any'}, but "
            f"capture.mask_model_size is {wanted}; set it to 0."
        )
    return across or near(scale * width), down or near(scale * height)


def prepared(image: np.ndarray, size: tuple[int, int], settings: OnnxSettings) -> np.ndarray:
    """(1, 3, H, W) float32 as a model sees an (H, W, 3) uint8 RGB picture at `size` (width, height)."""
    import cv2

    if (image.shape[1], image.shape[0]) != size:
        shrinks = size[0] * size[1] < image.shape[0] * image.shape[1]
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    mean, deviation = np.array(settings.mean, np.float32), np.array(settings.std, np.float32)
    values = (image.astype(np.float32) / 255.0 - mean) / deviation
    return np.ascontiguousarray(values.transpose(2, 0, 1)[None], np.float32)


def first_picture(outputs: Sequence[np.ndarray]) -> np.ndarray | None:
    """(h, w) of the first output of one channel whose last two dimensions are a picture's (above 1); None without."""
    for output in outputs:
        if output.ndim >= 2 and min(output.shape[-2:]) > 1 and output.size == output.shape[-1] * output.shape[-2]:
            return output.reshape(output.shape[-2:])
    return None


def _number(size: Any, otherwise: int | None = None) -> int | None:
    """A dimension that the file has fixed; names and None are any."""
    return size if isinstance(size, int) and size > 0 else otherwise


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
