"""Settings of the footage."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, field_validator, model_validator

from pipelines.config.section import Color, Section

_Deviation = Annotated[float, Field(gt=0, le=10)]


class CaptureSection(Section):
    """The footage: where its images, cameras and masks lie."""

    headings: ClassVar[dict[str, str]] = {
        "root": "Files",
        "masks": "Masks",
        "key_color": "Masks: colored screen",
        "garbage_mattes": "Masks: model, garbage mattes",
        "fps": "Rate and color",
        "cameras": "Cameras",
        "scale": "Frames and sizes",
    }

    root: Path = Path(".")
    """Folder of the capture. In a YAML file a relative path is relative to that file; on the command line, to the
    folder you are in. All patterns below are relative to it."""

    images: str = "auto"
    """Pattern of the footage with {camera} and, for still images, {frame}: videos/{camera}.mp4 is a video a camera,
    images/{camera}/{frame:06d}.png a folder of images a camera, photos/{camera}.jpg a single moment; auto looks."""

    rig: str | None = "auto"
    """File or folder with the calibration (rig.json, cameras.json, transforms.json, a COLMAP model, *.qca.txt),
    relative to root. auto takes the one that lies there under a usual name, and calibrates from the footage where
    there is none; null always calibrates from the footage."""

    masks: Literal[
        "auto", "none", "alpha", "files", "clean_plate", "median_background", "chroma_key", "plain", "model"
    ] = "auto"
    """How the performer is told from the room: the images' alpha channel, mask files, pictures of the empty room
    (clean_plate), the footage's median over time as such a picture (median_background), a screen of one color behind
    him (chroma_key), pictures of him cut out before plain white or black (plain), a matting model (model), or not at
    all (none). auto takes the first of alpha, files, clean_plate, plain that the capture has, else the median of 10
    frames or more. docs/MASKS.md tells which to choose."""

    mask_files: str = "auto"
    """Pattern of the mask files, white = performer; auto looks in folders named mask, masks, matte, mattes, alpha."""

    clean_plates: str = "auto"
    """Pattern of the pictures of the empty room; auto looks in folders named clean_plates, clean_plate, bg,
    background, backgrounds."""

    evaluation_mattes: str = ""
    """Pattern of exact mattes, where the capture has them; only evaluation looks at them, training never does."""

    mask_sensitivity: float = Field(default=1.0, gt=0, le=10)
    """Masks from plates, the median or a screen: above 1 finds more performer, below 1 less."""

    mask_shadows: bool = True
    """Masks from plates, the median or a screen: what looks like the background under less light is shadow, not
    performer."""

    mask_components: int = Field(default=0, ge=0)
    """Masks from plates, the median, a screen or a model: separate pieces of performer a camera may see, largest first;
    0 is any."""

    key_color: Color | Literal["auto"] = "auto"
    """Masks from a screen: about its color as the footage shows it, red green blue, 0 to 1. auto finds, for each
    camera, the saturated color that covers most of the picture."""

    despill: bool = True
    """Masks from a screen: take its light off the performer's outline, in the images that training and evaluation
    see."""

    garbage_mattes: str = ""
    """Masks from a screen or a model: pattern of pictures that are black where the performer never is (the studio's
    ceiling, stands) and white elsewhere, garbage/{camera}.png; cameras without one are looked at whole."""

    mask_model: str = ""
    """Masks from a model: its ONNX file, relative to root. It must take one RGB picture (1x3xHxW, floats) and give a
    matte of 0 to 1. Needs the extra matting (onnxruntime)."""

    mask_model_size: int = Field(default=0, ge=0, multiple_of=32)
    """Masks from a model: pixels of the longer side that pictures are resized to for it, a multiple of 32; 0 is the
    size that the file has fixed, else the pictures' own."""

    mask_model_mean: Color = (0.485, 0.456, 0.406)
    """Masks from a model: subtracted from pictures of 0 to 1 before it sees them, red green blue. The default (of
    ImageNet) suits BiRefNet and U2-Net; MODNet and IS-Net want [0.5, 0.5, 0.5]."""

    mask_model_std: tuple[_Deviation, _Deviation, _Deviation] = (0.229, 0.224, 0.225)
    """Masks from a model: what they are divided by then. The default (of ImageNet) suits BiRefNet and U2-Net; MODNet
    wants [0.5, 0.5, 0.5], IS-Net [1, 1, 1]."""

    mask_model_sigmoid: bool = False
    """Masks from a model: it gives logits, as BiRefNet does, which a sigmoid turns into 0 to 1."""

    fps: float | None = Field(default=None, gt=0, lt=10_000)
    """Frames per second of the footage; null takes it from the videos, and 30 for still images."""

    color_matrix: Literal["auto", "bt601", "bt709"] = "auto"
    """YUV to RGB of videos: auto believes the file's tag and takes BT.601 where there is none."""

    background: Color = (0.0, 0.0, 0.0)
    """Background color behind the performer in evaluation and pictures, red green blue, 0 to 1."""

    cameras: tuple[str, ...] = ()
    """Names of the cameras to use; empty means all."""

    held_out: tuple[str, ...] = ()
    """Cameras that training never sees; evaluation draws and measures them."""

    held_out_every: int = Field(default=0, ge=0)
    """Hold out every n-th camera as well, in name order; 0 means none."""

    scale: float = Field(default=1.0, gt=0, le=1)
    """Size at which images are used: 0.5 halves width and height."""

    start: int | None = None
    """First frame, in the numbers that the files have; null is the first there is."""

    stop: int | None = None
    """Frame to stop before, in the numbers that the files have; null goes to the end."""

    step: int = Field(default=1, ge=1)
    """Take each step-th frame."""

    offsets: dict[str, int] = Field(default={})
    """Cameras that are late or early, with the frames that they lag: {cam03: 2} takes its frame f + 2 for frame f.
    `v3studio sync` estimates them from sound or motion."""

    size_rule: Literal["auto", "stretch", "crop", "letterbox"] = "auto"
    """What to do where footage has not the aspect ratio of its calibration: both axes were scaled on their own
    (stretch), it was cut evenly on both sides (crop), bars were added evenly (letterbox); auto refuses unless it sees
    black bars."""

    cache_megabytes: int | None = Field(default=None, ge=16)
    """Memory that decoded images may take; null is an eighth of the machine's memory, at most 2 GiB."""

    @field_validator("key_color", mode="wrap")
    @classmethod
    def _color_or_auto(cls, value: Any, check: ValidatorFunctionWrapHandler) -> Any:
        try:
            return check(value)
        except ValidationError:  # one sentence, not one for each of the two forms
            raise ValueError("must be auto or three numbers from 0 to 1, as in [0.2, 0.6, 0.3]") from None

    @model_validator(mode="after")
    def _fits_together(self) -> CaptureSection:
        if self.stop is not None and self.stop <= (self.start or 0):
            raise ValueError(f"stop = {self.stop} must lie behind start = {self.start or 0}")
        if self.held_out_every == 1:
            raise ValueError("held_out_every = 1 would hold out all cameras; give 0 (none) or at least 2")
        for what in ("cameras", "held_out"):
            names = getattr(self, what)
            if len(set(names)) != len(names):
                raise ValueError(f"{what} names a camera twice ({', '.join(names)})")
        return self
