"""The settings models. The text under a field is its documentation, shown by `v3studio config` and in the window.

Defaults are the paper's where it names a value. Functions of `studio` take plain arguments; the `to_...` methods here
are the only places where settings become such arguments.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator


class Section(BaseModel):
    """Common rules: unknown keys are refused, values are checked strictly, models cannot be changed."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, validate_default=True, allow_inf_nan=False
    )


Colour = tuple[
    Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]
]


class CaptureSection(Section):
    """The footage: where its images, cameras and masks lie."""

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

    masks: Literal["auto", "none", "alpha", "files", "clean_plate", "median_background"] = "auto"
    """How the performer is told from the room: the images' alpha channel, mask files, pictures of the empty room
    (clean_plate), the footage's median over time as such a picture (median_background), or not at all (none). auto
    takes the first of alpha, files, clean_plate that the capture has, else the median of 10 frames or more."""

    mask_files: str = "auto"
    """Pattern of the mask files, white = performer; auto looks in folders named mask, masks, matte, mattes, alpha."""

    clean_plates: str = "auto"
    """Pattern of the pictures of the empty room; auto looks in folders named clean_plates, clean_plate, bg,
    background, backgrounds."""

    evaluation_mattes: str = ""
    """Pattern of exact mattes, where the capture has them; only evaluation looks at them, training never does."""

    mask_sensitivity: float = Field(default=1.0, gt=0, le=10)
    """Masks from plates or the median: above 1 finds more performer, below 1 less."""

    mask_shadows: bool = True
    """Masks from plates or the median: what looks like the background under less light is shadow, not performer."""

    mask_components: int = Field(default=0, ge=0)
    """Masks from plates or the median: separate pieces of performer a camera may see, largest first; 0 is any."""

    fps: float | None = Field(default=None, gt=0, lt=10_000)
    """Frames per second of the footage; null takes it from the videos, and 30 for still images."""

    color_matrix: Literal["auto", "bt601", "bt709"] = "auto"
    """YUV to RGB of videos: auto believes the file's tag and takes BT.601 where there is none."""

    background: Colour = (0.0, 0.0, 0.0)
    """Background colour behind the performer in evaluation and pictures, red green blue, 0 to 1."""

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

    offsets: dict[str, int] = {}
    """Cameras that are late or early, with the frames that they lag: {cam03: 2} takes its frame f + 2 for frame f.
    `v3studio sync` estimates them from sound or motion."""

    size_rule: Literal["auto", "stretch", "crop", "letterbox"] = "auto"
    """What to do where footage has not the aspect ratio of its calibration: both axes were scaled on their own
    (stretch), it was cut evenly on both sides (crop), bars were added evenly (letterbox); auto refuses unless it sees
    black bars."""

    cache_megabytes: int | None = Field(default=None, ge=16)
    """Memory that decoded images may take; null is an eighth of the machine's memory, at most 2 GiB."""

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


class BoardSection(Section):
    """The calibration board; `v3studio board` prints one."""

    kind: Literal["charuco", "chessboard"] = "charuco"
    """charuco: squares with markers, parts of it are enough; chessboard: all of it must be in view."""

    columns: int = Field(default=8, ge=3, le=100)
    """Squares in a row; a chessboard of 7 x 4 inner corners has 8 x 5 squares."""

    rows: int = Field(default=5, ge=3, le=100)
    """Rows of squares."""

    square: float = Field(default=0.06, gt=0, lt=10)
    """Side of a square in metres, measured on the print."""

    marker: float = Field(default=0.045, gt=0, lt=10)
    """Side of a marker in metres; ChArUco only."""

    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the markers' dictionary; ChArUco only."""

    legacy: bool = False
    """The board was drawn by OpenCV before 4.6 (with an even number of rows it begins with a white square)."""

    inverted: bool = False
    """Black and white are exchanged."""


