"""Settings of training. Defaults are the paper's values where it gives one, unless the field says otherwise."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from studio.dilation import DILATION, MAX_DILATION, MIN_DILATION
from studio.settings import Affects, Heading, Settings, Unbounded

GROUP_SIZE = 20
"""Frames per group in the paper."""

_LATER = Affects("later_frames")
"""For settings that only affect frames after the keyframe: changing them does not invalidate keyframes."""


class LearningRates(Settings):
    """Adam learning rates of the splats: those of 3DGS, as in the released V3 code, except for the means."""

    means: float = Field(default=6e-4, gt=0)
    """Means at the first step of a keyframe, as a multiple of the diagonal of the performer's bounding box. Decays
    exponentially to means_final. (3DGS's 1.6e-4 is relative to the camera spread, two to four times larger.)"""

    means_final: float = Field(default=6e-6, gt=0)
    """Means at the last step of a keyframe, as a multiple of the same diagonal."""

    means_finetune: Annotated[float, _LATER] = Field(default=6e-5, gt=0)
    """Means while fine-tuning a later frame (with finetune_means), as a multiple of the same diagonal."""

    sh_dc: float = Field(default=2.5e-3, gt=0)
    """Spherical harmonics of degree 0, the base color."""

    sh_rest: float = Field(default=1.25e-4, gt=0)
    """Spherical harmonics of degree 1 and higher, the view-dependent color."""

    opacity: float = Field(default=0.05, gt=0)
    """Opacities, as logits."""

    scale: float = Field(default=5e-3, gt=0)
    """Scales, as logarithms."""

    rotation: float = Field(default=1e-3, gt=0)
    """Rotations, as quaternions."""


class TrainSettings(Settings):
    """How a group is trained: the keyframe, then motion and fine-tuning of each later frame."""

    affects: ClassVar[Affects | None] = Affects("keyframe")

    sh_degree: Annotated[int, Heading("Losses and images")] = Field(default=0, ge=0, le=3)
    """Degree of the spherical harmonics: 0 is one color per splat, 3 the most view-dependent."""

    dssim_weight: float = Field(default=0.2, ge=0, le=1)
    """Weight of D-SSIM against L1: lambda in the paper's equation 7."""

    alpha_weight: float = Field(default=0.0, ge=0)
    """Weight of the L1 difference between rendered alpha and mask. 0: coverage is learned from the background only."""

    opacity_reg: float = Field(default=0.01, ge=0)
    """Keyframe: weight of the mean opacity. Splats that no image needs fade and are pruned, which leaves fewer floaters
    in held-out views (Kheradmand et al. 2024, section 4.4)."""

    scale_reg: float = Field(default=0.2, ge=0)
    """Keyframe: weight of the mean scale relative to the performer's size (Kheradmand et al. 2024, section 4.4)."""

    dilation: float = Field(default=DILATION, ge=MIN_DILATION, le=MAX_DILATION)
    """Added to the 2D covariance of each splat wherever it is drawn, in square pixels of that picture, here of the
    training images. Below 0.3, outlines and details are sharper, above all in pictures of another size than the
    training images. The stream carries the value, and the players here draw with it. Viewers of exported splats assume
    0.3."""

    background: Literal["random", "black", "white"] = "random"
    """Background color behind the performer during training. random: a new color at each step, from which splats learn
    their coverage."""

    dropout: float = Field(default=0.2, ge=0, lt=1)
    """Fraction of the splats left out of each step of the keyframe and of fine-tuning. Improves held-out views."""

    use_plates: bool = True
    """If the capture has clean plates, compare the unmasked footage with splats rendered over the plate instead of
    masking the performer. Reduces the effect of mask errors."""

    refine_masks: Annotated[Literal["auto", "always", "never"], Heading("Refined masks")] = "never"
    """Replace the masks by those that all cameras agree on, the splats' own drawn alpha with twice the contrast, when
    pruning of a keyframe and when fine-tuning of a later frame begin. auto: if the masks differ from them by more than
    refine_above. never: also leaves the weight of alpha_weight as it is."""

    refine_above: float = Field(default=0.22, ge=0)
    """For auto: mean distance between the outlines of given and refined masks, in pixels. On the sample capture, it is
    0.14 for exact masks and 0.33 for those from clean plates."""

    refine_moved_below: Annotated[float, _LATER] = Field(default=0.66, gt=0)
    """For auto in later frames: above this distance, in pixels, the motion was not found. The given masks are then
    kept until fine-tuning has brought the splats closer."""

    refine_every: int = Field(default=100, ge=1)
    """Steps after which the masks are refined again."""

    refined_alpha_weight: float = Field(default=1.0, ge=0)
    """alpha_weight from then on, if that is larger, also for masks that auto found good."""

    chroma_siting: Literal["auto", "left", "center", "none"] = "none"
    """Footage with subsampled chroma (4:2:0, 4:2:2) is compared with drawings that are subsampled in the same way, so
    that colors that bled over outlines are not learned. The grid is that of the video. Where the encoder took its
    samples: left (standard for H.264 and HEVC) or center (of many converters). auto: whichever fits the footage better.
    none: no subsampling. Only for videos that are used at full size and without lens distortion."""

    final_iterations: int = Field(default=0, ge=0)
    """Last steps of a keyframe's fine-tuning with final_dropout, which all fine-tuning of later frames has as well. 0:
    final_dropout is not used."""

    final_dropout: float = Field(default=0.1, ge=0, lt=1)
    """Fraction of the splats left out of these steps, if it is below dropout. Details become sharper."""

    camera_colors: Annotated[bool, Heading("Colors of cameras")] = False
    """Correct differences in color between cameras: a 3x4 matrix (with exposure) per camera, constant in a take, fitted
    before training and stored in train/camera_colors.json. The mean camera keeps its colors, and the stream has those.
    For rigs whose cameras differ in exposure, white balance or model."""

    camera_color_iterations: int = Field(default=600, ge=1)
    """Steps of a first training of the first keyframe to which the matrices are fitted."""

    camera_color_every: int = Field(default=150, ge=1)
    """Steps after which they are fitted again."""

    camera_vignettes: bool = True
    """With camera_colors, also fit by how much each camera's image is darker toward its corners, and correct it where
    that explains the image better than the matrix alone. Needs cameras in which the performer covers much of the image.
    Not with color_chart_frame."""

    color_chart_frame: Annotated[int | None, Unbounded("frame numbers are those of the footage")] = None
    """With camera_colors: frame in which cameras see a ColorChecker Classic (24 patches), counted as capture.start
    counts; it may lie before that. The matrices are then fitted to its patches instead of to splats. Cameras that do
    not see it are not corrected. `v3studio colors` shows what is found. null: no chart."""

    crop_margin: Annotated[float, Heading("Crops")] = Field(default=0.15, ge=0, le=10)
    """Padding of the performer's bounding box that images are cropped to, as a fraction of the box size (16 pixels are
    added)."""

    full_size_details: bool = True
    """With capture.scale below 1 and details marked (`v3studio edit detail`): compare these with the images at full
    size, so that faces keep more than capture.scale leaves of them."""

    keyframe_iterations: Annotated[int, Heading("Keyframe")] = Field(default=12_000, ge=1)
    """Training steps of the keyframe before pruning."""

    strategy: Literal["default", "mcmc", "error"] = "default"
    """Densification strategy. default: clone and split, as in 3DGS. mcmc: relocate dead splats and grow to
    densify_max_splats (Kheradmand et al. 2024). error: move splats that hardly contribute to where the pictures are
    wrong, and grow to densify_max_splats."""

    relocate_ratio: float = Field(default=0.05, ge=0, lt=1)
    """Strategy error: fraction of the splats that each densification moves."""

    mcmc_noise: float = Field(default=1.0, ge=0)
    """Strength of the exploration noise of strategy mcmc; 1 as published."""

    densify_from: int = Field(default=500, ge=0)
    """Densification starts after this step."""

    densify_until: int = Field(default=9_000, ge=0)
    """Densification stops at this step."""

    densify_every: int = Field(default=100, ge=1)
    """Steps between densifications."""

    densify_gradient: float = Field(default=2e-4, gt=0)
    """Strategy default: mean screen-space gradient (NDC) above which a splat is cloned or split."""

    densify_max_splats: int = Field(default=300_000, ge=1)
    """No densification above this number of splats (before pruning)."""

    opacity_reset_every: int = Field(default=3_000, ge=1)
    """Strategy default: steps between opacity resets; none in the last quarter of densification."""

    sh_degree_every: int = Field(default=1_000, ge=1)
    """Steps after which the next degree of the spherical harmonics is added to training, up to sh_degree."""

    prune_ratio: Annotated[float, Heading("Pruning")] = Field(default=0.3, gt=0, lt=1)
    """Fraction of the splats, lowest opacity first, removed in each pruning round. The paper uses 0.3."""

    prune_by: Literal["opacity", "contribution"] = "opacity"
    """Which splats are removed: those with the lowest opacity, as in the paper, or those that contribute least to what
    the training cameras see (the sum of their blending weights)."""

    prune_rounds: int = Field(default=1, ge=0, le=50)
    """Minimum number of pruning rounds; more follow until there are at most max_splats."""

    max_splats: int = Field(default=100_000, ge=1, le=10_000_000)
    """Maximum number of splats after pruning. Rounds after prune_rounds remove no more than needed for it. The paper
    stays below 100,000."""

    prune_finetune_iterations: int = Field(default=2_000, ge=0)
    """Training steps after each pruning round, without densification."""

    motion_iterations: Annotated[int, Heading("Motion"), _LATER] = Field(default=500, ge=0)
    """Steps of the motion network per frame. The paper uses 500."""

    motion_first_iterations: Annotated[int | None, _LATER] = Field(default=None, ge=0)
    """Steps for the first frame after a keyframe, which has no velocity to start from. null: motion_iterations."""

    motion_learning_rate: Annotated[float, _LATER] = Field(default=1e-3, gt=0)
    """Adam learning rate of the MLP; the hash grid uses ten times this value."""

    motion_views: Annotated[int, _LATER] = Field(default=4, ge=1, le=1000)
    """Cameras per step of the motion network. Rendering is cheap compared with the network, and several views make the
    gradient less noisy."""

    motion_velocity: Annotated[bool, _LATER] = True
    """Start from constant velocity, x[t-1] + (x[t-1] - x[t-2]), and learn the residual motion."""

    motion_velocity_neighbors: Annotated[int, _LATER] = Field(default=24, ge=0, le=1000)
    """Use the median velocity of each splat and this many nearest neighbors, which removes the noise of single splats.
    0: each splat's own velocity."""

    motion_acceleration: Annotated[float, _LATER] = Field(default=0.0, ge=0, le=1)
    """Fraction of the last change of the velocity that the first guess adds to the velocity, from the third frame after
    a keyframe on, with motion_velocity. 0: constant velocity."""

    motion_half_size: Annotated[float, _LATER] = Field(default=0.0, ge=0, le=1)
    """Fraction of the motion steps, from the first one, that compare images at half their width and height, which takes
    30% less time (docs/measurements/training.md). 0: all steps at full size, as in the paper."""

    motion_warm_start: Annotated[bool, _LATER] = False
    """Initialize the network with the previous frame's weights (and without the velocity) instead of from scratch."""

    motion_neighbors: Annotated[int, _LATER] = Field(default=0, ge=0, le=1000)
    """Number of nearest neighbors from whose relative motion each splat's rotation is estimated. 0: translation only,
    as in the paper."""

    hash_levels: Annotated[int, Heading("Motion network"), _LATER] = Field(default=16, ge=1, le=32)
    """Levels of the motion network's hash grid."""

    hash_features: Annotated[int, _LATER] = Field(default=4, ge=1, le=16)
    """Features per level."""

    hash_log2_size: Annotated[int, _LATER] = Field(default=15, ge=4, le=24)
    """Entries per level, as a power of two."""

    hash_base_resolution: Annotated[int, _LATER] = Field(default=16, ge=1, le=4096)
    """Resolution of the coarsest level, in cells per side."""

    hash_growth: Annotated[float, _LATER] = Field(default=1.5, gt=1, le=4)
    """Ratio of the resolutions of consecutive levels."""

    mlp_width: Annotated[int, _LATER] = Field(default=64, ge=1, le=1024)
    """Neurons per hidden layer of the MLP."""

    mlp_layers: Annotated[int, _LATER] = Field(default=2, ge=1, le=8)
    """Hidden layers of the MLP."""

    finetune_iterations: Annotated[int, Heading("Fine-tuning"), _LATER] = Field(default=2_000, ge=0)
    """Fine-tuning steps per frame, after the motion. The paper uses 2000."""

    finetune_rate_final: Annotated[float, _LATER] = Field(default=1.0, gt=0, le=1)
    """Fraction of the splats' learning rates at the last fine-tuning step of a later frame. They are constant in the
    first half of the steps and then decay exponentially to it, so that the noise of the last steps does not remain in
    the frame. 1: constant to the end."""

    finetune_means: Annotated[bool, _LATER] = False
    """Fine-tune the means as well; the paper fine-tunes the other attributes only."""

    entropy_weight: Annotated[float, _LATER] = Field(default=1e-5, ge=0)
    """Weight of the residual entropy loss: lambda_e in the paper's equation 13. Lower than the paper's 1e-4, which
    needed 14% more bytes at equal quality (docs/measurements/training.md)."""

    temporal_weight: Annotated[float, _LATER] = Field(default=1e-3, ge=0)
    """Weight of the temporal loss: lambda_t in the paper's equation 13."""

    temporal_huber: Annotated[float, _LATER] = Field(default=0.0, ge=0)
    """Threshold of a Huber loss in place of the temporal L1, in quantization steps: quadratic below it. 0: L1, as in
    the paper's equation 12."""

    regularize: Annotated[Literal["planes", "motion"], _LATER] = "planes"
    """Profile whose coded values the entropy and temporal losses and simulate_quantization act on, independent of the
    profile that is baked. planes: as in the paper."""

    simulate_quantization: Annotated[bool, _LATER] = False
    """During fine-tuning, render attributes as the baker quantizes them (straight-through estimator)."""

    rates: LearningRates = LearningRates()
    """Learning rates of the splats."""

    checkpoint_every: Annotated[int, Heading("Checkpoints"), Affects()] = Field(default=500, ge=0)
    """Steps between checkpoints of a keyframe, from which an interrupted run resumes. 0: no checkpoints."""

    def motion_steps(self, first: bool) -> int:
        """Steps of the motion network for a frame; `first`: it is the first one after the keyframe."""
        if first and self.motion_first_iterations is not None:
            return self.motion_first_iterations
        return self.motion_iterations
