"""Round trip: each attribute within half a step at QP 0, lossless parts exact at any QP."""

import itertools

import numpy as np
import pytest
import torch

from studio.gaussians import Gaussians
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.morton import morton_order


def expect_close(original: Gaussians, decoded: Gaussians, group, label: str) -> None:
    """Each component within half a step of its range in the manifest."""
    half = {e.name: 0.5 * (e.max - e.min) / (65535 if len(e.planes) == 2 else 255) for e in group.components}

    def check(name: str, wanted: torch.Tensor, found: torch.Tensor) -> None:
        error = (wanted.double() - found.double()).abs().max().item()
        size = wanted.abs().max().item()
        assert error <= half[name] * 1.0001 + 4e-7 * size, f"{label} {name}: {error} above {half[name]}"

    for i, axis in enumerate("xyz"):
        check(f"mean_{axis}", original.means[:, i], decoded.means[:, i])
        check(f"log_scale_{i}", original.log_scales[:, i], decoded.log_scales[:, i])
    for k in range(original.sh.shape[1]):
        for i, color in enumerate("rgb"):
            check(f"sh_{k}_{color}", original.sh[:, k, i], decoded.sh[:, k, i])
    check("opacity", original.opacities, decoded.opacities)
    quats = original.unit_quats
    quats = torch.where(((quats * decoded.quats).sum(1) < 0)[:, None], -quats, quats)  # q and -q are one rotation
    for i, axis in enumerate("wxyz"):
        check(f"quat_{axis}", quats[:, i], decoded.quats[:, i])


def check_stream(folder, groups) -> None:
    with StreamReader.open(folder) as reader:
        assert reader.frame_count == sum(len(frames) for frames in groups)
        assert reader.fps == 25.0
        index = 0
        for entry, frames in zip(reader.groups, groups, strict=True):
            order = torch.from_numpy(morton_order(frames[0].means.numpy()))
            for frame in frames:
                decoded = reader.gaussians(index)
                assert len(decoded) == len(frame)
                assert decoded.sh_degree == frame.sh_degree
                expect_close(frame[order], decoded, entry, f"frame {index}")
                index += 1


@pytest.mark.parametrize("frames", [1, 2, 20, 21])
def test_group_lengths(make_stream, frames):
    check_stream(*make_stream((frames,), splats=70))


@pytest.mark.parametrize("splats", [1, 63, 64, 65, 3000])
def test_splat_counts(make_stream, splats):
    check_stream(*make_stream((3,), splats=splats))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_sh_degrees(make_stream, degree):
    check_stream(*make_stream((2,), splats=100, degree=degree))


def test_several_groups_of_different_sizes(make_stream):
    check_stream(*make_stream((3, 1, 4, 2), splats=60))


def test_constant_channels(tmp_path, make_frames):
    frames = [
        Gaussians(
            means=torch.full((50, 3), 1.5),
            quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(50, 1),
            log_scales=torch.full((50, 3), -3.0),
            logit_opacities=torch.full((50,), 2.0),
            sh=torch.zeros(50, 4, 3),
        )
    ] * 3
    entry = bake_group(frames, tmp_path, 0, 0, BakeSettings(profile="planes", quality=0))
    write_manifest(tmp_path, [entry], 30, BakeSettings(profile="planes", quality=0))
    with StreamReader.open(tmp_path) as reader:
        for decoded in reader.iterate():
            for name, tensor in frames[0].items():
                assert torch.allclose(getattr(decoded, name), tensor, atol=1e-6), name


def test_tiny_scales_do_not_widen_the_range(tmp_path, make_frames):
    """A scale of e^-27 is raised to a sixteenth of the typical one; all other splats keep a fine step."""
    frames = make_frames(2, 100)
    for frame in frames:
        frame.log_scales[7, 1] = -27.0
    entry = bake_group(frames, tmp_path, 0, 0, BakeSettings(profile="planes", quality=0))
    typical = frames[0].log_scales.mean(dim=1).median().item()
    ranges = {component.name: component for component in entry.components}
    assert ranges["log_scale_1"].min == pytest.approx(typical - np.log(16), abs=0.02)
    assert ranges["log_scale_0"].min == pytest.approx(min(float(f.log_scales[:, 0].min()) for f in frames))


def test_quaternion_signs_are_continuous(tmp_path, make_frames):
    frames = make_frames(6, 300)  # their signs flip every frame
    settings = BakeSettings(profile="planes", quality=0)
    write_manifest(tmp_path, [bake_group(frames, tmp_path, 0, 0, settings)], 30, settings)
    with StreamReader.open(tmp_path) as reader:
        decoded = list(reader.iterate())
    assert (decoded[0].quats[:, 0] >= -0.01).all()
    for before, after in itertools.pairwise(decoded):
        assert ((before.quats * after.quats).sum(1) > 0).all()


@pytest.mark.parametrize("mirror", [False, True])
def test_high_bytes_are_lossless_and_low_errors_do_not_carry(tmp_path, make_frames, mirror):
    frames = make_frames(5, 2000)
    settings = BakeSettings(profile="planes", quality=45, mirror_low_bytes=mirror)
    entry = bake_group(frames, tmp_path, 0, 0, settings)
    write_manifest(tmp_path, [entry], 30, settings)
    order = torch.from_numpy(morton_order(frames[0].means.numpy()))
    with StreamReader.open(tmp_path) as reader:
        for frame, decoded in zip(frames, reader.iterate(), strict=True):
            for i, component in enumerate(entry.components[:3]):
                step = (component.max - component.min) / 65535

                def codes(values, component=component, step=step):
                    return np.rint((values.double().numpy() - component.min) / step).astype(int)

                wanted, found = codes(frame.means[order][:, i]), codes(decoded.means[:, i])
                assert np.array_equal(wanted >> 8, found >> 8)
                assert np.abs(wanted - found).max() > 0  # lossy indeed


def test_lower_qp_is_nearer(tmp_path, make_frames):
    frames = make_frames(4, 3000)
    order = torch.from_numpy(morton_order(frames[0].means.numpy()))
    errors, sizes = [], []
    for qp in (0, 15, 22, 40):
        settings = BakeSettings(profile="planes", quality=qp)
        entry = bake_group(frames, tmp_path / str(qp), 0, 0, settings)
        write_manifest(tmp_path / str(qp), [entry], 30, settings)
        with StreamReader.open(tmp_path / str(qp)) as reader:
            decoded = list(reader.iterate())
        errors.append(
            np.mean([(a[order].means - b.means).pow(2).mean().item() for a, b in zip(frames, decoded, strict=True)])
        )
        sizes.append(entry.bytes)
    assert errors == sorted(errors)
    assert sizes == sorted(sizes, reverse=True)
