"""Settings of training."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from pipelines.config.section import Section


class RatesSection(Section):
    """Learning rates of the splats (Adam), as in 3D Gaussian Splatting."""

    means: float = Field(default=6e-4, gt=0)
    """Positions at the first step, times the diagonal of the performer's box; decays exponentially to means_final."""

    means_final: float = Field(default=6e-6, gt=0)
    """Positions at the last step, times the scene's extent."""

    means_finetune: float = Field(default=6e-5, gt=0)
    """Positions while fine-tuning a later frame (finetune_means), times the scene's extent."""

    sh_dc: float = Field(default=2.5e-3, gt=0)
    """Constant color."""

    sh_rest: float = Field(default=1.25e-4, gt=0)
    """View-dependent color."""

    opacity: float = Field(default=0.05, gt=0)
    """Logit of the opacity."""

    scale: float = Field(default=5e-3, gt=0)
    """Logarithm of the scale."""

    rotation: float = Field(default=1e-3, gt=0)
    """Quaternion."""


class TrainSection(Section):
    """Training a group: a keyframe, then frame after frame motion and fine-tuning."""

    headings: ClassVar[dict[str, str]] = {
        "group_size": "Groups",
        "sh_degree": "Losses and pictures",
        "keyframe_iterations": "Keyframe",
        "prune_ratio": "Pruning",
        "motion_iterations": "Motion",
        "hash_levels": "Motion network",
        "finetune_iterations": "Fine-tuning",
        "checkpoint_every": "Checkpoints",
    }

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
    """Degree of the spherical harmonics: 0 is one color a splat, 3 the most view-dependent."""

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

    strategy: Literal["default", "mcmc"] = "default"
    """How splats find their places: default clones and splits as 3DGS does; mcmc moves dead splats to where they are
    needed and grows to densify_max_splats."""

    mcmc_noise: float = Field(default=1.0, ge=0)
    """Strength of the exploration noise of strategy mcmc; 1 as published."""

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

    motion_velocity_neighbors: int = Field(default=24, ge=0, le=1000)
    """Take the motion of the frame before as the median over each splat and this many nearest ones, which drops the
    noise of single splats; 0: each its own."""

    motion_warm_start: bool = False
    """Begin with the network of the frame before (and without the velocity guess) instead of a fresh one."""

    motion_neighbors: int = Field(default=0, ge=0, le=1000)
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

    entropy_weight: float = Field(default=1e-5, ge=0)
    """Weight of the residual entropy loss, lambda_e of equation 13. The paper takes 1e-4, which was measured
    to cost 14 % more bytes at equal quality (docs/TRAINING.md)."""

    temporal_weight: float = Field(default=1e-3, ge=0)
    """Weight of the temporal loss, lambda_t of the paper's equation 13."""

    temporal_huber: float = Field(default=0.0, ge=0)
    """0: the temporal loss is the paper's L1. Above 0: a Huber loss, quadratic up to this many quantization steps."""

    regularize: Literal["planes", "motion"] = "planes"
    """Profile whose coded values the residual entropy and temporal losses act on. planes: as in the paper."""

    simulate_quantization: bool = False
    """While fine-tuning, draw the attributes as the baker will round them."""

    rates: RatesSection = RatesSection()
    """Learning rates of the splats."""

    checkpoint_every: int = Field(default=500, ge=0)
    """Steps between two checkpoints of a keyframe in training, from which a broken run goes on; 0 makes none."""
