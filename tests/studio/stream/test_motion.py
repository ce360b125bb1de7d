"""Round trip of the profile `motion`, up to permutations of a splat's axes. In version 2, which smooths nothing."""

import json

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from studio.gaussians import Gaussians
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from tests.support.errors import refuses

AXIS_NAMES = Rotation.create_group("O")  # the 24 rotations of the cube


def bake(folder, frames, threads=0, **settings):
    settings = BakeSettings(**{"preset": "veryfast", **settings})
    entry = bake_group(frames, folder, 0, 0, settings, threads=threads)
    write_manifest(folder, [entry], 30, settings)
    with StreamReader.open(folder) as reader:
        return entry, list(reader.iterate())


def contents(folder):
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def matches(original: Gaussians, decoded: Gaussians) -> np.ndarray:
    """Index of the original of each decoded splat, by position in the keyframe."""
    index = cKDTree(original.means.numpy()).query(decoded.means.numpy())[1]
    assert np.array_equal(np.sort(index), np.arange(len(original)))
    return index


def rotations(gaussians: Gaussians) -> Rotation:
    return Rotation.from_quat(gaussians.quats.numpy()[:, [1, 2, 3, 0]])


def expect_close(original: Gaussians, decoded: Gaussians, entry, keyframe: bool, label: str) -> None:
    """Every attribute within half its step in the manifest (QP 0)."""
    step = {channel.name: channel.step for channel in entry.channels}

    def check(name, error, limit):
        assert np.abs(error).max() <= limit * 1.001 + 2e-6, f"{label} {name}: {np.abs(error).max()} above {limit}"

    means = (original.means - decoded.means).numpy()
    # a splat of class c has residual steps of 2^c; large drifts over 20 frames need up to class 6
    coarsest = 2**4 if entry.frame_count < 10 else 2**6
    if not keyframe:  # splats that are not drawn move with their surroundings
        means = means[(original.opacities >= 1 / 255).numpy()]
    check("means", means, entry.positions.step / 2 if keyframe else coarsest * step["residual_x"] / 2)
    scale = max(step[f"log_scale_{i}"] for i in range(3)) / 2
    floor = decoded.log_scales.min().item()
    wanted = np.sort(np.maximum(original.log_scales.numpy(), floor), axis=1)
    check("log_scales", wanted - np.sort(decoded.log_scales.numpy(), axis=1), scale)
    check("opacity", (original.opacities - decoded.opacities).numpy(), step["opacity"] / 2)
    for k in range(original.sh.shape[1]):
        y, co, cg = (step[f"sh_{k}_{part}"] / 2 for part in ("y", "co", "cg"))
        error = (original.sh - decoded.sh).numpy()[:, k]
        check(f"sh_{k}", error, y + co + cg)
        check(f"sh_{k} luma", error @ [0.25, 0.5, 0.25], y)
    # the nearest of the 24 permutations of the axes
    between = rotations(original).inv() * rotations(decoded)
    angles = np.min([(between * name).magnitude() for name in AXIS_NAMES], axis=0)
    check("angles", angles, 4 * np.sqrt(3) * max(step[f"rotation_{i}"] for i in range(3)) / 2)


def expect_same_shape(original: Gaussians, decoded: Gaussians, tolerance: float) -> None:
    """Covariances agree, so scales are permuted with their axes."""

    def covariance(gaussians):
        axes = rotations(gaussians).as_matrix() * gaussians.scales.numpy()[:, None]
        return axes @ axes.transpose(0, 2, 1)

    wanted, found = covariance(original), covariance(decoded)
    size = np.trace(wanted, axis1=1, axis2=2)[:, None, None]
    assert (np.abs(wanted - found) / size).max() < tolerance


def check(frames, folder, **settings):
    entry, decoded = bake(folder, frames, quality=0, **settings)
    index = matches(frames[0], decoded[0])
    assert len(decoded) == len(frames)
    for number, (frame, found) in enumerate(zip(frames, decoded, strict=True)):
        original = Gaussians(frame.means, frame.unit_quats, frame.log_scales, frame.logit_opacities, frame.sh)[index]
        expect_close(original, found, entry, number == 0, f"frame {number}")
        expect_same_shape(original, found, 0.05)
    return entry


@pytest.mark.parametrize("frames", [1, 2, 20, 21])
def test_group_lengths(tmp_path, make_frames, frames):
    check(make_frames(frames, 70), tmp_path)


