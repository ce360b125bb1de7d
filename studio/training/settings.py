"""Plain settings of group training. Defaults are the paper's where the paper names a value."""

from __future__ import annotations

from dataclasses import dataclass

from studio.errors import StudioError


@dataclass(frozen=True)
class LearningRates:
    """Adam learning rates: 3DGS's, as in the released V3 code, but for the positions.

    Attributes:
        means: first step, times the diagonal of the performer's box; decays exponentially to `means_final` over the
            keyframe. 3DGS's 1.6e-4 is relative to the spread of the cameras, which is two to four times that.
        means_final: last step of that decay, times the scene extent.
        means_finetune: positions while fine-tuning a later frame (`TrainSettings.finetune_means`), times the extent.
        sh_dc: constant color; `sh_rest` for the higher coefficients.
        opacity, scale, rotation: logit opacity, log scale, quaternion.
    """

    means: float = 6e-4
    means_final: float = 6e-6
    means_finetune: float = 6e-5
    sh_dc: float = 2.5e-3
    sh_rest: float = 1.25e-4
    opacity: float = 0.05
    scale: float = 5e-3
    rotation: float = 1e-3


@dataclass(frozen=True)
class TrainSettings:
    """How keyframes and the frames after them are trained.

    Attributes:
        sh_degree: 0 to 3.
        dssim_weight: lambda of equation 7, weight of D-SSIM against L1.
        alpha_weight: weight of the L1 between drawn alpha and matte; 0 leaves coverage to the background.
        opacity_reg: keyframe: weight of the mean opacity (Kheradmand et al. 2024, section 4.4): what no picture needs
            fades and is pruned, so that fewer phantoms stand in views that were never trained on.
        scale_reg: keyframe: weight of the mean scale, relative to the scene extent (there too).
        background: what shows behind the performer while training: "random" (a new color each step, so that
            coverage is learned), "black" or "white".
        dropout: share of the splats that each step of the keyframe and of fine-tuning leaves out.
        use_plates: where the capture has clean plates, compare the picture as filmed with the splats drawn over the
            plate, instead of cutting the performer out by his matte.
        crop_margin: the loss is computed in the performer's box, padded by this share of its size (and 16 px).
        keyframe_iterations: 3DGS steps of the keyframe, before pruning.
        strategy: how the keyframe's splats find their places: "default" is 3DGS's rule, "mcmc" relocates dead splats
            and grows to `densify_max_splats` (Kheradmand et al. 2024).
        mcmc_noise: strength of MCMC's exploration noise, 1 as published; only for "mcmc".
        densify_from, densify_until, densify_every: densification, in steps.
        densify_gradient: mean screen gradient (NDC) above which a splat is cloned or split.
        densify_max_splats: no densification beyond this count (before pruning).
        opacity_reset_every: 3DGS's opacity reset, in steps; none in the last quarter of densification.
        sh_degree_every: one more SH degree is optimized after this many steps.
        prune_ratio: share with the lowest opacity that one pruning round removes (section 4.1: 30 %).
        prune_rounds: pruning rounds at least; more follow until `max_splats` holds.
        max_splats: cap after pruning.
        prune_finetune_iterations: steps after each pruning round, without densification.
        motion_iterations: steps of the motion network a frame (section 5: 500).
        motion_first_iterations: steps of it for the frame after the keyframe, which has no velocity to start from;
            None: as many as the others.
        motion_learning_rate: Adam, MLP weights; the hash table takes ten times that.
        motion_views: cameras that each step of the motion network looks at; drawing is cheap beside the network, and
            several views make each step surer.
        motion_velocity: start from the constant-velocity guess x_{t-1} + (x_{t-1} - x_{t-2}) and learn the rest.
        motion_velocity_neighbors: of the velocity take the median over each splat and this many nearest ones, which
            drops what single splats were moved by noise and the smooth motion field could not put right; 0: each its
            own.
        motion_warm_start: begin with the network of the frame before instead of a fresh one; the velocity guess is then
            left out, because that network knows it.
        motion_neighbors: each splat turns as the offsets to this many nearest splats do; 0: motion is a translation
            only, as in the paper.
        hash_levels, hash_features, hash_log2_size, hash_base_resolution, hash_growth: the multiresolution grid.
        mlp_width, mlp_layers: hidden layers of the motion MLP.
        finetune_iterations: steps of fine-tuning a frame (section 5: 2000).
        finetune_means: tune positions as well (the paper tunes "other attributes" only).
        entropy_weight: lambda_e of equation 13; the paper takes 1e-4, which measured worse (docs/TRAINING.md).
        temporal_weight: lambda_t of equation 13.
        temporal_huber: equation 12 is an L1; above 0 it is a Huber loss instead, quadratic up to this many quantization
            steps, so that what rounding hides anyway is not pressed to zero.
        regularize: profile whose coded values the entropy and temporal losses and `simulate_quantization` act on:
            "planes" (as in the paper) or "motion". Independent of the profile that is baked.
        simulate_quantization: fine-tuning draws the attributes as the baker will round them (straight-through).
        rates: learning rates of the splats.
        snapshot_every: steps between calls of the `snapshot` callback.
        checkpoint_every: keyframe: steps between calls of the `checkpoint` callback; 0 never.
    """

    sh_degree: int = 0
    dssim_weight: float = 0.2
    alpha_weight: float = 0.0
    opacity_reg: float = 0.01
    scale_reg: float = 0.2
    background: str = "random"
    dropout: float = 0.2
    use_plates: bool = True
    crop_margin: float = 0.15
    keyframe_iterations: int = 12_000
    strategy: str = "default"
    mcmc_noise: float = 1.0
    densify_from: int = 500
    densify_until: int = 9_000
    densify_every: int = 100
    densify_gradient: float = 2e-4
    densify_max_splats: int = 300_000
    opacity_reset_every: int = 3_000
    sh_degree_every: int = 1_000
    prune_ratio: float = 0.3
    prune_rounds: int = 1
    max_splats: int = 100_000
    prune_finetune_iterations: int = 2_000
    motion_iterations: int = 500
    motion_first_iterations: int | None = None
    motion_learning_rate: float = 1e-3
    motion_views: int = 4
    motion_velocity: bool = True
    motion_velocity_neighbors: int = 24
    motion_warm_start: bool = False
    motion_neighbors: int = 0
    hash_levels: int = 16
    hash_features: int = 4
    hash_log2_size: int = 15
    hash_base_resolution: int = 16
    hash_growth: float = 1.5
    mlp_width: int = 64
    mlp_layers: int = 2
    finetune_iterations: int = 2_000
    finetune_means: bool = False
    entropy_weight: float = 1e-5
    temporal_weight: float = 1e-3
    temporal_huber: float = 0.0
    regularize: str = "planes"
    simulate_quantization: bool = False
    rates: LearningRates = LearningRates()
    snapshot_every: int = 500
    checkpoint_every: int = 500

    def motion_steps(self, first: bool) -> int:
        """Steps of the motion network for a frame; `first`: no frame of its group but the keyframe is before it."""
        if first and self.motion_first_iterations is not None:
            return self.motion_first_iterations
        return self.motion_iterations

    def __post_init__(self) -> None:
        """Raises StudioError on values that no training could use."""
        if self.sh_degree not in (0, 1, 2, 3):
            raise StudioError(f"sh_degree is {self.sh_degree}; it must be 0, 1, 2 or 3.")
        if self.background not in ("random", "black", "white"):
            raise StudioError(f"background is '{self.background}'; it must be random, black or white.")
        if self.strategy not in ("default", "mcmc"):
            raise StudioError(f"strategy is '{self.strategy}'; it must be default or mcmc.")
        if self.regularize not in ("planes", "motion"):
            raise StudioError(
                "settings.invalid_value",
                f"train.regularize is '{self.regularize}'; expected planes or motion",
                value=self.regularize,
                setting="train.regularize",
            )
        if not 0 <= self.dropout < 1:
            raise StudioError(f"dropout is {self.dropout}; it must be at least 0 and below 1.")
        if not 0 < self.prune_ratio < 1:
            raise StudioError(f"prune_ratio is {self.prune_ratio}; it must lie between 0 and 1.")
        if self.max_splats < 1:
            raise StudioError(f"max_splats is {self.max_splats}; at least one splat is needed.")


AFTER_KEYFRAME = (
    "motion_iterations", "motion_first_iterations", "motion_learning_rate", "motion_views", "motion_velocity",
    "motion_velocity_neighbors", "motion_warm_start", "motion_neighbors", "hash_levels", "hash_features",
    "hash_log2_size", "hash_base_resolution", "hash_growth", "mlp_width", "mlp_layers", "finetune_iterations",
    "finetune_means", "entropy_weight", "temporal_weight", "temporal_huber", "regularize",
    "simulate_quantization", "rates.means_finetune",
)  # fmt: skip
"""Settings that only the frames after the keyframe are trained by: changing them leaves keyframes as they are."""
