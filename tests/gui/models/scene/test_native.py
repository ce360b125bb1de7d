"""The scene for Open3D: who draws it, what is handed over, and clicks on its cameras."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from gui.models.playback.player import PlayerPresenter
from gui.models.preferences import drawn_by_open3d
from gui.models.scene.native import splat_arrays
from gui.models.take.workspace import Workspace
from gui.pages.stage_views import StageViews
from gui.widgets.raycast import MeshPicture
from pipelines.takes.take import Take
from studio.gaussians import Gaussians
from tests.support.looping import heard
from tests.support.waiting import wait_until

SIZE = (360, 250)


def test_open3d_draws_where_there_is_a_graphics_card_or_where_it_is_chosen() -> None:
    assert drawn_by_open3d("automatic", software=False)
    assert not drawn_by_open3d("automatic", software=True)
    assert drawn_by_open3d("Open3D", software=True)
    assert not drawn_by_open3d("rasterizer", software=False)


def test_splats_are_handed_over_with_linear_scales_logits_and_at_most_degree_2() -> None:
    scales = torch.tensor([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    sh = torch.arange(2 * 16 * 3, dtype=torch.float32).reshape(2, 16, 3)
    gaussians = Gaussians.from_activated(
        means=torch.tensor([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        quats=torch.tensor([[2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, 4.0]]),
        scales=scales,
        opacities=torch.tensor([0.5, 0.75]),
        sh=sh,
    )
    arrays = splat_arrays(gaussians)
    assert np.allclose(arrays["scale"], scales)
    assert np.allclose(arrays["rot"], [[1, 0, 0, 0], [0, 0, 0.6, 0.8]])
    assert np.allclose(arrays["opacity"], [[0.0], [np.log(3.0)]])
    assert np.array_equal(arrays["f_dc"], sh[:, 0])
    assert np.array_equal(arrays["f_rest"], sh[:, 1:9])
    assert all(array.dtype == np.float32 and array.flags.c_contiguous for array in arrays.values())


@pytest.fixture
def scene(finished_project: Path) -> Iterator[tuple[StageViews, PlayerPresenter]]:
    """The scene of the finished take, for Open3D."""
    workspace, player = Workspace(), PlayerPresenter(read_mesh=MeshPicture)
    views = StageViews(workspace, player, MeshPicture)
    take = finished_project / "take"
    assert player.open(take), player.message
    workspace.open(Take.open(take))
    player.transport.pause()
    player.native = True
    views.choose("scene")
    yield views, player
    assert views.close()
    assert workspace.close()


def shown(views: StageViews, player: PlayerPresenter) -> None:
    """Wait for the scene."""

    def there() -> bool:
        views.poll(SIZE, SIZE, 14.0)
        return player.picture is not None and player.current and views.settled

    wait_until("the scene", there)


def test_a_turned_view_needs_no_new_picture_and_a_click_finds_the_camera(
    scene: tuple[StageViews, PlayerPresenter],
) -> None:
    views, player = scene
    shown(views, player)
    assert player.picture is not None
    assert player.picture.native is not None
    native = player.picture.native
    assert native.gaussians is not None
    assert (player.picture.image == player.picture.image[0, 0]).all()  # only the background
    player.wheel(-6.0)
    shown(views, player)
    view = player.view()
    assert view is not None
    # project the middle of a frustum by hand, from the rig
    found = []
    for camera in native.contents.cameras:
        x, y, depth = view.K @ (view.rotation @ camera.camera.center + view.translation)
        if depth > 0.1 and 0 < x / depth < SIZE[0] and 0 < y / depth < SIZE[1]:
            found.append((depth, camera.camera.name, x / depth, y / depth))
    assert found
    _, name, x, y = min(found)
    clicked = heard(views.camera_clicked)
    views.click(x, y)
    assert clicked == [(name,)]
    player.look_through(name)
    shown(views, player)
    assert player.picture.native is not None
    assert name not in [one.camera.name for one in player.picture.native.contents.cameras]


def test_the_screenshot_is_composed_by_the_rasterizer(scene: tuple[StageViews, PlayerPresenter]) -> None:
    views, player = scene
    shown(views, player)
    composed = player.composed()
    assert player.native
    player.native = False
    shown(views, player)
    assert player.picture is not None
    assert player.picture.native is None
    assert np.array_equal(composed, player.picture.image)
