"""Sequences of splat files from other programs: order, group boundaries, baking."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.studio.formats.test_ply_of_others import saved
from tests.support.errors import cancel_at, refuses
from tests.support.performer import covariances
from tests.support.splats import cloud
from v3studio.studio.errors import Cancelled
from v3studio.studio.formats import write_splats
from v3studio.studio.formats.baking import bake_video, cut
from v3studio.studio.formats.frame_files import find_frames, frame_numbers
from v3studio.studio.formats.sequence import open_import
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.playback import play_headless
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream import BakeSettings, StreamReader

SPLATS = Path(__file__).parents[2] / "data" / "splats"


def body(frame: int, splats: int = 120, degree: int = 0) -> Gaussians:
    """A body that moves along x, with the same splats in each frame."""
    one = cloud(splats, degree)
    means = one.means * torch.tensor([0.2, 0.2, 0.5]) + torch.tensor([0.05 * frame, 0, 0])
    return replace(one, means=means, log_scales=one.log_scales / 2 - 2)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "in"
    folder.mkdir()
    return folder


def test_numbers_say_the_order(folder: Path) -> None:
    for name in ("walk10.ply", "walk9.ply", "walk_2.extra.ply", ".hidden_1.ply", "notes.txt"):
        (folder / name).touch()
    files = [(number, path.name) for number, path in find_frames(folder)]
    assert files == [(2, "walk_2.extra.ply"), (9, "walk9.ply"), (10, "walk10.ply")]
    (folder / "other9.ply").touch()
    with refuses("import.duplicate_frame", file=folder, value=9, files=["other9.ply", "walk9.ply"]):
        find_frames(folder)


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["frame_0001_iter_30000.ply", "frame_0002_iter_29000.ply"], [1, 2]),
        (["30000_f1.ply", "7000_f2.ply"], [1, 2]),
        (["frame_2_v9.ply", "frame_3_v1.ply"], [2, 3]),
        (["take2.0009.ply", "take2.0010.ply"], [9, 10]),
        (["1.compressed.ply", "10.compressed.ply", "9.compressed.ply"], [1, 10, 9]),
        (["a3_b3.spz", "a10_b10.spz"], [3, 10]),
        (["still.ply"], [-1]),
        (["scan_7.ply"], [7]),
        (["0", "10", "2"], [0, 10, 2]),
    ],
)
def test_the_number_that_changes_is_that_of_the_frame(folder: Path, names: list[str], numbers: list[int]) -> None:
    assert frame_numbers(folder, names) == numbers


def test_names_that_do_not_say_the_order_are_refused(folder: Path) -> None:
    with refuses("import.ambiguous_order", file=folder, value=["a1_b2.ply", "a2_b1.ply"]):
        frame_numbers(folder, ["a1_b2.ply", "a2_b1.ply"])
    with refuses("import.iterations", file=folder) as caught:
        frame_numbers(folder, ["iteration_30000.ply", "iteration_7000.ply"])
    assert caught.value.fix.endswith("iteration_30000.ply")


def test_checkpoints_of_one_folder_per_frame(folder: Path) -> None:
    """The folders are as the released code of VideoGS leaves them: the last iteration of each frame, in the order of
    the frames."""
    for frame in (0, 9, 10):
        for iteration in (7000, 30000):
            place = folder / str(frame) / "point_cloud" / f"iteration_{iteration}"
            place.mkdir(parents=True)
            write_splats(body(frame, splats=100 + iteration // 1000), place / "point_cloud.ply")
    video = open_import(folder)
    assert (video.frame_count, len(video.read(2))) == (3, 130)
    np.testing.assert_allclose(video.read(2).means, body(10, splats=130).means, atol=1e-6)
    assert any("between 0 and 9" in note for note in video.notes)
    assert len(open_import(folder / "9").read(0)) == 130
    assert open_import(folder / "9" / "point_cloud").frame_count == 1


def test_a_splat_that_is_unusable_in_one_frame_is_dropped_from_its_group(folder: Path) -> None:
    for index in range(3):
        frame = body(index)
        if index == 1:
            frame.means[7, 0] = torch.nan
            frame.log_scales[8, 1] = torch.inf
            frame.log_scales[9, 2] = 100.0  # a scale beyond float32
            frame.quats[10] = 0
        write_unchecked(folder / f"f{index}.ply", frame)
    video = open_import(folder)
    kept = [index for index in range(120) if index not in (7, 8, 9, 10)]
    assert video.group_starts == (0,)
    for index in range(3):
        assert torch.equal(video.read(index).means, body(index).means[kept])
    assert any(note.startswith("4 splats") for note in video.notes)


def write_unchecked(path: Path, splats: Gaussians) -> None:
    """A PLY file, whatever the values."""
    plain = {name: splats.means[:, index] for index, name in enumerate("xyz")}
    plain |= {f"f_dc_{index}": splats.sh[:, 0, index] for index in range(3)} | {"opacity": splats.logit_opacities}
    plain |= {f"scale_{index}": splats.log_scales[:, index] for index in range(3)}
    plain |= {f"rot_{index}": splats.quats[:, index] for index in range(4)}
    saved(path, plain)


def decoded_errors(video: SplatVideo, stream: Path, meant: Gaussians) -> torch.Tensor:
    """Distance of each splat of the second frame to the nearest decoded one."""
    bake_video(video, stream, BakeSettings(quality=0))
    with StreamReader.open(stream) as reader:
        played = reader.gaussians(1)
    return torch.cdist(meant.means.double(), played.means.double()).min(dim=1).values


@pytest.mark.parametrize("distance", [1e2, 1e4, 1e6, 1e30])
def test_far_splats_do_not_cost_the_others_their_precision(folder: Path, tmp_path: Path, distance: float) -> None:
    frames = [body(index, splats=3000) for index in range(2)]
    plain = SplatVideo("plain", 30.0, 2, (0,), [frame.clone() for frame in frames].__getitem__)
    usual = decoded_errors(plain, tmp_path / "plain", frames[1])
    for frame in frames:
        for splat in range(3):
            frame.means[splat, splat] = distance * (-1) ** splat
    for index, frame in enumerate(frames):
        write_unchecked(folder / f"f{index}.ply", frame)
    video = open_import(folder)
    assert any("3 splats" in note for note in video.notes)
    errors = decoded_errors(video, tmp_path / "stream", frames[1][3:])
    assert errors.median() < 1.5 * usual.median()
    assert errors.quantile(0.99) < 2 * usual.quantile(0.99)
    assert errors.max() < 0.2 * frames[1].scales.median()
    pulled = video.read(0)  # seen from the middle, the far ones have the same direction and angular size
    before, after = frames[0].means[:3].double(), pulled.means[:3].double()
    assert torch.nn.functional.cosine_similarity(before, after).min() > 0.999
    sizes = [splats.log_scales[:3, 0].double() - means.norm(dim=1).log() for splats, means in
             ((frames[0], before), (pulled, after))]  # fmt: skip
    assert (sizes[0] - sizes[1]).abs().max() < 0.05


@pytest.mark.parametrize(("away", "noted"), [(100.0, 0), (1e6, 1)])
def test_positions_that_float32_cannot_hold_are_noted(folder: Path, away: float, noted: int) -> None:
    for index in range(2):
        frame = body(index)
        frame.means[:, 1] += away
        write_splats(frame, folder / f"f{index}.ply")
    assert sum("steps of" in note for note in open_import(folder).notes) == noted


def test_a_folder_of_no_or_more_than_one_format_is_refused_by_name(folder: Path) -> None:
    with refuses("import.not_found", file=folder / "none"):
        open_import(folder / "none")
    with refuses("import.no_files", file=folder):
        open_import(folder)
    for name in ("a1.ply", "a2.PLY", "a2.spz", "a3.glb"):
        (folder / name).touch()
    files = ["a1.ply", "a2.spz", "a3.glb"]
    with refuses("import.mixed_formats", file=folder, value=[".ply", ".spz", ".glb"], files=files):
        open_import(folder)
    for name in ("a1.ply", "a2.PLY"):
        (folder / name).unlink()
    with refuses("import.mixed_formats", file=folder, value=[".spz", ".glb"]):
        open_import(folder)
    (folder / "a2.spz").unlink()
    with refuses("import.no_files", file=folder):  # GLB is only written
        open_import(folder)


def test_open_sog_data_sets(folder: Path) -> None:
    """meta.json with images: itself, its folder, and folders of them as frames; others' meta.json do not count."""
    assert open_import(SPLATS / "sog" / "degree1" / "meta.json").frame_count == 1
    assert open_import(SPLATS / "sog" / "degree1").frame_count == 1
    for number in (10, 9):
        shutil.copytree(SPLATS / "sog" / "degree1", folder / f"frame{number}")
    (folder / "notes").mkdir()
    (folder / "meta.json").write_text('{"made by": "someone"}')
    assert [path.parent.name for _, path in find_frames(folder)] == ["frame9", "frame10"]
    video = open_import(folder)
    assert (video.frame_count, video.group_starts, video.up.tolist()) == (2, (0,), [0, -1, 0])
    shutil.copytree(SPLATS / "sog" / "degree1", folder / "again9")
    with refuses("import.duplicate_frame", file=folder, value=9, files=["again9", "frame9"]):
        find_frames(folder)
    shutil.copy(SPLATS / "degree3.sog", folder)
    with refuses("import.mixed_formats", file=folder, value=["*/meta.json", ".sog"]):
        find_frames(folder)


