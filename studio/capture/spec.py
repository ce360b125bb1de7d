"""What a user says about footage: where it lies and how to read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from studio.capture.mattes.screen_color import saturated
from studio.errors import StudioError

MASK_KINDS = ("auto", "none", "alpha", "files", "clean_plate", "median_background", "chroma_key", "plain", "model")
SIZE_RULES = ("auto", "stretch", "crop", "letterbox")


@dataclass(frozen=True)
class CaptureSpec:
    """Everything that `open_footage` needs to know of a capture.

    Patterns are paths below `root` (or absolute) with `{camera}`, `{frame}` (or `{frame:06d}` for exactly padded
    numbers), `*`, `?` and `**/`. `videos/{camera}.mp4` is one video a camera, `images/{camera}/{frame:06d}.png` a
    folder of images a camera, `{frame}/images/{camera}.png` a folder a frame, `images/{camera}.jpg` a single frame.

    Attributes:
        root: the capture's folder.
        images: pattern of the footage, or "auto": look for one of the usual layouts (`Footage.description` says which).
        masks: where the foreground comes from. "none": everything is foreground. "alpha": the images' alpha channel.
            "files": separate images or videos, white is foreground. "clean_plate": difference to a picture of the empty
            set. "median_background": difference to the set as recovered from the footage itself over time, for footage
            without a plate (the cameras must stand still). "chroma_key": what has not the color of the screen behind.
            "plain": the pictures show the performer cut out before one color, white or black. "model": a matting
            model. "auto": the first of alpha, files, clean plates that the capture has, else plain where pictures have
            one color all around, else the recovered set where there are at least 10 frames, else none.
        mask_files: pattern of the mask files; they may have another extension than the images. "auto" looks in folders
            named mask, masks, matte, mattes or alpha.
        clean_plates: pattern of the clean plates, one image (or video, of which the median is taken) a camera. "auto"
            looks in folders named clean_plates, clean_plate, bg, background or backgrounds.
        evaluation_mattes: pattern of exact mattes, used for measuring only; "" where there are none.
        mask_sensitivity: how far from the background a pixel must be to become foreground, relative to the noise of
            the footage: above 1 finds more foreground, below 1 less. Clean plates, median and colored screens only.
        mask_components: how many separate foreground pieces a camera may see at most, largest first; 0 is any number
            above the size of noise. Clean plates, median, colored screens and models only.
        mask_shadows: take pixels that look like the background under less light for shadows, not for the performer.
            Clean plates, median and colored screens only.
        key_color: about the color of the screen, (r, g, b) in 0..1, or "auto": found for each camera. "chroma_key"
            only.
        despill: take the screen's light off the performer's outline in the images handed out. "chroma_key" only.
        garbage_mattes: pattern of pictures that are black where the performer never is (the studio's ceiling, stands),
            one a camera, or a camera and frame; cameras without one keep all. "" where there are none. "chroma_key" and
            "model" only.
        mask_model: ONNX file of the matting model, below `root` or absolute; see `OnnxModel` for what it must be.
        mask_model_size, mask_model_mean, mask_model_std, mask_model_sigmoid: as in `OnnxSettings`.
        mask_device, mask_threads: what it is run on, as `device` and `threads` there.
        fps: frames a second; None takes the videos' own, or 30 for images.
        color_matrix: YUV to RGB of videos: "auto" believes the file's tag and takes BT.601 where there is none (as
            FFmpeg does); "bt601" or "bt709" overrule it.
        background: (r, g, b) in 0..1 behind the performer in training and evaluation.
        cameras: names of the cameras to use; empty means all.
        held_out: names of cameras that are never trained on, only measured.
        held_out_every: hold out every n-th camera too (n-th, 2n-th ... in name order); 0 means none.
        scale: size of the images handed out relative to the files, 0 < scale <= 1, area filter.
        start, stop, step: frames to use, in the numbers that the files have; stop is not included.
        offsets: camera to whole frames that it is late: its file's frame f + offset is frame f (`sync.check_sync`
            estimates them). Applies to images and mask files alike.
        size_rule: what to do where footage has not the aspect ratio of its calibration: "stretch" (both axes
            were scaled on their own), "crop" (cut evenly on both sides), "letterbox" (scaled, bars added evenly),
            "auto" (only where black bars are seen: letterbox; else refuse).
        cache_bytes: how much memory decoded images may take; None is an eighth of the machine's memory, at most 2 GiB.
    """

    root: Path
    images: str = "auto"
    masks: str = "auto"
    mask_files: str = "auto"
    clean_plates: str = "auto"
    evaluation_mattes: str = ""
    mask_sensitivity: float = 1.0
    mask_components: int = 0
    mask_shadows: bool = True
    key_color: str | tuple[float, float, float] = "auto"
    despill: bool = True
    garbage_mattes: str = ""
    mask_model: str = ""
    mask_model_size: int = 0
    mask_model_mean: tuple[float, float, float] = (0.485, 0.456, 0.406)
    mask_model_std: tuple[float, float, float] = (0.229, 0.224, 0.225)
    mask_model_sigmoid: bool = False
    mask_device: str = "auto"
    mask_threads: int = 0
    fps: float | None = None
    color_matrix: str = "auto"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cameras: tuple[str, ...] = field(default=())
    held_out: tuple[str, ...] = field(default=())
    held_out_every: int = 0
    scale: float = 1.0
    start: int | None = None
    stop: int | None = None
    step: int = 1
    offsets: Mapping[str, int] = field(default_factory=dict)
    size_rule: str = "auto"
    cache_bytes: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root))
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "held_out", tuple(self.held_out))
        object.__setattr__(self, "background", tuple(float(value) for value in self.background))
        if self.masks not in MASK_KINDS:
            raise StudioError(f"Capture: masks is '{self.masks}'; it must be one of {', '.join(MASK_KINDS)}.")
        if self.size_rule not in SIZE_RULES:
            raise StudioError(f"Capture: size_rule is '{self.size_rule}'; it must be one of {', '.join(SIZE_RULES)}.")
        if self.color_matrix not in ("auto", "bt601", "bt709"):
            raise StudioError(f"Capture: color_matrix is '{self.color_matrix}'; it must be auto, bt601 or bt709.")
        if not 0.0 < self.scale <= 1.0:
            raise StudioError(f"Capture: scale is {self.scale:g}; it must be above 0 and at most 1.")
        if self.step < 1:
            raise StudioError(f"Capture: step is {self.step}; it must be at least 1.")
        if self.fps is not None and not 0.0 < self.fps < 10000.0:
            raise StudioError(f"Capture: fps is {self.fps:g}; it must be above 0.")
        if self.held_out_every < 0 or self.held_out_every == 1:
            raise StudioError(f"Capture: held_out_every is {self.held_out_every}; it must be 0 (none) or at least 2.")
        if len(self.background) != 3 or not all(0.0 <= value <= 1.0 for value in self.background):
            raise StudioError(f"Capture: background is {self.background}; it must be three numbers in 0..1.")
        if not 0.0 < self.mask_sensitivity <= 10.0:
            raise StudioError(f"Capture: mask_sensitivity is {self.mask_sensitivity:g}; it must be in 0 to 10, not 0.")
        if self.mask_components < 0:
            raise StudioError(f"Capture: mask_components is {self.mask_components}; it must be 0 (any) or more.")
        if self.key_color != "auto":
            key = self.key_color
            if isinstance(key, str) or len(key) != 3 or not all(0.0 <= value <= 1.0 for value in key):
                raise StudioError(f"Capture: key_color is {key!r}; it must be auto or three numbers in 0..1.")
            if not saturated(key):
                raise StudioError(
                    f"Capture: key_color is {list(key)}, which is gray or black; give a saturated color, as "
                    "[0.2, 0.6, 0.3], or auto."
                )
        if self.mask_model_size < 0 or self.mask_model_size % 32:
            raise StudioError(f"Capture: mask_model_size is {self.mask_model_size}; it must be a multiple of 32, or 0.")
        if min(self.mask_model_std) <= 0.0:
            raise StudioError(f"Capture: mask_model_std is {self.mask_model_std}; its numbers must be above 0.")
