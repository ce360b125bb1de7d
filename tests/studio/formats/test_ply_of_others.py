"""PLY files as other trainers write them, written by plyfile: the splats meant, or an error that names the property."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

from tests.support.errors import refuses
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats, up_of

COUNT = 50


def plain(**changes) -> dict[str, np.ndarray]:
    """Columns of a file of 3DGS, SH degree 0."""
    random = np.random.default_rng(3)
    columns = {name: random.normal(0, 0.3, COUNT) for name in "xyz"}
    columns |= {name: np.zeros(COUNT) for name in ("nx", "ny", "nz")}
    columns |= {f"f_dc_{index}": random.normal(0, 1, COUNT) for index in range(3)}
    columns |= {"opacity": random.normal(2, 1, COUNT)}
    columns |= {f"scale_{index}": random.normal(-4, 0.3, COUNT) for index in range(3)}
    columns |= {f"rot_{index}": random.normal(0, 1, COUNT) for index in range(4)}
    return columns | changes


def saved(path, columns, comments=(), **options):
    kinds = options.get("kinds", {})
    rows = np.empty(len(next(iter(columns.values()))), [(name, kinds.get(name, "<f4")) for name in columns])
    for name, values in columns.items():
        rows[name] = values
    elements = [PlyElement.describe(rows, "vertex"), *options.get("others", ())]
    PlyData(elements, byte_order="<", comments=list(comments)).write(str(path))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.ply"


def test_the_filter_of_mip_splatting_is_merged(path: Path) -> None:
    """The result is compared with the covariance and the integral of a Gaussian that is convolved with the filter."""
    columns = plain()
    before = read_splats(saved(path, columns))
    notes = []
    after = read_splats(saved(path, columns | {"filter_3D": np.full(COUNT, 0.02)}), notes.append)
    np.testing.assert_allclose(after.scales.square(), before.scales.square() + 0.02**2, rtol=1e-5)
    mass = [splats.opacities * splats.scales.prod(dim=1) for splats in (before, after)]
    np.testing.assert_allclose(mass[1], mass[0], rtol=1e-4)
    assert len(notes) == 1


def test_colors_in_bytes_are_refused(path: Path) -> None:
    columns = plain(f_dc_0=np.full(COUNT, 200.0))
    with refuses("splat_file.integers", file=path, value="f_dc_0"):
        read_splats(saved(path, columns, kinds={"f_dc_0": "u1"}))


def test_two_scales_are_flat_splats(path: Path) -> None:
    columns = plain()
    del columns["scale_2"]
    notes = []
    splats = read_splats(saved(path, columns), notes.append)
    assert splats.log_scales[:, 1].numpy() == pytest.approx(columns["scale_1"].astype(np.float32))
    assert splats.scales[:, 2].max() < 1e-6 * splats.scales[:, :2].min()
    assert len(notes) == 1


@pytest.mark.parametrize(
    "name",
    ["motion_0", "omega_3", "trbf_center", "t", "scale_t", "rot_r_0", "f_t_2", "f_offset_0", "f_anchor_feat_7",
     "sg_axis_0", "beta", "sb_params_4", "shape", "scale_3", "rot_4", "f_dc_3", "filter_2D"],
)  # fmt: skip
def test_properties_of_other_kinds_of_splats_are_refused_by_name(path: Path, name: str) -> None:
    saved(path, plain(**{name: np.zeros(COUNT)}))
    with refuses("splat_file.other_splats", file=path, value=[name]):
        read_splats(path)


def test_other_properties_and_elements_are_named(path: Path) -> None:
    camera = PlyElement.describe(np.zeros(1, [("fx", "<f4")]), "intrinsic")
    notes = []
    saved(path, plain(red=np.ones(COUNT), confidence=np.ones(COUNT)), others=[camera])
    splats = read_splats(path, notes.append)
    assert splats.means.equal(read_splats(saved(path, plain())).means)
    assert sorted("intrinsic" in note for note in notes) == [False, True]
    assert sum("confidence" in note for note in notes) == 1
    assert not any("red" in note.split(": ")[-1] for note in notes)


@settings(max_examples=40, deadline=None)
@given(
    victim=st.sampled_from([name for name in plain() if name[0] != "n"]),
    new=st.from_regex(r"[a-z]{1,9}(_[0-9])?", fullmatch=True),
    added=st.booleans(),
)
def test_others_are_never_misread(tmp_path_factory: pytest.TempPathFactory, victim: str, new: str, added: bool) -> None:
    """Either the splats are right and a note names the property, or an error names one of the two."""
    columns = plain()
    if new in columns:
        return
    path = tmp_path_factory.mktemp("renamed") / "a.ply"
    meant = read_splats(saved(path, columns))
    changed = columns | {new: columns[victim]}
    if not added:
        del changed[victim]
    notes = []
    saved(path, changed)
    try:
        splats = read_splats(path, notes.append)
    except StudioError as error:
        problem = str(error)
        assert victim in problem or new in problem
        return
    if victim != "scale_2" or added:
        assert all(one.equal(other) for (_, one), (_, other) in zip(meant.items(), splats.items(), strict=True))
    assert any(new in note for note in notes) or new in ("red", "green", "blue", "alpha")


def test_the_comment_on_the_vertical_axis_is_honored(path: Path) -> None:
    for comment, up in (
        ("Generated by Nerfstudio 1.1.5", (0, -1, 0)),
        ("Vertical Axis: z", (0, 0, 1)),
        ("Vertical axis: y", (0, -1, 0)),  # Brush, which writes it whatever is up
        ("vertical axis: -z", (0, 0, -1)),
        ("Vertical axis: +y", (0, 1, 0)),
        ("Vertical axis: 0 0 2", (0, 0, 1)),
    ):
        assert up_of(saved(path, plain(), comments=[comment])) == up
