import numpy as np
import pytest

from tests.support.rigs import camera_at
from v3studio.gui.drawing.compare import mean_difference
from v3studio.gui.models.playback.frame_renderer import faded
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.studio.calibration.coverage import view_range
from v3studio.studio.cameras import Camera


def camera() -> Camera:
    pose = np.eye(4)
    pose[2, 3] = 3.0
    return Camera("c", 64, 48, np.array([[70.0, 0, 31.0], [0, 70, 25.5], [0, 0, 1]]), pose)


@pytest.mark.parametrize("image_zoom", [ImageZoom(), ImageZoom(0.6, 0.4, 2.5), ImageZoom(0.3, 0.7, 6.0)])
@pytest.mark.parametrize("size", [(64, 48), (300, 200), (40, 90)])
def test_what_is_drawn_and_what_was_filmed_lie_on_each_other(image_zoom: ImageZoom, size: tuple[int, int]) -> None:
    """A spot is drawn where the camera sees a point; the zoomed camera must see it where the picture shows it."""
    point = np.array([[0.1, -0.15, 0.0]])
    seen = camera().project(point)[0][0]
    rows, columns = np.mgrid[0:48, 0:64] + 0.5
    spot = 255 * np.exp(-((columns - seen[0]) ** 2 + (rows - seen[1]) ** 2) / 8)
    image = np.repeat(spot[..., None], 3, axis=2).astype(np.uint8)
    picture = image_zoom.picture(image, camera(), *size)[..., 0].astype(float)
    assert picture.shape == size[::-1]
    expected = image_zoom.camera(camera(), *size).project(point)[0][0]
    if not (8 < expected[0] < size[0] - 8 and 8 < expected[1] < size[1] - 8):
        return  # outside of the visible part
    picture[picture < 40] = 0
    rows, columns = np.mgrid[0 : size[1], 0 : size[0]] + 0.5
    middle = np.array([(columns * picture).sum(), (rows * picture).sum()]) / picture.sum()
    tolerance = 0.35 * max(image_zoom.scale(camera(), *size), 1.0)
    assert middle == pytest.approx(expected, abs=tolerance)


def test_views_from_where_nothing_was_filmed_are_faded() -> None:
    covered = view_range([camera_at("cam0", (3.0, 0.0, 0.0))], (0, 0, 0))
    picture = np.full((60, 200, 3), 200, np.uint8)
    near = faded(picture, covered, camera_at("near", (2.0, 0.5, 0.0)), (0, 0, 1))
    assert (near == picture).all()
    assert (faded(picture, None, camera_at("back", (-2.0, 0.0, 0.0)), (0, 0, 1)) == picture).all()
    back = faded(picture, covered, camera_at("back", (-2.0, 0.0, 0.0)), (0, 0, 1))
    assert back[-1, -1].tolist() == [20, 20, 250], "a tenth of the picture over the background"
    assert len(np.unique(back.reshape(-1, 3), axis=0)) > 2, "and a word"
    assert (picture == 200).all(), "the drawing itself is kept"


def test_the_mean_difference_does_not_depend_on_the_background_in_view() -> None:
    left = np.full((8, 8, 3), 90, np.uint8)
    left[:4] = 100
    right = np.full((8, 8, 3), 90, np.uint8)
    background = (0.08, 0.09, 0.1)
    around = np.round(255 * np.array(background)).astype(np.uint8)
    alone = mean_difference(left, right, background)
    assert alone == 5
    wide = [np.broadcast_to(around, (40, 40, 3)).copy() for _ in range(2)]
    for picture, image in zip(wide, (left, right), strict=True):
        picture[3:11, 5:13] = image
    assert mean_difference(*wide, background) == alone
