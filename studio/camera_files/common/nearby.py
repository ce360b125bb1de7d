"""Image sizes for camera files that do not contain them, from the footage next to the file, or that of the capture."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path, PurePosixPath

from v3studio.studio.capture.images import image_header
from v3studio.studio.capture.media import open_media, video_stream
from v3studio.studio.capture.patterns import IMAGE_EXTENSIONS, VIDEO_EXTENSIONS, without_extension
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import is_out_of_memory
from v3studio.studio.validation import camera_error

_FOLDERS = ("", "images", "image", "imgs", "img", "videos", "video", "rgbs", "rgb")
_Sizes = Mapping[str, tuple[int, int]]
_sizes_of_capture: ContextVar[_Sizes] = ContextVar("_sizes_of_capture")
_FOOTAGE = sorted(IMAGE_EXTENSIONS) + sorted(VIDEO_EXTENSIONS)


@contextmanager
def sizes_of_capture(sizes: _Sizes) -> Iterator[None]:
    """Use the width and height of a capture's cameras, by name, while camera files without sizes are read."""
    token = _sizes_of_capture.set(sizes)
    try:
        yield
    finally:
        _sizes_of_capture.reset(token)


def _size_in_capture(name: str, camera: str) -> tuple[int, int] | None:
    """The size of the camera that has this name, a part of its path or the only one with its numbers."""
    sizes = _sizes_of_capture.get({})
    for part in (camera, *reversed(PurePosixPath(without_extension(name)).parts)):
        if part in sizes:
            return sizes[part]
    numbers = re.findall(r"\d+", camera)
    same = [own for own in sizes if numbers and [*map(int, re.findall(r"\d+", own))] == [*map(int, numbers)]]
    return sizes[same[0]] if len(same) == 1 else None


def size_nearby(folder: Path, name: str, camera: str) -> tuple[int, int]:
    """Width and height in pixels of a camera's footage near the camera file, which is in `folder`. `name` is the name
    of an image, a video (extension optional) or a folder of images, in the folder itself or in images/, videos/ and
    similar subfolders; if there is none, that of the capture's camera."""
    for part in _FOLDERS:
        base = folder / part / name
        files = [base] if base.suffix.lower() in _FOOTAGE else []
        files += [base.parent / (base.name + suffix) for suffix in _FOOTAGE]
        if base.is_dir():
            files += sorted(file for file in base.iterdir() if file.suffix.lower() in IMAGE_EXTENSIONS)[:1]
        for file in files:
            if file.is_file():
                return _size(file, camera)
    size = _size_in_capture(name, camera)
    if size is not None:
        return size
    problem = f"the file has no image sizes, and there is no footage '{name}' next to it"
    fix = (
        "Put the footage next to the camera file, into a folder images/ or videos/ there, or give it the camera's name."
    )
    raise camera_error("camera.size_unknown", camera, problem, value=name, fix=fix)


def size_within(folder: Path, camera: str) -> tuple[int, int] | None:
    """Width and height of the footage in a camera's own folder, "video" before others; None if there is none."""
    files = [file for file in folder.iterdir() if file.suffix.lower() in _FOOTAGE]
    best = min(files, key=lambda file: (file.stem != "video", file.stem != camera, file.name), default=None)
    return None if best is None else _size(best, camera)


def _size(file: Path, camera: str) -> tuple[int, int]:
    try:
        if file.suffix.lower() in IMAGE_EXTENSIONS:
            return image_header(file)[:2]
        with open_media(file) as container:
            stream = video_stream(container)
            if stream is None:
                raise ValueError("no video stream")
            return stream.width, stream.height
    except Exception as error:
        if is_out_of_memory(error) or (isinstance(error, StudioError) and error.code.startswith("storage.")):
            raise
        problem = f"the image size of {file} cannot be read ({error})"
        fix = "Replace the file."
        raise camera_error("camera.footage_unreadable", camera, problem, fix=fix, footage=file) from None