@pytest.mark.parametrize("name", ["degree1.compressed.ply", "degree1.spz", "degree0.sog", "degree0.splat"])
def test_sequences_of_each_format_are_baked(folder: Path, tmp_path: Path, name: str) -> None:
    for frame in range(3):
        shutil.copy(SPLATS / name, folder / f"f{frame}{name[name.index('.') :]}")
    manifest = bake_video(open_import(folder), tmp_path / "stream", BakeSettings(quality=0))
    assert [group.frame_count for group in manifest.groups] == [3]
    assert manifest.renditions[0].sh_degree == int(name[6])
    assert manifest.metadata["up"] == ([0, 1, 0] if name.endswith(".spz") else [0, -1, 0])


def test_groups_begin_where_splats_can_no_longer_be_followed(folder: Path) -> None:
    shuffled = torch.randperm(120, generator=torch.Generator().manual_seed(5))
    frames = [body(0), body(1), body(2)[shuffled], body(3)[shuffled], body(4, 90), body(5, 80), body(6, 80)]
    for index, frame in enumerate(frames):
        write_splats(frame, folder / f"f{index}.ply")
    told = []
    video = open_import(folder, progress=lambda done, total, **figures: told.append((done, total)))
    assert video.group_starts == (0, 2, 4, 5)
    assert told == [(index, 7) for index in range(8)]
    assert cut(video, 1) == [range(index, index + 1) for index in range(7)]
    assert cut(video, 20) == cut(video, 20, 2) == [range(2), range(2, 4), range(4, 5), range(5, 7)]
    assert cut(video, 20, 1) == [range(1), range(1, 2), range(2, 4), range(4, 5), range(5, 7)]


