"""LPIPS against NumPy, with random weights: tests do not download the real ones."""

import hashlib
import urllib.error
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from tests.support.errors import refuses
from v3studio.studio import perceptual
from v3studio.studio.perceptual import NETWORKS, Lpips, weights_file

CONVOLUTIONS = {
    "alex": {0: (3, 64, 11), 3: (64, 192, 5), 6: (192, 384, 3), 8: (384, 256, 3), 10: (256, 256, 3)},
    "vgg": {
        0: (3, 64, 3), 2: (64, 64, 3), 5: (64, 128, 3), 7: (128, 128, 3), 10: (128, 256, 3), 12: (256, 256, 3),
        14: (256, 256, 3), 17: (256, 512, 3), 19: (512, 512, 3), 21: (512, 512, 3), 24: (512, 512, 3),
        26: (512, 512, 3), 28: (512, 512, 3),
    },
}  # fmt: skip
"""Index in torchvision's features: input channels, output channels, kernel size."""


def random_weights(net: str) -> dict[str, torch.Tensor]:
    """Random weights that preserve the magnitude of activations, named as in torchvision."""
    random = torch.Generator().manual_seed(7)
    found = {}
    for number, (before, after, side) in CONVOLUTIONS[net].items():
        spread = (2 / (before * side * side)) ** 0.5
        found[f"features.{number}.weight"] = spread * torch.randn(after, before, side, side, generator=random)
        found[f"features.{number}.bias"] = 0.1 * torch.randn(after, generator=random)
    return found | {"classifier.1.weight": torch.zeros(2, 2)}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty torch cache, and no network access."""

    def refuse(*arguments: object, **options: object) -> None:
        raise urllib.error.URLError("no network in tests")

    monkeypatch.setattr(torch.hub, "download_url_to_file", refuse)
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    return tmp_path / "torch" / "hub" / "checkpoints"


def put(net: str) -> Path:
    file = weights_file(NETWORKS[net])
    file.parent.mkdir(parents=True, exist_ok=True)
    torch.save(random_weights(net), file)
    return file


def pictures(height: int = 45, width: int = 38) -> tuple[torch.Tensor, torch.Tensor]:
    random = torch.Generator().manual_seed(1)
    image = torch.rand(height, width, 3, generator=random)
    return image, (image + 0.1 * torch.randn(image.shape, generator=random)).clamp(0, 1)


def in_numpy(net: str, image: torch.Tensor, target: torch.Tensor) -> float:
    """Equation 1 of Zhang et al., from the definition."""
    linear = load_file(Path(perceptual.__file__).with_name("linear_weights.safetensors"))
    state = {name: value.double().numpy() for name, value in random_weights(net).items()}

    def windows(planes: np.ndarray, side: int, stride: int) -> np.ndarray:
        return np.lib.stride_tricks.sliding_window_view(planes, (side, side), axis=(1, 2))[:, ::stride, ::stride]

    def features(picture: torch.Tensor) -> list[np.ndarray]:
        values = 2 * picture.double().numpy() - 1
        planes = ((values - [-0.030, -0.088, -0.188]) / [0.458, 0.448, 0.450]).transpose(2, 0, 1)
        found, pool = [], (3, 2) if net == "alex" else (2, 2)
        for number, (_, _, side) in CONVOLUTIONS[net].items():
            if number in ((3, 6) if net == "alex" else (5, 10, 17, 24)):
                found.append(planes)  # the last planes before each pooling are compared ...
                planes = windows(planes, *pool).max((-1, -2))
            elif net == "alex" and number in (8, 10):
                found.append(planes)  # ... and in AlexNet, each of the last three
            stride, padding = (4, 2) if side == 11 else (1, side // 2)
            padded = np.pad(planes, ((0, 0), (padding, padding), (padding, padding)))
            sums = np.einsum(
                "ihwab,oiab->ohw", windows(padded, side, stride), state[f"features.{number}.weight"], optimize=True
            )
            planes = np.maximum(sums + state[f"features.{number}.bias"][:, None, None], 0)
        return [*found, planes]

    total = 0.0
    for number, (one, other) in enumerate(zip(features(image), features(target), strict=True)):
        lengths = [np.sqrt((planes**2).sum(0)) + 1e-10 for planes in (one, other)]
        total += np.tensordot(linear[f"{net}.{number}"], (one / lengths[0] - other / lengths[1]) ** 2, 1).mean()
    return total


@pytest.mark.parametrize("net", NETWORKS)
def test_distance_is_that_of_the_paper(home: Path, net: str) -> None:
    put(net)
    metric = Lpips(net)
    image, target = pictures()
    expected = in_numpy(net, image, target)
    assert expected > 0.005
    assert metric(image, target) == pytest.approx(expected, rel=1e-4)
    assert metric(target, image) == pytest.approx(expected, rel=1e-4)
    assert metric(image, image) == 0.0


def test_invalid_images_and_networks(home: Path) -> None:
    put("alex")
    metric = Lpips("alex")
    image, target = pictures(32, 32)
    assert metric(image, target) > 0
    for wrong in (image[:31], image[..., :2], image[None]):
        with refuses("metrics.image_shape", value=(tuple(wrong.shape), tuple(wrong.shape))):
            metric(wrong, wrong)
    with refuses("metrics.image_shape", value=((32, 32, 3), (32, 33, 3))):
        metric(image, pictures(32, 33)[0])
    with refuses("lpips.unknown_network", value="squeeze", expected=("alex", "vgg")):
        Lpips("squeeze")


def test_the_protocol_names_the_weights_and_a_warning_says_that_they_differ(home: Path) -> None:
    file = put("alex")
    metric = Lpips("alex")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert f"with AlexNet, weights alexnet-owt-7be5be79.pth (SHA-256 {digest[:8]}...)" in metric.protocol
    assert metric.remark.code == "lpips.other_weights"
    assert (metric.remark.file, metric.remark.value) == (file, digest[:8])
    assert metric.remark.fields["expected"] == "7be5be79"


def test_weights_that_cannot_be_downloaded(home: Path) -> None:
    url = "https://download.pytorch.org/models/vgg16-397923af.pth"
    file = home / "vgg16-397923af.pth"
    with refuses("lpips.download_failed", file=file, value=url, setting="evaluate.lpips") as caught:
        Lpips("vgg")
    assert f"Download {url} to {home}" in caught.value.fix


def test_files_that_are_not_weights(home: Path) -> None:
    file = put("alex")
    whole = file.read_bytes()
    for data in (whole[: len(whole) // 2], b"<html>404</html>", b""):
        file.write_bytes(data)
        with refuses("lpips.invalid_weights", file=file):
            Lpips("alex")
    for value in ({}, [1], {"features.0.weight": torch.zeros(2)}):
        torch.save(value, file)
        with refuses("lpips.invalid_weights", file=file) as caught:
            Lpips("alex")
        assert "\n" not in str(caught.value)
