"""LPIPS: how different two images look to a network whose features were weighted by people's judgments.

Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", 2018; version 0.1 of the metric,
as its authors' package `lpips` computes it. That package is not used, because it needs torchvision, whose releases fit
one release and build of torch each. What it computes is short and will not change; its fitted weights (10 kB) lie
beside this file under their own license. The network's weights are the file that torchvision publishes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from studio.errors import StudioError

SMALLEST = 32
"""Least side of an image in pixels: below it nothing is left for AlexNet's last layers."""

_LINEAR_WEIGHTS = Path(__file__).with_name("linear_weights.safetensors")
_PUBLISHED = "https://download.pytorch.org/models"

# What the authors' package takes off red, green and blue of -1 to 1, and divides by: ImageNet's mean and deviation.
_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)


@dataclass(frozen=True)
class Network:
    """A classifier that LPIPS looks through.

    Attributes:
        title: for people.
        url: of the weights that torchvision publishes as IMAGENET1K_V1.
        layers: its features: (channels, kernel, stride, padding) of a convolution with a ReLU behind it, or (kernel,
            stride) of a pooling. They are numbered as in torchvision, where the ReLU counts.
        taps: the numbers of the ReLUs whose outputs are compared.
    """

    title: str
    url: str
    layers: tuple[tuple[int, ...], ...]
    taps: tuple[int, ...]


def _vgg_layers() -> Iterator[tuple[int, ...]]:
    for block, (channels, count) in enumerate(((64, 2), (128, 2), (256, 3), (512, 3), (512, 3))):
        if block:
            yield (2, 2)
        yield from [(channels, 3, 1, 1)] * count


NETWORKS = {
    "alex": Network(
        "AlexNet",
        f"{_PUBLISHED}/alexnet-owt-7be5be79.pth",
        ((64, 11, 4, 2), (3, 2), (192, 5, 1, 2), (3, 2), (384, 3, 1, 1), (256, 3, 1, 1), (256, 3, 1, 1)),
        (1, 4, 7, 9, 11),
    ),
    "vgg": Network("VGG16", f"{_PUBLISHED}/vgg16-397923af.pth", tuple(_vgg_layers()), (3, 8, 15, 22, 29)),
}
"""alex: the authors' choice for comparing, and the faster one; vgg: what most papers on radiance fields report."""


class Lpips:
    """The metric, ready to compare. Making it loads the network, and fetches its weights where they are not there yet.

    Attributes:
        protocol: what is measured with: network, file of its weights, version, least size.
        remark: a sentence where the weights are not the published file; "" where they are.
    """

    def __init__(self, net: str, device: str = "cpu") -> None:
        """
        Args:
            net: a name of `NETWORKS`.
            device: torch device that it runs on.

        Raises:
            StudioError: there is no such network, or its weights cannot be fetched or read.
        """
        from safetensors.torch import load_file

        if net not in NETWORKS:
            raise StudioError(f"LPIPS: there is no network '{net}'; choose one of {', '.join(NETWORKS)}.")
        network = NETWORKS[net]
        self._device, self._taps = device, network.taps
        file = weights_file(network)
        self._layers = _features(network, _loaded(network, file)).to(device)
        linear = load_file(_LINEAR_WEIGHTS, device=device)
        self._linear = [linear[f"{net}.{number}"] for number in range(len(network.taps))]
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        wanted = _published_digest(file)
        self.remark = ""
        if not digest.startswith(wanted):
            self.remark = (
                f"{file} is not the file that torchvision publishes (its SHA-256 begins with {digest[:8]}, not "
                f"{wanted}); LPIPS may differ from what others report."
            )
        self.protocol = (
            f"version 0.1 through {network.title}, weights {file.name} (SHA-256 {digest[:8]}...); lower is better; the "
            f"background goes on around images of less than {SMALLEST} px"
        )

    def __call__(self, image: Tensor, target: Tensor, /) -> float:
        """The distance: 0 for equal images, about 1 for images that have nothing in common.

        Args:
            image, target: (H, W, 3) in 0 to 1, at least `SMALLEST` pixels each way.

        Raises:
            StudioError: the shapes do not fit or are too small.
        """
        if image.shape != target.shape or image.ndim != 3 or image.shape[-1] != 3 or min(image.shape[:2]) < SMALLEST:
            raise StudioError(
                f"LPIPS compares two (H, W, 3) images of one size, at least {SMALLEST} pixels each way; found "
                f"{tuple(image.shape)} and {tuple(target.shape)}."
            )
        with torch.no_grad():
            pair = torch.stack([image, target]).to(self._device, torch.float32).permute(0, 3, 1, 2)
            shift, scale = (pair.new_tensor(values).view(3, 1, 1) for values in (_SHIFT, _SCALE))
            planes = (2.0 * pair - 1.0 - shift) / scale
            distance = 0.0
            for number, layer in enumerate(self._layers):
                planes = layer(planes)
                if number in self._taps:
                    one, other = planes / (planes.square().sum(1, keepdim=True).sqrt() + 1e-10)
                    weights = self._linear[self._taps.index(number)].view(-1, 1, 1)
                    distance += float((weights * (one - other).square()).sum(0).mean())
        return distance


def weights_file(network: Network) -> Path:
    """Where torch keeps the network's published weights, whether they are there or not."""
    return Path(torch.hub.get_dir()) / "checkpoints" / network.url.rsplit("/", 1)[-1]


def _loaded(network: Network, file: Path) -> dict[str, Any]:
    """The published weights, fetched (and checked by their digest) where `file` is not there."""
    was_there = file.is_file()
    try:
        found = torch.hub.load_state_dict_from_url(
            network.url, model_dir=str(file.parent), map_location="cpu", check_hash=True, weights_only=True
        )
    except Exception as error:  # no network, no room, no rights, a file cut short: each is a class of its own
        if was_there:
            raise _unreadable(network, file, _first_line(error)) from None
        raise StudioError(
            f"{network.title}'s weights for LPIPS cannot be fetched ({_first_line(error)}); put {file.name} from "
            f"{network.url} into {file.parent}, or set evaluate.lpips to null."
        ) from None
    if not isinstance(found, dict):
        raise _unreadable(network, file, f"it holds a {type(found).__name__}")
    return found


def _features(network: Network, state: dict[str, Any]) -> nn.Sequential:
    """The convolutions, with the weights `features.N.weight` and `.bias` of `state`."""
    layers: list[nn.Module] = []
    channels = 3
    for layer in network.layers:
        if len(layer) == 2:
            layers.append(nn.MaxPool2d(layer[0], layer[1]))
            continue
        layers += [nn.Conv2d(channels, layer[0], layer[1], layer[2], layer[3]), nn.ReLU()]
        channels = layer[0]
    found = nn.Sequential(*layers).requires_grad_(False)
    begin = "features."
    try:
        found.load_state_dict({str(k).removeprefix(begin): v for k, v in state.items() if str(k).startswith(begin)})
    except RuntimeError as error:  # torch lists every name that is missing
        raise _unreadable(network, weights_file(network), str(error).splitlines()[-1].strip()[:200]) from None
    return found


def _unreadable(network: Network, file: Path, why: str) -> StudioError:
    return StudioError(
        f"{file}: these are no weights of {network.title} ({why}); delete the file, and it is fetched anew from "
        f"{network.url}."
    )


def _published_digest(file: Path) -> str:
    """The first digits of the SHA-256, which torch's published files carry in their names; "" where there are none."""
    found = re.search(r"-([0-9a-f]{8,})\.[^.]+$", file.name)
    return found[1] if found else ""


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
