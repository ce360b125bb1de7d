"""Masks from the difference to the empty set: from clean plates, or from a background estimated from the footage."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from v3studio.studio.capture.detect import PLATE_FOLDERS
from v3studio.studio.capture.digest import digest_files
from v3studio.studio.capture.images import read_image
from v3studio.studio.capture.patterns import VIDEO_EXTENSIONS
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.clean_plate import Background, difference_mask
from v3studio.studio.masks.mask_files import find_files_of
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource
from v3studio.studio.masks.median_background import (
    background_cache,
    cached_background,
    estimate_background,
    median_plate,
)

FEW_FRAMES = 10  # with fewer frames, the performer hides too much of the set for auto to choose its median
_FEW_IF_VOTED = 5  # the same where cameras agree on masks, which find the set that the performer hides


class PlateMaskSource(MaskSource):
    """A `MaskSource` from the difference to the empty set, whose image `background` loads or estimates from `files`,
    once per camera, as far as they fit into memory."""

    def __init__(self, inputs: MaskInputs, background: Callable[[str], Background], files: list[Path]) -> None:
        self._inputs, self._load, self._files = inputs, background, files
        self._backgrounds = background_cache()

    def background(self, camera: str) -> Background:
        """The background of `camera`, in raw pixels."""
        return self._backgrounds.get_or_make(camera, self._load)

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError `mask.plate_size`, or the plate cannot be
        loaded."""
        behind = self._fitting(camera, image.shape[1], image.shape[0])
        image = np.ascontiguousarray(image[:, :, :3])
        inside = self._inputs.inside(camera, frame, image)
        if inside is not None:  # here, so that garbage does not count as a component
            image = np.where(inside[:, :, None], image, behind.plate)
        return difference_mask(image, behind, self._inputs.spec)

    def _fitting(self, camera: str, width: int, height: int) -> Background:
        """The background, of the size of the footage."""
        behind = self.background(camera)
        size, expected = (behind.plate.shape[1], behind.plate.shape[0]), (width, height)
        if size != expected:
            problem = (
                f"The clean plate of camera '{camera}' is {size[0]}x{size[1]}, its footage {expected[0]}x{expected[1]}"
            )
            fix = "Clean plates must have the size of the footage."
            raise StudioError("mask.plate_size", problem, value=size, fix=fix, camera=camera, expected=expected)
        return behind

    def plate(self, camera: str) -> np.ndarray:
        source = self._inputs.sources[camera]
        return shown(self._fitting(camera, source.width, source.height))

    def files(self) -> list[Path]:
        return list(self._files)


def shown(behind: Background) -> np.ndarray:
    """A background as `ShowsSet` returns it."""
    reliable = behind.agreed
    if reliable is None:
        if behind.known is None or behind.doubtful is None:
            return behind.plate
        reliable = behind.known & ~behind.doubtful
    return np.dstack([behind.plate, np.where(reliable, np.uint8(255), np.uint8(0))])


def _plate(paths: list[Path], spec: CaptureSettings) -> Background:
    """A clean plate: one image, or the median of several or of a video. Raises StudioError: a file cannot be read."""
    if paths[0].suffix.lower() in VIDEO_EXTENSIONS:
        with closing(VideoReader(paths[0], spec.color_matrix, spec.transfer)) as reader:
            count = reader.frame_count
            try:
                reader.read(count - 1)
            except StudioError as error:  # a header that counts too many is no harm: a plate needs no certain frames
                if error.code != "footage.video_truncated" or not error.fields["frame"]:
                    raise
                count = error.fields["frame"]
            return Background(median_plate(lambda frame: reader.read(frame)[:, :, :3], count))
    if len(paths) == 1:
        return Background(np.ascontiguousarray(read_image(paths[0], spec.transfer)[:, :, :3]))
    return Background(median_plate(lambda index: read_image(paths[index], spec.transfer)[:, :, :3], len(paths)))


def open_clean_plate(inputs: MaskInputs, required: bool) -> tuple[PlateMaskSource, str] | None:
    """Open masks from clean plates, for `SOURCES`."""
    spec = inputs.spec
    plates = find_files_of(
        inputs, "clean_plates", PLATE_FOLDERS, required,
        code="mask.plates_not_found", what="clean plate", example="clean_plates/{camera}.png",
    )  # fmt: skip
    if plates is None:
        return None
    pattern, matches = plates
    paths = {name: [match.path for match in matches if match.camera == name] for name in inputs.names}
    without = [name for name in inputs.names if not paths[name]]
    if without:
        camera, setting = without[0], "capture.clean_plates"
        problem = f"camera '{camera}' has no clean plate that matches '{pattern}'"
        fix = "Add it, or exclude the camera."
        raise StudioError(
            "mask.plate_missing", problem, file=spec.root, value=pattern, fix=fix, camera=camera, setting=setting
        )
    source = PlateMaskSource(inputs, lambda camera: _plate(paths[camera], spec), [match.path for match in matches])
    return source, f"difference from the clean plates '{pattern}'"


def open_median_background(inputs: MaskInputs, required: bool) -> tuple[PlateMaskSource, str] | None:
    """Open masks from the footage's background, for `SOURCES`. Raises StudioError `mask.too_few_frames`."""
    count = inputs.frame_count
    if count < (3 if required else _FEW_IF_VOTED if inputs.can_vote else FEW_FRAMES):
        if not required:
            return None
        problem = f"A median background needs at least 3 frames, but the footage has {count}"
        fix = "Provide masks or clean plates."
        raise StudioError("mask.too_few_frames", problem, value=count, fix=fix, expected=3, setting="capture.masks")
    spec, folder = inputs.spec, inputs.cache_folder

    def background(camera: str) -> Background:
        source = inputs.sources[camera]
        meaning = spec.color_matrix + ("" if spec.transfer == "auto" else f"_{spec.transfer}")
        key = f"{digest_files(spec.root, source.files())[:24]}_{meaning}" if folder else ""
        estimate = partial(estimate_background, partial(inputs.image, camera), source.frames)
        return cached_background(folder, key, estimate)

    paths = [path for source in inputs.sources.values() for path in source.files()]
    source = PlateMaskSource(inputs, background, paths)
    return source, "difference from the background estimated from the footage"
