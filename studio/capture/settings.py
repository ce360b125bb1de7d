"""Settings of the footage: where its files are and how to read them."""

import colorsys
import re
import sys
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, field_validator, model_validator

from v3studio.studio.capture.frame_range import parse_frame_range
from v3studio.studio.capture.transfer import TransferFunction
from v3studio.studio.settings import Affects, Color, Conflict, Empty, Heading, Name, Settings, Unbounded
from v3studio.studio.storage import StoreAddress, is_address
from v3studio.studio.storage.address import CREDENTIALS, CREDENTIALS_FIX, has_credentials

MaskKind = Literal["auto", "none", "alpha", "files", "clean_plate", "plain", "chroma_key", "median_background", "model"]
EvidenceKind = Literal["alpha", "files", "clean_plate", "plain", "chroma_key", "median_background", "model"]
ImportPath = Annotated[str, Field(pattern=r"^[\w.]+:\w+$")]
"""MODULE:NAME of a source of masks; see `studio.masks.imported`."""

CameraName = Annotated[str, Field(coerce_numbers_to_str=True)]  # in Python, 8 is the camera '8'

SizeRule = Literal["auto", "stretch", "crop", "letterbox"]

ModelKind = Literal["u2net", "birefnet", "isnet", "modnet", "selfie", "plain"]
ModelName = Literal["selfie", "isnet"]  # of models in the table `studio.masks.models`; also their kinds

_DEFAULT = Affects("calibration_masks", "training_views", "evaluation")
_PIXELS = Affects("cameras_from_images", "cameras_from_target", "cameras_from_points", *_DEFAULT.results)


def import_path(source: object) -> str | None:
    """MODULE:NAME of a source of masks, for `capture.masks`; None if it is not a global variable of a module.

    In a script, the module is that of the script's file.
    """
    modules = sys.modules.copy()
    for module in sorted(modules, key=lambda name: (name != source.__module__, name == "__main__")):
        for name, value in list(getattr(modules[module], "__dict__", {}).items()):
            if value is source:
                script = Path(getattr(modules[module], "__file__", None) or "").stem
                return f"{script if module == '__main__' else module}:{name}"
    return None


LEAST_SATURATION = 0.3  # of a screen's color, 0 to 1

EVERY = re.compile(r"every (\d+)")  # an entry of `held_out` that stands for several cameras


def _is_saturated(color: Color) -> bool:
    """Return whether a color is saturated enough for a screen."""
    _, saturation, value = colorsys.rgb_to_hsv(*color)
    return saturation >= LEAST_SATURATION and value > 0.1


class FileSettings(Settings):
    """The files of a capture.

    Patterns are paths below `root` (or absolute) with `{camera}`, `{frame}` (or `{frame:06d}` for zero-padded numbers),
    `*`, `?` and `**/`: `videos/{camera}.mp4` is one video per camera, `images/{camera}/{frame:06d}.png` a folder per
    camera, `{frame}/images/{camera}.png` a folder per frame, `images/{camera}.jpg` a single frame,
    `{camera}/G{chapter}????.MP4` a folder per camera with one recording in several videos, in the order of `{chapter}`,
    `images/{camera}/{seconds}.png` images that are named by their times.
    """

    affects: ClassVar[Affects | None] = _DEFAULT

    @field_validator("masks", mode="wrap")
    @classmethod
    def _kind_or_import_path(cls, value: Any, check: ValidatorFunctionWrapHandler) -> Any:
        try:
            return check(import_path(value) if hasattr(value, "mask") else value)
        except ValidationError:  # one message instead of one per alternative type
            raise Conflict(
                f"must be one of {', '.join(get_args(MaskKind))}, MODULE:NAME of a source of your own, such a source "
                "that is a global variable of a module's file, or a list of several (but auto and none)"
            ) from None

    @field_validator("root", mode="after")
    @classmethod
    def _address_or_folder(cls, value: Path) -> Path:
        if has_credentials(value):
            raise Conflict(CREDENTIALS, CREDENTIALS_FIX, secret=True)
        return StoreAddress(str(value)) if is_address(value) else value

    root: Annotated[Path, Heading("Files"), Affects()] = Path(".")
    """Folder of the capture, or its address in object storage: s3://bucket/folder, gs://... or az://.... A relative
    path in a YAML file is relative to that file; on the command line, to the working directory. All patterns below are
    relative to it."""

    images: Annotated[str, Affects("cameras_from_images", *_DEFAULT.results)] = "auto"
    """Pattern of the footage with {camera} and, for still images, {frame}. Examples: videos/{camera}.mp4 (one video per
    camera), images/{camera}/{frame:06d}.png (one folder of images per camera), photos/{camera}.jpg (a single frame).
    auto: search the usual layouts."""

    rig: Annotated[str | None, Affects(), Empty("none")] = "auto"
    """Calibration file or folder, relative to root, in any format of docs/reference/files.md, or the pattern of
    OpenCV's files if there is one per camera: {camera}/config.xml. auto: the one found under a usual name; if there is
    none, calibrate from the footage. null: always calibrate from the footage."""

    audio: Annotated[str | None, Affects("sound"), Empty("none")] = None
    """Sound of the performance: an audio file (WAV or anything else that FFmpeg reads) relative to root, or the name of
    a camera whose video has sound. null: none. It is cut to the take, and becomes part of the stream and of exported
    movies."""

    audio_offset: Annotated[
        float, Unbounded("an offset beyond the take is refused when the sound is cut"), Affects("sound")
    ] = 0.0
    """Seconds from the first frame of the footage to the beginning of the sound (capture.frames does not change it).
    Positive: the sound starts later; negative: its beginning is cut off."""

    masks: Annotated[
        MaskKind | ImportPath | Annotated[tuple[EvidenceKind | ImportPath, ...], Field(min_length=1)], Heading("Masks")
    ] = "auto"
    """How to separate the performer from the background. alpha: the images' alpha channel. files: mask files.
    clean_plate: difference from images of the empty set. median_background: difference from a background that is
    estimated for each camera alone. chroma_key: a screen of one color. plain: the performer has already been cut out on
    plain white or black. model: a matting model. none: everything is foreground. MODULE:NAME: a source of your own in a
    Python module. A list, such as [clean_plate, model]: all of them are evidence, on which three cameras or more agree.
    auto: alpha, files or plain if one of them fits; otherwise, cameras agree on all the evidence that there is: clean
    plates or the background, a green or blue screen, and the mask_model. If there is none, steps that need masks stop.
    See docs/guides/masks.md."""

    mask_files: str = "auto"
    """Pattern of the mask files: soft masks, or labels, of which all but 0 are the performer. With {object}, several
    files are joined to one mask. auto: search folders with names such as masks, mattes, seg or alpha."""

    mask_labels: Annotated[tuple[Annotated[int, Field(ge=0, le=65535)], ...], Empty("all but 0")] = ()
    """If the values of mask files are labels, such as numbers of people: the labels of the performer. Empty: all but 0.
    [0] inverts the masks, also soft ones."""

    clean_plates: str = "auto"
    """Pattern of the clean plates, one image (or a video, whose median is used) per camera. auto: search folders named
    clean_plates, clean_plate, bg, background, backgrounds or plates."""