class CalibrateSection(Section):
    """Cameras from the footage or from a board, where none are given."""

    board_images: str = ""
    """Pattern of synchronized footage in which a board is moved about before the cameras, as in board/{camera}.mp4;
    the cameras then come from the board. "" takes them from the capture's own footage."""

    lens_images: str = ""
    """Pattern of pictures of the board of each camera on its own, for the lenses: lenses/{camera}/*_{frame}.jpg."""

    board: BoardSection = BoardSection()
    """What the board is like."""

    board_frames: int = Field(default=300, ge=1)
    """Most frames a camera in which the board is looked for; they are spread over the footage."""

    board_origin: int | None = None
    """Frame of board_images whose board gives the origin, x along its columns, and up; null takes the point that the
    cameras look at, and the cameras' up. Metres in any case."""

    board_stands: bool = False
    """In board_origin's frame the board stands upright, instead of lying on the floor."""

    frame: int | None = None
    """Frame to calibrate from, in the numbers that the files have; null is the first that is used."""

    frames: int = Field(default=1, ge=1, le=100)
    """How many moments, spread over the frames that are used, are taken together; the cameras stand still meanwhile.
    Each takes as long as the first and makes the cameras surer: noise averages out, the performer is elsewhere."""

    look_at: Literal["everything", "room", "performer"] = "everything"
    """Where features are looked for: room leaves the performer out, performer leaves the room out; both need masks."""

    lens: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"] = "SIMPLE_RADIAL"
    """COLMAP's model of the lenses: more terms follow stronger distortion and need more features."""

    shared_lens: bool = False
    """All cameras have one lens in common (one camera carried about, or lenses locked alike)."""

    lens_groups: tuple[tuple[str, ...], ...] = ()
    """Names of cameras that have one lens in common, a list a group, as in [[cam01, cam02], [cam03, cam04]]."""

    known: str = ""
    """Camera file whose lenses are known, relative to capture.root; with known_poses its cameras' places are, too."""

    keep_known: bool = True
    """Lenses of known (or of lens_images) are kept; false begins with them and refines them."""

    known_poses: bool = False
    """known is an older solution of this rig: the new footage is put into it, which takes a fraction of the time."""

    keep_poses: bool = False
    """With known_poses: the cameras stay where they are; false follows cameras that were touched since."""

    scale_between: tuple[str, ...] = ()
    """Two cameras whose distance is known, as in [cam01, cam05]; it gives the scale."""

    scale_distance: float | None = Field(default=None, gt=0)
    """Metres between the centres of the two cameras of scale_between."""

    floor: bool = False
    """Look for the floor among the sparse points: it gives up, and the height 0. Needs a textured floor."""

    focal_factor: float = Field(default=1.2, gt=0, le=100)
    """First guess of the focal lengths, in longer image sides."""

    refine_principal_point: bool = False
    """Estimate the principal points too; needs many well spread features."""

    max_features: int = Field(default=8192, ge=100)
    """Most features a camera."""

    max_image_size: int = Field(default=2400, ge=64)
    """Longer side in pixels above which features are found in a reduced image."""

    guided: bool = False
    """Match again along the epipolar lines: more matches, longer."""

    mapper: Literal["auto", "incremental", "global"] = "auto"
    """How the cameras are put together; auto tries incremental, then weaker demands, then global."""


class InitialiseSection(Section):
    """Points for each group's keyframe, from the visual hull of the masks."""

    points: int = Field(default=50_000, ge=100, le=5_000_000)
    """How many points are sampled on the hull's surface."""

    resolution: int = Field(default=256, ge=16, le=1024)
    """Voxels along the hull's longest side; fewer where pixels are coarser than that."""

    tolerance: float = Field(default=0.1, ge=0, le=0.5)
    """Share of the cameras whose masks the others may outvote; 0 turns the vote off."""

    min_view_share: float | None = Field(default=None, ge=0, le=1)
    """Share of the cameras that must see a point for it to count; null is one half, and less where that leaves
    performer unexplained."""

    smoothing: float = Field(default=0.7, ge=0, le=10)
    """Smoothing of the surface, in voxels."""

    max_faces: int = Field(default=200_000, ge=100)
    """Most faces of the mesh."""


