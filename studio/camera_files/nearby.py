"""Image sizes for camera files that do not say them: from the footage that lies beside the file."""

from __future__ import annotations

from pathlib import Path

from studio.errors import StudioError

_FOLDERS = ("", "images", "image", "imgs", "videos", "video", "rgbs", "rgb")
_IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
_VIDEOS = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v")


def size_nearby(folder: Path, name: str, who: str) -> tuple[int, int]:
    """Width and height of a camera's footage.

    Args:
        folder: where the camera file lies.
        name: file name of the image, or name of the camera: an image or video of that name, or a folder with images,
            in the folder itself or in images/, videos/ and the like.
        who: for the message.

    Raises:
        StudioError: nothing found, or it cannot be read.
    """
    for part in _FOLDERS:
        base = folder / part / name
        files = [base] if base.suffix.lower() in _IMAGES + _VIDEOS else []
        files += [base.parent / (base.name + suffix) for suffix in _IMAGES + _VIDEOS]
        if base.is_dir():
            files += sorted(file for file in base.iterdir() if file.suffix.lower() in _IMAGES)[:1]
        for file in files:
            if file.is_file():
                return _size(file, who)
    raise StudioError(
        f"{who}: the file does not say how large the images are and '{name}' is not beside it (nor in images/ or "
        "videos/ there); put the footage there."
    )


def _size(file: Path, who: str) -> tuple[int, int]:
    try:
        if file.suffix.lower() in _IMAGES:
            from PIL import Image

            with Image.open(file) as image:
                return image.size
        import av

        with av.open(str(file)) as container:
            stream = container.streams.video[0]
            return stream.codec_context.width, stream.codec_context.height
    except Exception as error:
        raise StudioError(f"{who}: the size of {file} cannot be read ({error}).") from None