def test_baked_and_played(folder: Path, tmp_path: Path) -> None:
    frames = [body(index, degree=1) for index in range(5)] + [body(5, splats=70)]
    for index, frame in enumerate(frames):
        write_splats(frame, folder / f"f{index:02d}.ply")
    manifest = bake_video(open_import(folder, fps=10), tmp_path / "stream", BakeSettings(quality=0), group_size=3)
    assert [group.frame_count for group in manifest.groups] == [3, 2, 1]
    assert (manifest.renditions[0].sh_degree, manifest.fps, manifest.metadata["up"]) == (1, 10, [0, -1, 0])
    with StreamReader.open(tmp_path / "stream") as reader:
        for index, meant in enumerate(frames):
            played = reader.gaussians(index)
            assert len(played) == len(meant)
            nearest = torch.cdist(meant.means.double(), played.means.double())
            assert nearest.min(dim=1).values.max() < 1e-3  # position steps depend on the splats' size and opacity
            which = nearest.argmin(dim=1)
            assert (played.opacities[which] - meant.opacities).abs().max() < 0.01
            shapes = [covariances(splats) for splats in (played[which], meant)]
            assert np.abs(shapes[0] - shapes[1]).max() < 0.02 * np.trace(shapes[1], axis1=1, axis2=2).max()
            if len(meant) == 120:
                assert (played.sh[which] - meant.sh).abs().max() < 0.02
    assert play_headless(tmp_path / "stream").shown == 6


def test_a_damaged_frame_leaves_nothing_behind(folder: Path, tmp_path: Path) -> None:
    for frame in range(3):
        write_splats(body(frame), folder / f"f{frame}.ply")
    video = open_import(folder)
    path = folder / "f2.ply"
    path.write_bytes(path.read_bytes()[:-100])
    with refuses("splat_file.unreadable", file=path):
        bake_video(video, tmp_path / "stream", BakeSettings())
    write_splats(body(2), path)

    with pytest.raises(Cancelled):
        bake_video(video, tmp_path / "stream", BakeSettings(), progress=cancel_at(2))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]
    with refuses("import.invalid_group_size", value=0):
        bake_video(video, tmp_path / "stream", BakeSettings(), group_size=0)