class RatesSection(Section):
    """Learning rates of the splats (Adam), as in 3D Gaussian Splatting."""

    means: float = Field(default=6e-4, gt=0)
    """Positions at the first step, times the diagonal of the performer's box; decays exponentially to means_final."""

    means_final: float = Field(default=6e-6, gt=0)
    """Positions at the last step, times the scene's extent."""

    means_finetune: float = Field(default=6e-5, gt=0)
    """Positions while fine-tuning a later frame (finetune_means), times the scene's extent."""

    sh_dc: float = Field(default=2.5e-3, gt=0)
    """Constant colour."""

    sh_rest: float = Field(default=1.25e-4, gt=0)
    """View-dependent colour."""

    opacity: float = Field(default=0.05, gt=0)
    """Logit of the opacity."""

    scale: float = Field(default=5e-3, gt=0)
    """Logarithm of the scale."""

    rotation: float = Field(default=1e-3, gt=0)
    """Quaternion."""


class TrainSection(Section):
    """Training a group: a keyframe, then frame after frame motion and fine-tuning."""

    group_size: int = Field(default=20, ge=1, le=1000)
    """Frames a group, at most; its first frame is the keyframe. The paper takes 20."""

    grouping: Literal["fixed", "motion"] = "fixed"
    """Where groups begin: fixed cuts every group_size frames; motion looks at the footage and cuts earlier where the
    performer has changed too much since the keyframe."""

    group_change: float = Field(default=0.4, gt=0, lt=1)
    """For grouping by motion: change of the performer's pictures, his place taken out, at which a new group begins;
    0 is the same picture, 1 nothing alike. Groups have 4 frames at least."""

    check_footage: bool = True
    """Read all frames once before training and refuse what is broken (unreadable files, empty or all-white masks).
    false meets such frames when they come up; a camera that does not see the performer is then left out of a frame."""

    sh_degree: int = Field(default=0, ge=0, le=3)
    """Degree of the spherical harmonics: 0 is one colour a splat, 3 the most view-dependent."""

    dssim_weight: float = Field(default=0.2, ge=0, le=1)
    """Weight of D-SSIM against L1, lambda of the paper's equation 7."""

    alpha_weight: float = Field(default=0.0, ge=0)
    """Weight of the difference between drawn coverage and mask; 0 leaves coverage to the background."""

    opacity_reg: float = Field(default=0.01, ge=0)
    """Weight of the keyframe's mean opacity: what no picture needs fades and is pruned."""

    scale_reg: float = Field(default=0.2, ge=0)
    """Weight of the keyframe's mean splat size, relative to the performer's size."""

    background: Literal["random", "black", "white"] = "random"
    """What stands behind the performer while training; random teaches coverage."""

    dropout: float = Field(default=0.2, ge=0, lt=1)
    """Share of the splats that each step leaves out: what is left must be right by itself, which helps views that were
    never trained on."""

    use_plates: bool = True
    """Where the capture has clean plates: compare footage as filmed with the splats drawn over the plate, instead of
    cutting the performer out by the mask, whose errors then do little harm."""

    crop_margin: float = Field(default=0.15, ge=0, le=10)
    """Only the performer's box is trained on, padded by this share of its size."""

    keyframe_iterations: int = Field(default=12_000, ge=1)
    """Steps of the keyframe before pruning."""

    density: Literal["gradient", "mcmc"] = "gradient"
    """How splats find their places: gradient clones and splits as 3DGS does; mcmc moves dead splats to where they are
    needed and grows to densify_max_splats."""

    mcmc_noise: float = Field(default=1.0, ge=0)
    """Strength of the exploration noise of density mcmc; 1 as published."""

    densify_from: int = Field(default=500, ge=0)
    """First step at which splats are cloned and split."""

    densify_until: int = Field(default=9_000, ge=0)
    """Last step at which splats are cloned and split."""

    densify_every: int = Field(default=100, ge=1)
    """Steps between two densifications."""

    densify_gradient: float = Field(default=2e-4, gt=0)
    """Mean gradient on screen above which a splat is cloned or split."""

    densify_max_splats: int = Field(default=300_000, ge=1)
    """No densification beyond this count."""

    opacity_reset_every: int = Field(default=3_000, ge=1)
    """Steps between two resets of the opacity while densifying."""

    sh_degree_every: int = Field(default=1_000, ge=1)
    """One more degree of spherical harmonics is trained after this many steps."""

    prune_ratio: float = Field(default=0.3, gt=0, lt=1)
    """Share of the splats, those with the lowest opacity, that one round of pruning removes."""

    prune_rounds: int = Field(default=1, ge=0, le=50)
    """Rounds of pruning at least; more follow until max_splats holds."""

    max_splats: int = Field(default=100_000, ge=1, le=10_000_000)
    """Cap of the splats after pruning. The paper stays under 100,000."""

    prune_finetune_iterations: int = Field(default=2_000, ge=0)
    """Steps after each round of pruning."""

    motion_iterations: int = Field(default=500, ge=0)
    """Steps of the motion network a frame. The paper takes 500."""

    motion_first_iterations: int | None = Field(default=None, ge=0)
    """Steps of it for the frame after each keyframe, which has no velocity to start from; null: as the others."""

    motion_learning_rate: float = Field(default=1e-3, gt=0)
    """Adam, network weights; the hash grid takes ten times that."""

    motion_views: int = Field(default=4, ge=1, le=1000)
    """Cameras that each step of the motion network looks at: several make a step surer, and drawing is cheap beside the
    network."""

    motion_velocity: bool = True
    """Start from the motion of the frame before and learn the rest."""

    motion_warm_start: bool = False
    """Begin with the network of the frame before (and without the velocity guess) instead of a fresh one."""

    motion_neighbours: int = Field(default=0, ge=0, le=1000)
    """Each splat turns as the offsets to this many nearest splats do; 0: translation only, as in the paper."""

    hash_levels: int = Field(default=16, ge=1, le=32)
    """Levels of the motion network's hash grid."""

    hash_features: int = Field(default=4, ge=1, le=16)
    """Features a level."""

    hash_log2_size: int = Field(default=15, ge=4, le=24)
    """Entries a level, as a power of two."""

    hash_base_resolution: int = Field(default=16, ge=1, le=4096)
    """Resolution of the coarsest level."""

    hash_growth: float = Field(default=1.5, gt=1, le=4)
    """Each level is this much finer than the one before."""

    mlp_width: int = Field(default=64, ge=1, le=1024)
    """Neurons a hidden layer of the motion network."""

    mlp_layers: int = Field(default=2, ge=1, le=8)
    """Hidden layers of the motion network."""

    finetune_iterations: int = Field(default=2_000, ge=0)
    """Steps of fine-tuning a frame after the motion. The paper takes 2000."""

    finetune_means: bool = False
    """Tune positions as well; the paper tunes the other attributes only."""

    entropy_weight: float = Field(default=1e-4, ge=0)
    """Weight of the residual entropy loss, lambda_e of the paper's equation 13."""

    temporal_weight: float = Field(default=1e-3, ge=0)
    """Weight of the temporal loss, lambda_t of the paper's equation 13."""

    temporal_huber: float = Field(default=0.0, ge=0)
    """0: the temporal loss is the paper's L1. Above 0: a Huber loss, quadratic up to this many quantisation steps."""

    simulate_quantisation: bool = False
    """While fine-tuning, draw the attributes as the baker will round them."""

    rates: RatesSection = RatesSection()
    """Learning rates of the splats."""

    checkpoint_every: int = Field(default=500, ge=0)
    """Steps between two checkpoints of a keyframe in training, from which a broken run goes on; 0 makes none."""


