"""Settings of training. Defaults are the paper's values where it gives one, unless the field says otherwise."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from v3studio.studio.dilation import DILATION, MAX_DILATION, MIN_DILATION
from v3studio.studio.settings import Affects, Empty, Heading, Settings

GROUP_SIZE = 30
"""Frames per group at most. The paper has 20."""

MEANS_FINAL_RATE = 6e-6
"""Learning rate of the means at the last step of a keyframe, relative to the performer's size like `means`."""

MEANS_FINETUNE_RATE = 6e-5
"""Learning rate of the means in fine-tuning, relative to the performer's size."""

CHECKPOINT_EVERY = 500
"""Steps between checkpoints of a keyframe or of offsets, from which an interrupted run resumes."""

_LATER = Affects("later_frames")
"""For settings that only affect frames after the keyframe: changing them does not invalidate keyframes."""


class LearningRates(Settings):
    """Adam learning rates of the splats: those of 3DGS, as in the released V3 code, except for the means."""

    means: float = Field(default=6e-4, gt=0)
    """Means at the first step of a keyframe, as a multiple of the diagonal of the performer's bounding box. Decays
    exponentially to 6e-6. (3DGS's 1.6e-4 is relative to the camera spread, which is two to four times larger.)"""

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
    """Settings of training a group: the keyframe, then motion and fine-tuning of each other frame."""

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

    dilation: Annotated[float, Affects("keyframe", "set")] = Field(default=DILATION, ge=MIN_DILATION, le=MAX_DILATION)
    """Square pixels that are added to the 2D covariance of each splat when it is rendered. Below 0.3, outlines and
    details are sharper, especially in images of a different size than the training images. The stream contains the
    value, and our players use it. Viewers of exported splats assume 0.3."""

    background: Literal["random", "black", "white"] = "random"
    """Background color behind the performer during training. random: a new color at each step, from which splats learn
    their coverage."""

    dropout: float = Field(default=0.2, ge=0, lt=1)
    """Fraction of the splats left out of each step of the keyframe and of fine-tuning. Improves held-out views."""

    use_plates: bool = True
    """Compare the unmasked footage with splats that are rendered over the clean plate, instead of masking the
    performer. The plate may also be a set that was estimated from the footage to make masks. Reduces the effect of mask
    errors."""

    refine_masks: Annotated[Literal["auto", "always", "never"], Heading("Refined masks")] = "auto"
    """Replace the masks with the rendered alpha of the splats, on which all cameras agree, with twice the contrast.
    This happens when pruning of a keyframe or fine-tuning of another frame starts, and again every 100 steps. auto: in
    groups where more than 5% of the masks' outlines are more than a pixel from those of the keyframe's splats."""

    chroma_siting: Literal["auto", "left", "center", "none"] = "auto"
    """Compare footage with subsampled chroma (4:2:0, 4:2:2) with renders that are subsampled in the same way, so that
    colors that bled over outlines are not learned. The value is where the encoder took its samples: left (standard for
    H.264 and HEVC) or center (used by many converters). auto: whichever fits the footage better, in groups whose masks
    refine_masks: auto refines; none in others. none: no subsampling. Only for videos that are used at full size and
    without lens distortion."""

    camera_colors: Annotated[Literal["splats"] | None, Heading("Colors of cameras"), Empty("not corrected")] = None
    """Correct differences in color between cameras: a 3x4 matrix (with exposure) per camera, constant in a take, fitted
    before training to splats of the first keyframe (splats) and stored in train/camera_colors.json. The stream has the
    colors of the mean camera. For rigs whose cameras differ in exposure, white balance or model. null: no
    correction."""

    refine_cameras: Annotated[Literal["auto", "always", "never"], Heading("Refined cameras")] = "auto"
    """Refine the cameras together with the splats of the first keyframe: pose, principal point, focal length and one
    radial term of each; all frames are then trained and measured with them. They are kept in train/rig.json, and only
    used if they improve the training views by at least 0.1 dB (train/refinement.json). auto: if the cameras were
    calibrated from the footage or from tie points, not if they are from a file or a board."""

    crop_margin: Annotated[float, Heading("Crops")] = Field(default=0.15, ge=0, le=10)
    """Padding of the performer's bounding box that images are cropped to, as a fraction of the box size (16 pixels are
    added)."""

    keyframe_iterations: Annotated[int, Heading("Keyframe")] = Field(default=12_000, ge=1)
    """Training steps of the keyframe before pruning."""

    densify_from: int = Field(default=500, ge=0)
    """Densification starts after this step."""

    densify_until: int = Field(default=9_000, ge=0)
    """Densification stops at this step."""

    densify_every: int = Field(default=100, ge=1)
    """Steps between densifications."""

    densify_max_splats: int = Field(default=140_000, ge=1)
    """Number of splats that densification grows to, before pruning, which leaves 98,000 of the default. The paper does
    not give this number."""

    sh_degree_every: int = Field(default=1_000, ge=1)
    """Steps after which the next degree of the spherical harmonics is added to training, up to sh_degree."""

    prune_ratio: Annotated[float, Heading("Pruning")] = Field(default=0.3, gt=0, lt=1)
    """Fraction of the splats that each pruning round removes. The paper uses 0.3."""

    prune_by: Literal["opacity", "contribution"] = "opacity"
    """Which splats are removed: those with the lowest opacity, as in the paper, or those that contribute least to what
    the training cameras see (the sum of their blending weights)."""

    max_splats: int = Field(default=100_000, ge=1, le=10_000_000)
    """Maximum number of splats after pruning. If the first round leaves more, further rounds remove no more than
    needed. The paper stays below 100,000."""

    prune_finetune_iterations: int = Field(default=2_000, ge=0)
    """Training steps after each pruning round, without densification."""

    motion_iterations: Annotated[int, Heading("Motion"), _LATER] = Field(default=500, ge=0)
    """Steps of the motion network per frame. The paper uses 500."""

    motion_first_iterations: Annotated[int | None, _LATER, Empty("as the others")] = Field(default=None, ge=0)
    """Steps for the frames next to a keyframe, which have no velocity to start from. null: motion_iterations."""

    motion_learning_rate: Annotated[float, _LATER] = Field(default=1e-3, gt=0)
    """Adam learning rate of the MLP; the hash grid uses ten times this value."""

    motion_views: Annotated[int, _LATER] = Field(default=4, ge=1, le=1000)
    """Cameras per step of the motion network. Rendering is cheap compared with the network, and several views make the
    gradient less noisy."""

    motion_acceleration: Annotated[float, _LATER] = Field(default=0.0, ge=0, le=1)
    """Fraction of the last change in velocity that is added to the predicted velocity, from the third frame after a
    keyframe. 0: constant velocity."""

    hash_levels: Annotated[int, Heading("Motion network"), _LATER] = Field(default=16, ge=1, le=32)
    """Levels of the motion network's hash grid."""

    mlp_width: Annotated[int, _LATER] = Field(default=64, ge=1, le=1024)
    """Neurons per hidden layer of the MLP."""

    mlp_layers: Annotated[int, _LATER] = Field(default=2, ge=1, le=8)
    """Hidden layers of the MLP."""

    finetune_iterations: Annotated[int, Heading("Fine-tuning"), _LATER] = Field(default=2_000, ge=0)
    """Fine-tuning steps per frame, after the motion. The paper uses 2000."""

    finetune_means: Annotated[bool, _LATER] = False
    """Fine-tune the means as well; the paper fine-tunes the other attributes only."""

    entropy_weight: Annotated[float, _LATER] = Field(default=1e-5, ge=0)
    """Weight of the residual entropy loss: lambda_e in the paper's equation 13. Lower than the paper's 1e-4, which
    needed 14% more bytes at equal quality (docs/measurements/training.md)."""

    temporal_weight: Annotated[float, _LATER] = Field(default=1e-3, ge=0)
    """Weight of the temporal loss: lambda_t in the paper's equation 13."""

    joint_iterations: Annotated[int, Heading("Joint training"), Affects("joint_frames")] = Field(default=0, ge=0)
    """Steps per frame on random frames and cameras of a group, after all of its frames are trained. Splats that hardly
    contribute to images are left out, about eight frames in a row share scales, opacities and colors, and positions
    follow smooth paths, which takes fewer bytes. 0: no such steps."""

    rates: LearningRates = LearningRates()
    """Learning rates of the splats."""

    def motion_steps(self, first: bool) -> int:
        """Steps of the motion network for a frame; `first`: it is the first one after the keyframe."""
        if first and self.motion_first_iterations is not None:
            return self.motion_first_iterations
        return self.motion_iterations
