"""LPIPS, a learned perceptual distance between images.

Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", 2018. This is version 0.1 of the
metric, as computed by the authors' package `lpips`. That package is not a dependency because it needs torchvision, each
release of which requires a specific release and build of torch. The fitted linear weights (10 KB) are stored next to
this file under their own license; the weights of the network are those published by torchvision.
"""

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from v3studio.studio.errors import Message, StudioError
from v3studio.studio.memory import is_out_of_memory

SMALLEST = 32  # minimum width and height of an image in pixels; below it, the last layers of AlexNet have no output

_LINEAR_WEIGHTS = Path(__file__).with_name("linear_weights.safetensors")
_PUBLISHED = "https://download.pytorch.org/models"

# Mean and standard deviation of ImageNet for RGB in -1 to 1, as in the authors' package.
_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)


@dataclass(frozen=True)
class Network:
    """A classification network whose features LPIPS compares."""

    title: str
    url: str  # the weights published by torchvision as IMAGENET1K_V1
    # (channels, kernel, stride, padding) of a convolution followed by a ReLU, or (kernel, stride) of a max pooling.
    # Numbered as in torchvision, where each ReLU is a separate layer
    layers: tuple[tuple[int, ...], ...]
    taps: tuple[int, ...]  # numbers of the ReLUs whose outputs are compared


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
"""alex: recommended by the authors for comparisons, and faster. vgg: used by most papers on radiance fields."""


class Lpips:
    """The LPIPS metric. The constructor loads the network and downloads its weights if they are missing.

    Attributes:
        protocol: description of the measurement for reports: version, network, weights file, minimum size.
        remark: the warning `lpips.other_weights` if the weights are not the published file, else None.
    """

    def __init__(self, net: str, device: str = "cpu") -> None:
        """

        Args:
            net: a key of `NETWORKS`.

        Raises:
            StudioError: `lpips.unknown_network`; `lpips.download_failed`: the weights cannot be downloaded;
                `lpips.invalid_weights`: they cannot be read.
        """
        from safetensors.torch import load_file

        if net not in NETWORKS:
            problem = f"unknown LPIPS network '{net}'"
            fix = f"Use {' or '.join(NETWORKS)}"
            raise StudioError(
                "lpips.unknown_network", problem, value=net, fix=fix, setting="evaluate.lpips", expected=tuple(NETWORKS)
            )
        network = NETWORKS[net]
        self._device, self._taps = device, network.taps
        file = weights_file(network)
        self._layers = _features(network, _loaded(network, file)).to(device)
        linear = load_file(_LINEAR_WEIGHTS, device=device)
        self._linear = [linear[f"{net}.{number}"] for number in range(len(network.taps))]
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        published = _published_digest(file)
        self.remark: Message | None = None
        if not digest.startswith(published):
            problem = (
                f"not the file published by torchvision (SHA-256 {digest[:8]}..., expected {published}...), so LPIPS "
                "may differ from published results"
            )
            fix = "Delete the file to download it again"
            fields = {"expected": published}
            self.remark = Message("lpips.other_weights", problem, file=file, value=digest[:8], fix=fix, fields=fields)
        self.protocol = (
            f"version 0.1 with {network.title}, weights {file.name} (SHA-256 {digest[:8]}...); lower is better; images "
            f"smaller than {SMALLEST} px are padded with the background"
        )

    def __call__(self, image: Tensor, target: Tensor, /) -> float:
        """The distance of (H, W, 3) images in 0 to 1, at least `SMALLEST` pixels wide and high: 0 for equal images,
        about 1 for unrelated ones."""
        if image.shape != target.shape or image.ndim != 3 or image.shape[-1] != 3 or min(image.shape[:2]) < SMALLEST:
            shapes = (tuple(image.shape), tuple(target.shape))
            problem = (
                f"the images have shapes {shapes[0]} and {shapes[1]}; LPIPS needs (H, W, 3), the same size for both, "
                f"and at least {SMALLEST}x{SMALLEST} pixels"
            )
            raise StudioError("metrics.image_shape", problem, value=shapes)
        with torch.no_grad():
            pair = torch.stack([image, target]).to(self._device, torch.float32).permute(0, 3, 1, 2)
            shift, scale = (pair.new_tensor(values).view(3, 1, 1) for values in (_SHIFT, _SCALE))
            planes = (2.0 * pair - 1.0 - shift) / scale
            distance = 0.0
            for number, layer in enumerate(self._layers):
                planes = layer(planes)
                if number in self._taps:
                    first, other = planes / (planes.square().sum(1, keepdim=True).sqrt() + 1e-10)
                    weights = self._linear[self._taps.index(number)].view(-1, 1, 1)
                    distance += float((weights * (first - other).square()).sum(0).mean())
        return distance