QP = Annotated[int, Field(ge=0, le=51)]


class BakeSection(Section):
    """From trained Gaussians to the stream."""

    profile: Literal["motion", "planes"] = "motion"
    """motion: blocks of splats that move alike, and one small video of what that leaves. planes: the paper's, a video
    for each number of a splat."""

    qp: QP = 20
    """Quantisation parameter: 0 is lossless, higher is smaller and coarser. In planes, above 22 colour, scale and
    rotation stay at 22 and the rest follows, as in the paper; the positions' high bytes are always lossless."""

    target_kb_per_frame: Annotated[float, Field(gt=0)] | None = None
    """Instead of qp: the best quality at which each group's files have at most this many kilobytes (1000 bytes) a
    frame."""

    target_psnr: Annotated[float, Field(gt=0, le=100)] | None = None
    """Instead of qp: the smallest stream whose decoded frames, drawn from a few cameras, reach this PSNR in dB against
    the frames as trained, in each group."""

    codec: Literal["h264", "hevc", "av1"] = "h264"
    """h264 plays everywhere; motion can also be written as hevc or av1."""

    attribute_qps: dict[Literal["means_low", "opacities", "scales", "quats", "sh"], QP] = {}
    """QPs that replace that rule for single attributes, as in {opacities: 26}."""

    preset: Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"] = (
        "medium"
    )
    """How hard the encoder tries: slower ones spend fewer bytes."""

    mirror_low_bytes: bool = True
    """Let the positions' low bytes run backwards where the high byte is odd, so that they do not jump from 255 to 0.
    false gives the paper's plain low byte."""

    @model_validator(mode="after")
    def _fits_together(self) -> BakeSection:
        if self.target_kb_per_frame is not None and self.target_psnr is not None:
            raise ValueError("target_kb_per_frame and target_psnr are both set; give one of them")
        if self.profile == "planes" and self.codec != "h264":
            raise ValueError(f"codec = {self.codec} is written for profile = motion only")
        if self.codec == "av1" and self.qp == 0:
            raise ValueError("qp = 0 (lossless) is not written as av1; choose h264 or hevc, or qp = 1")
        return self


