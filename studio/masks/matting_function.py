"""Masks from any function of a frame: a matting model, or your own code."""

import inspect
import traceback
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from v3studio.studio.errors import Cancelled, StudioError


class MaskFunction(Protocol):
    """Computes the mask of a frame. May be called from several threads concurrently."""

    def __call__(self, image: np.ndarray, camera: str, frame: int, /) -> np.ndarray:
        """(H, W) float in 0..1, 1 = performer; or bool; or uint8 in 0..255.

        Args:
            image: (H, W, 3) uint8 RGB, at full size, as filmed.
            camera: the camera's name.
            frame: the frame number.
        """


class FunctionMaskSource:
    """A `MaskSource` that calls a `MaskFunction`.

    As a decorator of a function in a module, also with arguments (`@FunctionMaskSource(files=...)`), it makes the
    function's name a source for `capture.masks: MODULE:NAME`, with which all commands and `v3studio.run` work.

    Args:
        function: computes the masks; None: the function that the source is then called with, as a decorator.
        files: files that the function depends on besides its source file, such as those it reads; a take becomes stale
            when they change.
        cameras: names of the cameras that the function has masks of, an attribute as well; None: all. Others are not
            used, or if held out, not measured.
    """

    def __init__(
        self,
        function: MaskFunction | None = None,
        *,
        files: Sequence[Path | str] = (),
        cameras: Collection[str] | None = None,
    ) -> None:
        self.cameras = cameras
        self._files = [Path(file) for file in files]
        if function is not None:
            self(function)

    def __call__(self, function: MaskFunction) -> Self:
        """Use this function: `@FunctionMaskSource(files=...)`."""
        self._function = function
        self._name = getattr(function, "__name__", "mask function")
        self._files = _source_files(function) + self._files
        self.__module__ = getattr(function, "__module__", self.__module__)  # the first place to look for its name
        return self

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it.

        Raises:
            StudioError: `mask.function_failed`: the function raised an exception, which is the cause;
                `mask.function_output`: it did not return a mask of the image's size in 0..1.
        """
        image = np.ascontiguousarray(image[:, :, :3])
        where, file = f"{self._name}, camera '{camera}', frame {frame}", self._files[0] if self._files else None
        try:
            result = np.asarray(self._function(image, camera, frame))
        except (StudioError, Cancelled, MemoryError):
            raise
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            problem = f"{where}: {type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"
            fix = "Correct the function."
            raise StudioError(
                "mask.function_failed", problem, file=file, fix=fix, camera=camera, frame=frame
            ) from error
        problem = ""
        wrong: object = None
        if result.shape != image.shape[:2] or not (result.dtype.kind in "fb" or result.dtype == np.uint8):
            wrong = f"{result.shape} {result.dtype}"
            problem = f"returned an array of {wrong}; expected floats, bool or uint8 of shape {image.shape[:2]}"
        elif result.dtype == np.uint8 and result.max() == 1:  # 1 of 255 is meant by nobody
            wrong = 1
            problem = "returned uint8 values of 0 and 1 only; expected 0 to 255. Return bool for 0 and 1"
        elif not np.isfinite(result).all():
            problem = "returned NaN or infinite values"
        elif result.dtype.kind == "f" and (result.min() < -0.01 or result.max() > 1.01):
            low, high = float(result.min()), float(result.max())
            wrong = (low, high)
            problem = f"returned values from {low:.3g} to {high:.3g}; expected 0 to 1"
        if problem:
            problem = f"{where}: {problem}"
            raise StudioError("mask.function_output", problem, file=file, value=wrong, camera=camera, frame=frame)
        return result if result.dtype == np.uint8 else np.rint(255 * np.clip(result, 0.0, 1.0)).astype(np.uint8)

    def files(self) -> list[Path]:
        return list(self._files)


def _source_files(function: object) -> list[Path]:
    """The file that defines a function; none for one that was typed in."""
    try:
        file = inspect.getsourcefile(function)  # type: ignore[arg-type]
    except TypeError:  # an object that can be called
        return []
    return [Path(file)] if file is not None and Path(file).is_file() else []
