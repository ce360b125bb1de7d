"""Plates for compositing: one multi-layer OpenEXR file per frame, and deep files, written with OpenImageIO.

Sources: OpenEXR's standard attributes and layer names; OpenColorIO's built-in configuration for computer graphics; the
layers `forward` and `depth` of Nuke. Splats are trained in sRGB and blended there, so colors are divided by alpha
before they are converted, and multiplied afterward.
"""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.cameras import OPENGL_AXES, Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.placing import new_folder
from v3studio.studio.formats.plates import Plate, Plates, Shutter
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer.deep_samples import DeepSamples
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo

CONFIG = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"  # converts colors; in every OpenColorIO since 2.2
COLOR_SPACES = {  # by name: space in `CONFIG`, its `colorInteropID`, chromaticities of its primaries and white
    "acescg": ("ACEScg", "lin_ap1_scene", (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)),
    "rec709": ("Linear Rec.709 (sRGB)", "lin_rec709_scene", (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)),
    "srgb": ("sRGB - Texture", "srgb_rec709_scene", (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)),
}
MAX_SIDE = 16384
MAX_SAMPLES = 256
MAX_PERFORMERS = 16
MAX_DEEP = 64
_FILM_WIDTH = 36.0  # mm, by which focal lengths are given
_LAYERS = (
    ("R", "half"), ("G", "half"), ("B", "half"), ("A", "half"),
    ("Z", "float"),
    ("P.X", "float"), ("P.Y", "float"), ("P.Z", "float"),
    ("N.X", "half"), ("N.Y", "half"), ("N.Z", "half"),
    ("forward.u", "float"), ("forward.v", "float"),
)  # fmt: skip
_DEEP_LAYERS = _LAYERS[:5]


Attributes = dict[str, tuple[str, object]]  # of a file's header, by name and as (type, value)


def openimageio() -> Any:
    """The package `OpenImageIO`; untyped."""
    try:
        import OpenImageIO
    except ImportError as error:
        problem = f"EXR files need OpenImageIO ({error})"
        raise StudioError("exr.missing", problem, fix="Install it: pip install openimageio.") from None
    return OpenImageIO


def export_exr(
    video: SplatVideo,
    folder: Path,
    camera: Callable[[float], Camera],
    world: Similarity,
    color_space: str = "acescg",
    overscan: int = 0,
    shutter: Shutter | None = None,
    performers: int = 0,
    deep: int = 0,
    progress: ProgressFn = no_progress,
) -> int:
    """Write `folder/plate.0000.exr`, ..., numbered as in the video, and `folder/deep.0000.exr`, ...; returns the
    bytes written.

    Args:
        folder: must not exist; appears only when it is complete.
        camera: returns the camera at an index of a frame, also between two of them, in the world of the splats. All
            have one size.
        world: from the world of the splats to that of the files.
        overscan: pixels rendered beyond each side of the image; the file's display window stays the image.
        shutter: of the colors; None: an instant.
        performers: number of those who get mattes, see `Plates`.
        deep: most samples of a pixel in the deep files; 0: no deep files.

    Raises:
        StudioError: OpenImageIO is missing, a number is out of range (export.invalid_setting), a frame cannot be read,
            performers touch (exr.performers), or the folder exists or cannot be written.
    """
    oiio = openimageio()
    shutter = shutter or Shutter()
    size = max(camera(0).width, camera(0).height) + 2 * overscan
    for name, value, valid, expected in (
        ("overscan", overscan, overscan >= 0, "at least 0"),
        ("shutter", shutter.angle, 0 <= shutter.angle <= 360, "0 to 360 degrees"),
        ("samples", shutter.samples, 1 <= shutter.samples <= MAX_SAMPLES, f"1 to {MAX_SAMPLES}"),
        ("mattes", performers, 0 <= performers <= MAX_PERFORMERS, f"0 to {MAX_PERFORMERS}"),
        ("deep", deep, 0 <= deep <= MAX_DEEP, f"0 to {MAX_DEEP}"),
        ("size with overscan", size, size <= MAX_SIDE, f"at most {MAX_SIDE} pixels"),
    ):
        if not valid:
            problem = f"{name} is {value:g}; it must be {expected}"
            raise StudioError("export.invalid_setting", problem, file=folder, value=value, name=name)

    def wide(index: float) -> Camera:
        own = camera(index)
        return own.cropped(-overscan, -overscan, own.width + 2 * overscan, own.height + 2 * overscan)

    plates = Plates(video, wide, world, lambda rgba: _converted(oiio, rgba, color_space), shutter, performers, deep)
    digits = max(4, len(str(video.number(video.frame_count - 1))))
    with new_folder(folder) as temporary:
        for index in range(video.frame_count):
            progress(index, video.frame_count)
            number = video.number(index)
            attributes = _attributes(world.camera(camera(index)), number, video.fps, shutter, color_space)
            plate = plates.render(index)
            name = f"{number:0{digits}d}.exr"
            _write_plate(oiio, temporary / f"plate.{name}", plate, attributes, overscan)
            if plate.deep is not None:
                _write_deep(oiio, temporary / f"deep.{name}", plate.deep, plate.depth.shape, attributes, overscan)
        progress(video.frame_count, video.frame_count)
        return sum(path.stat().st_size for path in temporary.iterdir())