def at_least(image: Tensor, background: Sequence[float]) -> Tensor:
    """Pad an (h, w, 3) image on the right and bottom with an RGB background, to the smallest size of LPIPS."""
    height, width = image.shape[:2]
    if min(height, width) >= SMALLEST:
        return image
    larger = image.new_tensor(background).repeat(max(height, SMALLEST), max(width, SMALLEST), 1)
    larger[:height, :width] = image
    return larger


def weights_file(network: Network) -> Path:
    """Path of the published weights in torch's cache; the file may not exist."""
    return Path(torch.hub.get_dir()) / "checkpoints" / network.url.rsplit("/", 1)[-1]


def _loaded(network: Network, file: Path) -> dict[str, Tensor]:
    """The published weights. If `file` does not exist, it is downloaded and verified by its digest."""
    existed = file.is_file()
    try:
        state = torch.hub.load_state_dict_from_url(
            network.url, model_dir=str(file.parent), map_location="cpu", check_hash=True, weights_only=True
        )
    except Exception as error:  # no network, disk full, no permission, truncated file, ...: unrelated exception types
        if is_out_of_memory(error):
            raise
        if existed:
            raise _unreadable(network, file, _first_line(error)) from None
        problem = f"the LPIPS weights of {network.title} cannot be downloaded ({_first_line(error)})"
        fix = f"Download {network.url} to {file.parent}, or set evaluate.lpips to null"
        raise StudioError(
            "lpips.download_failed", problem, file=file, value=network.url, fix=fix, setting="evaluate.lpips"
        ) from None
    if not isinstance(state, dict):
        raise _unreadable(network, file, f"it contains a {type(state).__name__}")
    return state


def _features(network: Network, state: dict[str, Tensor]) -> nn.Sequential:
    """The feature layers, with the weights `features.N.weight` and `features.N.bias` of `state`."""
    layers: list[nn.Module] = []
    channels = 3
    for layer in network.layers:
        if len(layer) == 2:
            layers.append(nn.MaxPool2d(layer[0], layer[1]))
            continue
        layers += [nn.Conv2d(channels, layer[0], layer[1], layer[2], layer[3]), nn.ReLU()]
        channels = layer[0]
    features = nn.Sequential(*layers).requires_grad_(False)
    prefix = "features."
    try:
        features.load_state_dict(
            {str(k).removeprefix(prefix): v for k, v in state.items() if str(k).startswith(prefix)}
        )
    except RuntimeError as error:  # the message lists all missing names
        if is_out_of_memory(error):
            raise
        raise _unreadable(network, weights_file(network), str(error).splitlines()[-1].strip()[:200]) from None
    return features


def _unreadable(network: Network, file: Path, reason: str) -> StudioError:
    fix = f"Delete the file to download it again from {network.url}"
    return StudioError("lpips.invalid_weights", f"not a weights file of {network.title} ({reason})", file=file, fix=fix)


def _published_digest(file: Path) -> str:
    """The first digits of the SHA-256 from the name of a published file, or ""."""
    match = re.search(r"-([0-9a-f]{8,})\.[^.]+$", file.name)
    return match[1] if match else ""


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
