"""Files that other programs converted from known splats: read and compared splat by splat."""

from pathlib import Path

import pytest
import torch

from tests.support.splats import COUNT, converted_splats
from v3studio.studio.formats import read_splats, splats_size, write_splats
from v3studio.studio.gaussians import Gaussians

DATA = Path(__file__).parents[2] / "data" / "splats"
CONVERTED = sorted(path for path in [*DATA.glob("degree*"), *DATA.glob("sog/*/meta.json")])


def degree_of(path: Path) -> int:
    return int((path.parent.name if path.name == "meta.json" else path.name)[len("degree")])


def matched(splats: Gaussians, meant: Gaussians) -> Gaussians:
    """`meant` in the order of `splats`: converters sort."""
    nearest = torch.cdist(splats.means.double(), meant.means.double()).argmin(dim=1)
    assert sorted(nearest.tolist()) == list(range(len(meant)))
    return meant[nearest]


def test_every_format_and_degree_is_covered() -> None:
    covered = {("".join(path.suffixes[-2:]).replace(".json", "sog"), degree_of(path)) for path in CONVERTED}
    assert {degree for _, degree in covered} == {0, 1, 2, 3}
    assert {ending for ending, _ in covered} == {".spz", ".compressed.ply", ".sog", "sog", ".splat"}


# Half a step of each format, generously: means, rotation (1 - |dot|), log scale, opacity, color; root mean square of SH
@pytest.mark.parametrize(
    ("ending", "steps"),
    [
        (".spz", (2**-13, 1e-5, 1 / 32, 0.5 / 255, 0.5 / 255 / 0.15, 0.04)),
        (".compressed.ply", (3e-3, 1e-5, 2e-3, 0.5 / 255, 4e-3, 0.01)),
        (".sog", (2e-4, 2e-4, 6e-3, 1 / 255, 4e-3, 0.12)),
        (".json", (2e-4, 2e-4, 6e-3, 1 / 255, 4e-3, 0.12)),
        (".splat", (0, 2e-4, 1e-5, 1 / 255, 1 / 255 / 0.28, 0)),
    ],
)
def test_each_splat_is_within_the_steps_of_the_format(ending: str, steps: tuple[float, ...]) -> None:
    for path in CONVERTED:
        if path.suffix != ending and not path.name.endswith(ending):
            continue
        splats = read_splats(path)
        assert (len(splats), splats.sh_degree) == splats_size(path) == (COUNT, degree_of(path))
        meant = matched(splats, converted_splats(degree_of(path)))
        turned = 1 - (splats.unit_quats * meant.unit_quats).sum(dim=1).abs()
        errors = {
            "means": (splats.means - meant.means).abs().max(),
            "quats": turned.max(),
            "scales": (splats.log_scales - meant.log_scales).abs().max(),
            "opacity": (splats.opacities - meant.opacities).abs().max(),
            "color": (splats.sh[:, 0] - meant.sh[:, 0]).abs().max(),
            "sh": (splats.sh[:, 1:] - meant.sh[:, 1:]).pow(2).mean().nan_to_num().sqrt(),
        }
        for (name, error), step in zip(errors.items(), steps, strict=True):
            assert error <= step + 1e-6, (path.name, name, float(error))


@pytest.mark.parametrize(("degree", "version"), [(0, 4), (1, 4), (2, 4), (3, 4), (1, 3)])
def test_our_spz_has_the_values_of_the_reference_implementation(tmp_path: Path, degree: int, version: int) -> None:
    """splat-transform writes through the WebAssembly build of Niantic's own code."""
    theirs = DATA / (f"degree{degree}-v3.spz" if version == 3 else f"degree{degree}.spz")
    write_splats(converted_splats(degree), tmp_path / "a.spz", version=version)
    mine, other = read_splats(tmp_path / "a.spz"), read_splats(theirs)
    for name, values in other.items():
        if name == "means":  # ours have more fractional bits
            assert (getattr(mine, name) - values).abs().max() <= 2**-13 + 1e-6
        elif name == "quats":
            assert torch.allclose(mine.quats, values, atol=2e-3)
        else:
            assert torch.equal(getattr(mine, name), values), name