@pytest.mark.parametrize("splats", [1, 63, 64, 65, 255, 256, 257, 3000])
def test_splat_counts(tmp_path, make_frames, splats):
    check(make_frames(3, splats), tmp_path)


def test_hundred_thousand_splats(tmp_path, make_frames):
    frames = make_frames(2, 100_000)
    entry, decoded = bake(tmp_path, frames, quality=0, preset="ultrafast")
    index = matches(frames[0], decoded[0])
    for frame, found in zip(frames, decoded, strict=True):
        assert (frame.opacities[index] - found.opacities).abs().max() <= 0.51 * entry.channels[9].step
        drawn = frame.opacities[index] >= 1 / 255  # others move with their surroundings
        assert (frame.means[index] - found.means)[drawn].norm(dim=1).max() < 0.01


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_sh_degrees(tmp_path, make_frames, degree):
    check(make_frames(2, 100, degree), tmp_path)


@pytest.mark.parametrize("frames", [1, 4])
def test_one_outlier_leaves_the_other_splats_their_steps(tmp_path, turning_bodies, frames):
    """A single odd color among 3,000 is an escape, however few values the channel has; it stays what it is."""
    plain = turning_bodies(frames, 3000)
    for frame in plain:
        frame.sh.clamp_(-0.8, 0.8)
    colored = [Gaussians(f.means, f.quats, f.log_scales, f.logit_opacities, f.sh.clone()) for f in plain]
    for frame in colored:
        frame.sh[17, 0] = torch.tensor([60.0, 40.0, -50.0])
    wanted, _ = bake(tmp_path / "plain", plain, quality=20)
    found, decoded = bake(tmp_path / "colored", colored, quality=20)
    for before, after in zip(wanted.channels, found.channels, strict=True):
        assert after.step == pytest.approx(before.step, rel=0.02), after.name
    index = matches(plain[0], decoded[0])
    odd = int(np.flatnonzero(index == 17)[0])
    for frame in decoded:
        assert torch.allclose(frame.sh[odd, 0], torch.tensor([60.0, 40.0, -50.0]), atol=0.03)
        others = np.arange(3000) != odd
        assert (frame.sh[others] - plain[0].sh[index[others]]).abs().mean() < 0.02


def test_constant_channels(tmp_path):
    frame = Gaussians(
        means=torch.full((50, 3), 1.5),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(50, 1),
        log_scales=torch.full((50, 3), -3.0),
        logit_opacities=torch.full((50,), 2.0),
        sh=torch.zeros(50, 4, 3),
    )
    for qp in (0, 25):
        _, decoded = bake(tmp_path / str(qp), [frame] * 3, quality=qp)
        for found in decoded:
            for name, tensor in frame.items():
                assert torch.allclose(getattr(found, name), tensor, atol=1e-5), name


def test_blocks_find_what_moves_together(tmp_path, turning_bodies):
    """Two rigid bodies in the same place leave almost no residuals for the video."""
    frames = turning_bodies(5, 2000)
    entry, decoded = bake(tmp_path, frames, quality=20)
    _, still = bake(tmp_path / "still", [frames[0]] * 5, quality=20)
    assert len(still) == 5
    index = matches(frames[0], decoded[0])
    wrong = (frames[4].means[index] - decoded[4].means).norm(dim=1)
    assert wrong.median() < 0.005  # the bodies are 0.2 wide and moved by 0.2
    moving, resting = entry.bytes, sum(len(data) for data in contents(tmp_path / "still" / "group_000").values())
    assert moving < 1.5 * resting


def test_fewer_bytes_than_planes_and_nearer(tmp_path, turning_bodies):
    frames = turning_bodies(6, 3000)
    _, decoded = bake(tmp_path / "motion", frames, quality=20)
    motion = len(b"".join(contents(tmp_path / "motion").values()))
    bake(tmp_path / "planes", frames, profile="planes", quality=20)
    planes = len(b"".join(contents(tmp_path / "planes").values()))
    assert motion < planes / 2
    assert len(decoded) == 6


def test_keyframe_positions_are_stored_without_loss_at_any_qp(tmp_path, make_frames):
    frames = make_frames(3, 500)
    for qp in (5, 25, 45):
        entry, decoded = bake(tmp_path / str(qp), frames, quality=qp)
        index = matches(frames[0], decoded[0])
        error = (frames[0].means[index] - decoded[0].means).abs().max().item()
        # the residual's code is 128 in the keyframe; a lossy codec may miss it by a little
        assert error <= entry.positions.step / 2 + 16 * entry.channels[0].step