class EvaluateSection(Section):
    """Measuring what was trained and what was baked."""

    crop_padding: int = Field(default=8, ge=0, le=10_000)
    """Figures are taken in the box of the performer's mask, padded by this many pixels."""

    report_frames: int = Field(default=4, ge=1, le=100)
    """How many frames the report shows pictures of, spread over the take."""

    report_width: int = Field(default=420, ge=64, le=4096)
    """Pictures in the report are at most this many pixels wide."""


class RunSection(Section):
    """The run itself."""

    seed: int = Field(default=0, ge=0, lt=2**31)
    """Seed of all that is random: the same seed gives the same take."""

    device: str = "auto"
    """Where training and drawing run: cpu, cuda, cuda:1, or auto (a GPU where there is one)."""

    threads: int = Field(default=0, ge=0, le=1024)
    """CPU threads; 0 takes all cores."""

    groups_at_once: int | None = Field(default=None, ge=1, le=64)
    """Groups that are trained side by side, sharing the CPU threads; null: on a CPU as many as there are threads and
    memory for, 8 at most; on a GPU one."""

    preview_seconds: float = Field(default=20.0, ge=0)
    """Least time between two preview pictures while training; 0 draws none."""

    @field_validator("device")
    @classmethod
    def _known_device(cls, value: str) -> str:
        kind, _, index = value.partition(":")
        if kind not in ("auto", "cpu", "cuda") or (index and (kind != "cuda" or not index.isdigit())):
            raise ValueError("must be auto, cpu, cuda or cuda:N")
        return value


class Config(Section):
    """All settings of a run."""

    capture: CaptureSection = CaptureSection()
    calibrate: CalibrateSection = CalibrateSection()
    initialise: InitialiseSection = InitialiseSection()
    train: TrainSection = TrainSection()
    bake: BakeSection = BakeSection()
    evaluate: EvaluateSection = EvaluateSection()
    run: RunSection = RunSection()