class DifferenceSettings(Settings):
    """Masks from the difference between the footage and a known background."""

    affects: ClassVar[Affects | None] = _DEFAULT

    mask_sensitivity: float = Field(default=1.0, gt=0, le=10)
    """For masks from clean plates, median or screen: above 1 detects more foreground, below 1 less."""

    mask_shadows: Literal["none", "gray", "colored"] = "gray"
    """For masks from clean plates, median or screen: which parts of the background count as shadow rather than
    performer. gray: darkened background. colored (not for screens): also where its color changes, as in shadows of
    colored lights, or where it is very dark (down to 12% of its brightness). Thin or dark parts of the performer in
    front of a set without texture can be lost; see docs/guides/masks.md."""

    mask_components: Annotated[int | None, Empty("any number")] = Field(default=None, ge=1)
    """For masks from clean plates, median, screen or model, and agreed ones: maximum number of connected components per
    camera, largest first. null: no limit (except noise)."""


# Fields of the last base come first.
class CaptureSettings(DifferenceSettings, FileSettings):
    """The footage: where its images, cameras and masks are, and which of them to use. Passed to `open_footage`."""

    key_color: Color | Literal["auto"] = "auto"
    """For masks from a screen: its approximate color in the footage (red, green, blue; 0 to 1), which must be
    saturated. auto: for each camera, the saturated color that covers most of the image."""

    garbage_masks: Annotated[Name | None, Heading("Garbage masks"), Empty("none")] = None
    """Where the performer never is, for all sources of masks: the pattern of images that are black there and white
    elsewhere, such as garbage/{camera}.png, or a YAML file with polygons, such as garbage.yaml; take:garbage.yaml is
    what was drawn in the window. Cameras without one are not restricted. null: none. See docs/guides/masks.md."""

    mask_model: Annotated[str | None, Heading("Matting model"), Empty("none")] = "auto"
    """Matting model for masks. Where cameras agree on masks, it is evidence, and sees each person alone. auto: selfie,
    which is included, where it sees people. null: none. selfie or isnet: a model of `v3studio models`. KIND:FILE: your
    own; example: birefnet:models/mine.onnx, relative to root. The kind (u2net, birefnet, isnet, modnet, selfie or
    plain) is how the model was trained: the normalization of its input, its size unless the file fixes it, and whether
    its output is logits. plain: RGB from 0 to 1 at the size of the image. Input: one RGB image (1x3xHxW, float).
    Output: a mask from 0 to 1. ONNX files require onnxruntime."""

    set: Annotated[Literal["auto", "none"], Heading("Set"), Affects("set")] = "auto"
    """Whether the set behind the performer is reconstructed, too, once for the take. auto: yes, from clean plates or
    from what the footage shows outside of the masks; not if it shows no set, as before a screen or where performers
    are already cut out. See docs/guides/set.md."""

    fps: Annotated[float | None, Heading("Rate and color"), Affects("manifest", "evaluation"), Empty("as filmed")] = (
        Field(default=None, gt=0, lt=10_000)
    )
    """Frame rate of the footage in frames per second. null: that of the videos; 30 for still images. The take has this
    rate divided by the step of capture.frames."""

    color_matrix: Annotated[Literal["auto", "bt601", "bt709"], _PIXELS] = "auto"
    """YUV to RGB matrix of videos. auto: the file's tag; BT.601 if untagged, as in FFmpeg."""

    transfer: Annotated[TransferFunction, _PIXELS] = "auto"
    """What the values in the footage and the clean plates mean. srgb: as screens show them. linear: scene-linear light.
    slog3: Sony S-Log3. logc3: ARRI LogC3 (EI 800). The last three are converted to sRGB; light above 1 is clipped, and
    primaries are not converted. auto: EXR files are linear, everything else is srgb."""

    cameras: Annotated[
        tuple[CameraName, ...], Heading("Cameras"), Empty("all"), Affects("cameras_from_file", *_PIXELS.results)
    ] = ()
    """Names of the cameras to use. Empty: all."""

    held_out: Annotated[tuple[CameraName, ...], Affects("training_views", "evaluation", "manifest"), Empty("none")] = ()
    """Cameras that are excluded from training and used for evaluation. The entry "every 8" stands for every eighth
    camera by name (the 8th, 16th, ...)."""

    scale: Annotated[float, Heading("Frames and sizes"), Affects("training_views", "evaluation")] = Field(
        default=1.0, gt=0, le=1
    )
    """Image scale: 0.5 halves width and height (area filter)."""

    frames: Annotated[str | None, Affects("grouping", "evaluation"), Empty("all")] = None
    """Frames to use, as numbered in the files: A:B for frames A to B - 1, A:B:S for every S-th of them, each shown S
    times as long. Without A or B, it begins with the first or ends with the last frame: 60: or :20 or ::2. null: all
    frames."""

    offsets: Annotated[
        dict[str, int],
        Unbounded("offsets beyond the footage leave no frames"),
        Empty("none"),
        Affects("cameras_from_images", "cameras_from_target", *_DEFAULT.results),
    ] = Field(default={})
    """Synchronization offsets in frames: with {cam03: 2}, frame f + 2 of cam03 is used as frame f. Applies to images,
    masks and calibrate.board_images. `v3studio sync` estimates them."""

    size_rule: Annotated[SizeRule, Affects("cameras_from_points", "training_views", "evaluation")] = "auto"
    """How the footage was resized if its aspect ratio differs from the calibration's. stretch: the axes were scaled
    independently. crop: the image was cropped symmetrically. letterbox: bars were added symmetrically. auto: letterbox
    if black bars are detected, otherwise an error."""

    @field_validator("key_color", mode="wrap")
    @classmethod
    def _color_or_auto(cls, value: Any, check: ValidatorFunctionWrapHandler) -> Any:
        try:
            color = check(value)
        except ValidationError:  # one message instead of one per alternative type
            raise Conflict("must be auto or three numbers from 0 to 1", "Example: [0.2, 0.6, 0.3].") from None
        if color != "auto" and not _is_saturated(color):
            raise Conflict("gray and black cannot be keyed", "Use a saturated color such as [0.2, 0.6, 0.3], or auto.")
        return color

    @field_validator("mask_model")
    @classmethod
    def _names_model(cls, value: str | None) -> str | None:
        kind, _, file = (value or "auto").partition(":")
        names = ("auto", *get_args(ModelName))
        if (file and kind in get_args(ModelKind)) or value is None or value in names:
            return value
        kinds = f"Kinds: {', '.join(get_args(ModelKind))}. Example: isnet:models/isnet.onnx."
        raise Conflict(f"must be {', '.join(names)} or KIND:FILE", kinds)

    @property
    def frame_range(self) -> tuple[int | None, int | None, int]:
        """First frame, frame to stop before, and step of `frames`; None: from the first or to the last one."""
        return parse_frame_range(self.frames or ":")

    @field_validator("frames")
    @classmethod
    def _range(cls, value: str | None) -> str | None:
        try:
            parse_frame_range(value or ":")
        except ValueError:
            raise Conflict("must be a range A:B or A:B:S", "Example: 0:20 for frames 0 to 19.") from None
        return value

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        if {"clean_plate", "median_background"} <= set(self.masks):
            raise Conflict(
                "masks contains two sources of the empty set", "Keep clean_plate or median_background.", "masks"
            )
        for what in ("cameras", "held_out"):
            names = getattr(self, what)
            if len(set(names)) != len(names):
                raise Conflict(f"{what} contains a camera twice ({', '.join(names)})", "Remove one.", what)
        for entry in self.held_out:
            if EVERY.fullmatch(entry) and int(entry.split()[1]) < 2:
                raise Conflict(f"held_out = {entry} holds out all cameras", "Hold out every 2nd or fewer.", "held_out")
        return self
