"""Numbered files, and splats rotated for viewers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import refuses
from v3studio.studio.cameras import Camera, look_at_pose
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats
from v3studio.studio.formats.rigid_motion import turned, upright
from v3studio.studio.formats.sequence import axes_of, export_frame, export_sequence
from v3studio.studio.rasterizer import rasterize

K = np.array([[90.0, 0, 40], [0, 90, 32], [0, 0, 1]])


def camera(eye, target=(0, 0, 0), up=(0, 0, 1)) -> Camera:
    return Camera("test", 80, 64, K, look_at_pose(np.array(eye, float), np.array(target, float), np.array(up, float)))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_turned_splats_look_the_same_to_a_camera_that_turns_with_them(make_video: MakeVideo, degree: int) -> None:
    """Images of the reference rasterizer, with SH; rotating only the splats or only the camera changes them."""
    splats = make_video((1,), degree=degree).read(0).to(torch.float64)
    rotation = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    here = camera([2.0, 0.5, 0.3])
    pose = here.world_to_camera.copy()
    pose[:3, :3] = here.rotation @ rotation.T
    there = Camera("turned", 80, 64, K, pose)
    before = rasterize(splats, here, backend="reference").image
    after = rasterize(turned(splats, rotation), there, backend="reference").image
    assert before.max() > 0.3
    assert (after - before).abs().max() < 1e-9
    assert (rasterize(splats, there, backend="reference").image - before).abs().max() > 0.1


def test_upright_brings_up_to_y_and_the_front_to_z(make_video: MakeVideo) -> None:
    video = replace(make_video(), view=camera([3.0, 0.0, 1.0]))
    rotation = upright(video)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(rotation @ [0, 0, 1], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(rotation @ [1, 0, 0], [0, 0, 1], atol=1e-12)  # toward the camera
    # what is on the right of the camera remains on the right
    np.testing.assert_allclose(rotation @ video.view.rotation[0], [1, 0, 0], atol=1e-12)
    # 3DGS files: y down, z away from the camera
    ply = axes_of(video, (0, -1, 0), True)
    np.testing.assert_allclose(ply @ [0, 0, 1], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(ply @ [1, 0, 0], [0, 0, -1], atol=1e-12)
    assert axes_of(video, (0, -1, 0), False) is None
    # without view and up: 180 degrees about x, as the SPZ converter does for PLY
    np.testing.assert_allclose(upright(replace(video, up=None, view=None)), np.diag([1, -1, -1]), atol=1e-12)
    straight_down = camera((0, 0, 3), up=(0, 1, 0))
    assert np.linalg.det(upright(replace(video, view=straight_down))) == pytest.approx(1)


@pytest.mark.parametrize("ending", [".ply", ".spz", ".glb"])
def test_a_file_a_frame_numbered_for_players(tmp_path: Path, make_video: MakeVideo, ending: str) -> None:
    told = []
    part = make_video((4, 3)).part(1, 7, 2)
    export_sequence(part, tmp_path / "out", ending, progress=lambda done, total: told.append((done, total)))
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [f"frame_000{number}{ending}" for number in (1, 3, 5)]
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_what_is_in_the_files(tmp_path: Path, make_video: MakeVideo) -> None:
    video = make_video((4, 3))
    rotation = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    export_sequence(video, tmp_path / "out", ".ply", rotation)
    for index in range(7):
        written = read_splats(tmp_path / "out" / f"frame_{index:04d}.ply")
        x, y, z = video.read(index).means.unbind(1)
        assert torch.allclose(written.means, torch.stack([-y, x, z], dim=1), atol=1e-6)
    export_frame(video.part(5, 6), tmp_path / "one.ply")
    assert torch.equal(read_splats(tmp_path / "one.ply").means, video.read(5).means)
    with refuses("export.already_exists", file=tmp_path / "one.ply"):
        export_frame(make_video(), tmp_path / "one.ply")


def test_parts_of_a_video(make_video: MakeVideo) -> None:
    video = make_video((4, 3))
    part = video.part(2, 7, 2)
    assert (part.frame_count, part.fps, part.group_starts) == (3, 10.0, (0, 1))
    assert [part.number(index) for index in range(3)] == [2, 4, 6]
    assert torch.equal(part.read(2).means, video.read(6).means)
    assert [part.part(4).number(index) for index in range(2)] == [4, 6]
    for wrong in ((7, 8), (3, 3), (-1, 2), (0, 8), (0, 4, 0)):
        with pytest.raises(StudioError, match=r"0 to 6\. Choose a range within 0:7"):
            video.part(*wrong)
