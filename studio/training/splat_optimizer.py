"""Adam over the attributes of splats whose number changes during training."""

from collections.abc import Mapping

import torch
from torch import Tensor

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training.adam import Adam, ParameterGroup
from v3studio.studio.training.settings import MEANS_FINAL_RATE, LearningRates
from v3studio.studio.training.step import part_of


class SplatOptimizer:
    """Leaf tensors with Adam parameter groups; splats come and go. `extent` scales the rate of the means."""

    def __init__(self, gaussians: Gaussians, rates: LearningRates, extent: float, train_means: bool = True) -> None:
        self._rates = rates
        self._extent = extent
        self._dilation = gaussians.dilation
        self._leaves = {
            name: tensor.detach().clone().contiguous().requires_grad_(name != "means" or train_means)
            for name, tensor in _by_leaf(gaussians).items()
            if tensor.shape[1:].numel()
        }
        rate = {
            "means": rates.means * extent,
            "quats": rates.rotation,
            "log_scales": rates.scale,
            "logit_opacities": rates.opacity,
            "sh_dc": rates.sh_dc,
            "sh_rest": rates.sh_rest,
        }
        groups = [ParameterGroup([leaf], rate[name], name) for name, leaf in self._leaves.items() if leaf.requires_grad]
        self._adam = Adam(groups, eps=1e-15)

    def __len__(self) -> int:
        return self._leaves["means"].shape[0]

    @property
    def gaussians(self) -> Gaussians:
        """The current splats; gradients propagate to the leaf tensors."""
        parts = {name: self._leaves[name] for name in ("means", "quats", "log_scales", "logit_opacities")}
        return Gaussians(**parts, sh=joined_sh(self._leaves), dilation=self._dilation)

    def set_means_progress(self, fraction: float) -> None:
        """Set the exponentially decayed rate of the means; `fraction` is 0 at the first step and 1 at the last."""
        for group in self._adam.groups:
            if group.name == "means":
                ratio = MEANS_FINAL_RATE / self._rates.means
                group.rate = self._rates.means * self._extent * ratio ** min(1.0, fraction)

    def step(self) -> None:
        """Take one Adam step and clear the gradients."""
        self._adam.step()
        self._adam.zero_grad()

    def _replace(self, name: str, value: Tensor, moment: dict[str, Tensor]) -> None:
        old = self._leaves[name]
        new = value.detach().contiguous().requires_grad_(old.requires_grad)
        self._leaves[name] = new
        for group in self._adam.groups:
            if group.name == name:
                group.leaves = [new]
        state = self._adam.state.pop(old, None)
        if state:
            self._adam.state[new] = {**state, **moment}

    def _moments(self, name: str) -> dict[str, Tensor]:
        state = self._adam.state.get(self._leaves[name], {})
        return {key: state[key] for key in ("exp_avg", "exp_avg_sq") if key in state}

    @torch.no_grad()
    def keep(self, index: Tensor) -> None:
        """Keep only the splats of a boolean mask or an index tensor, with their Adam moments."""
        for name in list(self._leaves):
            moments = {key: value[index].contiguous() for key, value in self._moments(name).items()}
            self._replace(name, self._leaves[name][index], moments)

    @torch.no_grad()
    def append(self, new: Gaussians) -> None:
        """Append splats; their Adam moments start at zero."""
        values = _by_leaf(new)
        for name in list(self._leaves):
            moments = {
                key: torch.cat([value, torch.zeros_like(values[name])]) for key, value in self._moments(name).items()
            }
            self._replace(name, torch.cat([self._leaves[name], values[name]]), moments)

    def state(self) -> dict[str, Tensor]:
        """All values and Adam moments by name, for `restore`."""
        tensors = {}
        for name, leaf in self._leaves.items():
            tensors[f"{name}.value"] = leaf.detach()
            for key, moment in self._adam.state.get(leaf, {}).items():
                tensors[f"{name}.{key}"] = moment
        return tensors

    @torch.no_grad()
    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`, bit for bit."""
        for name, leaf in list(self._leaves.items()):
            self._replace(name, state[f"{name}.value"].to(leaf.device), {})
            own = part_of(state, f"{name}.")
            moments = {key: value.to(leaf.device) for key, value in own.items() if key != "value"}
            if moments:
                self._adam.state[self._leaves[name]] = moments

    @torch.no_grad()
    def cap_opacity(self, opacity: float) -> None:
        """The opacity reset of 3DGS: clamp opacities to at most `opacity` and reset their Adam moments."""
        limit = torch.logit(torch.tensor(opacity)).item()
        moments = {key: torch.zeros_like(value) for key, value in self._moments("logit_opacities").items()}
        self._replace("logit_opacities", self._leaves["logit_opacities"].clamp(max=limit), moments)


def joined_sh(leaves: Mapping[str, Tensor], part: str = "") -> Tensor:
    """Spherical harmonics from the leaves `sh_dc` and `sh_rest` (none at degree 0); `part` ends their names."""
    rest = leaves.get(f"sh_rest{part}")
    return leaves[f"sh_dc{part}"] if rest is None else torch.cat([leaves[f"sh_dc{part}"], rest], dim=1)


def _by_leaf(gaussians: Gaussians) -> dict[str, Tensor]:
    """One tensor per parameter group; sh_rest is empty at degree 0."""
    return {
        "means": gaussians.means,
        "quats": gaussians.quats,
        "log_scales": gaussians.log_scales,
        "logit_opacities": gaussians.logit_opacities,
        "sh_dc": gaussians.sh[:, :1],
        "sh_rest": gaussians.sh[:, 1:],
    }