def _converted(oiio: Any, rgba: np.ndarray, color_space: str) -> np.ndarray:
    """(H, W, 4) premultiplied sRGB in another color space, premultiplied."""
    height, width = rgba.shape[:2]
    spec = oiio.ImageSpec(width, height, 4, "float")
    spec.channelnames, spec.alpha_channel = ("R", "G", "B", "A"), 3
    image = oiio.ImageBuf(spec)
    image.set_pixels(oiio.ROI(), np.ascontiguousarray(rgba, np.float32))
    target = COLOR_SPACES[color_space][0]
    result = oiio.ImageBufAlgo.colorconvert(image, COLOR_SPACES["srgb"][0], target, True, colorconfig=CONFIG)
    if result.has_error:
        raise StudioError("exr.color", f"colors cannot be converted to {target} ({result.geterror()})")
    pixels: np.ndarray = result.get_pixels(oiio.FLOAT)
    return pixels


def _attributes(camera: Camera, number: int, fps: float, shutter: Shutter, color_space: str) -> Attributes:
    """The header of a file: OpenEXR's standard attributes. Matrices multiply row vectors, as everywhere in OpenEXR;
    cameras look along -z with y up; in NDC, the image is from -1 to 1, with y up."""
    view = OPENGL_AXES @ camera.world_to_camera
    (fx, _, cx), (_, fy, cy) = camera.K[:2].tolist()
    width, height = camera.width, camera.height
    near, far = 0.01, 10000.0
    projection = np.array(
        [
            [2 * fx / width, 0, 1 - 2 * cx / width, 0],
            [0, 2 * fy / height, 2 * cy / height - 1, 0],
            [0, 0, (near + far) / (near - far), 2 * near * far / (near - far)],
            [0, 0, -1, 0],
        ]
    )
    rate = Fraction(fps).limit_denominator(1001)
    film = _FILM_WIDTH, _FILM_WIDTH * height / width * fx / fy
    return {
        "worldToCamera": ("matrix", view.T.ravel().tolist()),
        "worldToNDC": ("matrix", (projection @ view).T.ravel().tolist()),
        "screenWindowWidth": ("float", width / fx),
        "screenWindowCenter": ("float[2]", ((width / 2 - cx) / fx, (cy - height / 2) / fy)),
        "cameraLabel": ("string", camera.name),
        "pinholeFocalLength": ("float", _FILM_WIDTH * fx / width),
        "sensorOverallDimensions": ("float[2]", film),
        "shutterAngle": ("float", shutter.angle),
        "imageCounter": ("int", number),
        "framesPerSecond": ("rational", (rate.numerator, rate.denominator)),
        "chromaticities": ("float[8]", COLOR_SPACES[color_space][2]),
        "colorInteropID": ("string", COLOR_SPACES[color_space][1]),
        "Software": ("string", "V3 Studio"),
        "compression": ("string", "zips"),
    }


def _write_plate(oiio: Any, path: Path, plate: Plate, attributes: Attributes, overscan: int) -> None:
    layers = (*_LAYERS, *((f"matte.{performer}", "half") for performer in range(plate.mattes.shape[-1])))
    spec = _spec(oiio, plate.depth.shape, layers, attributes, overscan)
    parts = [plate.rgba, plate.depth[..., None], plate.position, plate.normal, plate.forward, plate.mattes]
    pixels = np.concatenate(parts, axis=-1, dtype=np.float32)
    _written(oiio, path, spec, lambda out: out.write_image(pixels))


def _write_deep(
    oiio: Any, path: Path, deep: DeepSamples, shape: tuple[int, ...], attributes: Attributes, overscan: int
) -> None:
    spec = _spec(oiio, shape, _DEEP_LAYERS, attributes, overscan)
    spec.deep = True
    data = oiio.DeepData()
    data.init(spec)
    pixels, firsts, counts = np.unique(deep.pixels, return_index=True, return_counts=True)
    for pixel, count in zip(pixels.tolist(), counts.tolist(), strict=True):
        data.set_samples(pixel, count)
    numbers = np.arange(len(deep.pixels)) - np.repeat(firsts, counts)
    for pixel, sample, values in zip(deep.pixels.tolist(), numbers.tolist(), deep.values.tolist(), strict=True):
        for channel, value in enumerate(values):
            data.set_deep_value(pixel, channel, sample, value)
    _written(oiio, path, spec, lambda out: out.write_deep_image(data))


def _spec(
    oiio: Any, shape: tuple[int, ...], layers: tuple[tuple[str, str], ...], attributes: Attributes, overscan: int
) -> Any:
    height, width = shape
    spec = oiio.ImageSpec(width, height, len(layers), "float")
    spec.channelnames = tuple(name for name, _ in layers)
    spec.channelformats = tuple(oiio.TypeDesc(kind) for _, kind in layers)
    spec.alpha_channel, spec.z_channel = 3, 4
    spec.x = spec.y = -overscan
    spec.full_x = spec.full_y = 0
    spec.full_width, spec.full_height = width - 2 * overscan, height - 2 * overscan
    for name, (kind, value) in attributes.items():
        spec.attribute(name, kind, value)
    return spec


def _written(oiio: Any, path: Path, spec: Any, write: Callable[[Any], bool]) -> None:
    """Write a file. Raises StudioError if that fails."""
    out = oiio.ImageOutput.create(str(path))
    if not (out.open(str(path), spec) and write(out) and out.close()):
        reason = out.geterror().replace(f' to image file "{path}"', "")
        fix = "Check the free space of the disk."
        raise StudioError("export.write_failed", f"cannot be written ({reason})", file=path, fix=fix)