def test_lower_qp_is_nearer_and_larger(tmp_path, make_frames):
    frames = make_frames(4, 3000)
    errors, sizes = [], []
    for qp in (0, 12, 22, 40):
        entry, decoded = bake(tmp_path / str(qp), frames, quality=qp)
        index = matches(frames[0], decoded[0])
        errors.append(
            np.mean([(a.means[index] - b.means).pow(2).mean().item() for a, b in zip(frames, decoded, strict=True)])
        )
        sizes.append(entry.bytes)
    assert errors == sorted(errors)
    assert sizes == sorted(sizes, reverse=True)


def test_same_input_gives_the_same_bytes(tmp_path, make_frames):
    frames = make_frames(4, 500)
    shuffle = torch.randperm(500, generator=torch.Generator().manual_seed(1))
    bake(tmp_path / "a", frames, threads=1)
    bake(tmp_path / "b", frames, threads=4)
    bake(tmp_path / "b", frames)  # over what is there
    bake(tmp_path / "c", [frame[shuffle] for frame in frames])
    assert contents(tmp_path / "a") == contents(tmp_path / "b") == contents(tmp_path / "c")
    assert list(contents(tmp_path / "a")) == ["group_000/motion.bin", "group_000/video.mp4", "manifest.json"]


@pytest.mark.parametrize("codec", ["h264", "hevc", "av1"])
def test_codecs(tmp_path, codec, turning_bodies):
    import av

    frames = turning_bodies(5, 1000)
    entry, decoded = bake(tmp_path, frames, quality=16, codec=codec)
    assert json.loads((tmp_path / "manifest.json").read_text())["codec"]["name"] == codec
    index = matches(frames[0], decoded[0])
    for frame, found in zip(frames, decoded, strict=True):
        assert (frame.opacities[index] - found.opacities).abs().mean() < 0.03
        assert (frame.means[index] - found.means).norm(dim=1).median() < 0.01
    with av.open(str(tmp_path / entry.video.path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.codec.canonical_name == codec
        assert stream.codec_context.color_range == 2  # full
        pictures = list(container.decode(stream))
        for plane in (plane for picture in pictures for plane in picture.planes[1:]):
            chroma = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[:, : plane.width]
            assert (chroma == 128).all()  # neutral
        if codec == "h264":
            assert stream.codec_context.profile == "High"
            assert [int(picture.pict_type) for picture in pictures] == [1] + [2] * 4  # I, then P
    assert b"Lavf" not in (tmp_path / entry.video.path).read_bytes()


def test_any_order_gives_the_same_frames(make_stream):
    folder, _ = make_stream((4, 1, 5), splats=150, settings=BakeSettings(quality=25))
    with StreamReader.open(folder) as reader:
        in_order = list(reader.iterate())
        for index in (9, 0, 3, 3, 5, 4, 8, 6, 1):
            found = reader.gaussians(index)
            assert all(torch.equal(a, b) for (_, a), (_, b) in zip(found.items(), in_order[index].items(), strict=True))


def test_axes_keep_their_names_through_the_group(tmp_path, make_frames):
    frames = make_frames(6, 300)  # the quaternions' signs flip every frame
    _, decoded = bake(tmp_path, frames, quality=0)
    index = matches(frames[0], decoded[0])
    names = []
    for frame, found in zip(frames, decoded, strict=True):
        between = rotations(frame[torch.from_numpy(index)]).inv() * rotations(found)
        names.append(np.argmin([(between * name).magnitude() for name in AXIS_NAMES], axis=0))
    assert all(np.array_equal(name, names[0]) for name in names)


def test_bad_frames_are_refused(tmp_path, make_frames):
    frames = make_frames(3, 100)
    settings = BakeSettings()
    with refuses("bake.no_splats"):
        bake_group([frames[0][:0]], tmp_path, 0, 0, settings)
    with refuses("bake.mixed_frames", frame=1, value=(99, 0), expected=(100, 0)):
        bake_group([frames[0], frames[1][:99]], tmp_path, 0, 0, settings)
    frames[2].means[4, 0] = float("nan")
    with refuses("gaussians.not_finite", frame=2, attribute="means"):
        bake_group(frames, tmp_path, 0, 0, settings)
    assert contents(tmp_path) == {}
