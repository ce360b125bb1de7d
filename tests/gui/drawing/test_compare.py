"""Pictures compared: wipe, side by side, heat map; and the visible part of a camera's image."""

import itertools

import numpy as np
import pytest

from gui.drawing import compare
from gui.drawing.palette import ACCENT, GROUND
from gui.models.playback.frame_renderer import faded
from gui.models.playback.image_zoom import ImageZoom
from studio.cameras import Camera
from studio.coverage import view_range
from tests.support.rigs import camera_at


def plain(value: int, width: int = 80, height: int = 60) -> np.ndarray:
    return np.full((height, width, 3), value, np.uint8)


@pytest.mark.parametrize("at", [0.0, 0.25, 0.5, 1.0])
def test_wipe_shows_one_picture_left_and_the_other_right_of_its_line(at: float) -> None:
    box = compare.boxes((80, 60), 1, 1.0)[0]
    picture = compare.wipe((80, 60), box, plain(50), plain(200), at, ("footage", "decoded"))
    row = picture[58, :, 0]  # below the labels and the line's handle
    line = round(at * 80)
    away = np.abs(np.arange(80) - line) > 1
    assert (row[(np.arange(80) < line) & away] == 50).all()
    assert (row[(np.arange(80) >= line) & away] == 200).all()
    if 0 < line < 80:
        assert tuple(picture[58, line]) == ACCENT


@pytest.mark.parametrize(
    ("count", "shape", "rows"), [(2, 1.0, 1), (3, 0.4, 1), (4, 0.4, 1), (4, 16 / 9, 2), (3, 3.0, 3), (1, 0.2, 1)]
)
def test_boxes_are_equal_do_not_overlap_and_are_arranged_for_what_they_show(
    count: int, shape: float, rows: int
) -> None:
    boxes = compare.boxes((720, 400), count, shape)
    assert len({(box.width, box.height) for box in boxes}) == 1
    assert len({box.y for box in boxes}) == rows
    for one, other in itertools.combinations(boxes, 2):
        assert one.x + one.width < other.x or one.y + one.height < other.y
    assert max(box.x + box.width for box in boxes) <= 720
    assert max(box.y + box.height for box in boxes) <= 400


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
    picture = image_zoom.picture(np.repeat(spot[..., None], 3, axis=2).astype(np.uint8), camera(), *size)[
        ..., 0
    ].astype(float)
    assert picture.shape == size[::-1]
    expected = image_zoom.camera(camera(), *size).project(point)[0][0]
    if not (8 < expected[0] < size[0] - 8 and 8 < expected[1] < size[1] - 8):
        return  # outside of the visible part
    picture[picture < 40] = 0
    rows, columns = np.mgrid[0 : size[1], 0 : size[0]] + 0.5
    middle = np.array([(columns * picture).sum(), (rows * picture).sum()]) / picture.sum()
    tolerance = 0.35 * max(image_zoom.scale(camera(), *size), 1.0)
    assert middle == pytest.approx(expected, abs=tolerance)


def test_outside_of_the_image_nothing_is_shown() -> None:
    picture = plain(99, 100, 48)
    ImageZoom().mask_outside(picture, camera())  # the image is 64 wide, in the middle
    assert (picture[:, :18] == GROUND).all()
    assert (picture[:, 82:] == GROUND).all()
    assert (picture[:, 18:82] == 99).all()


def test_what_is_thin_is_not_cut_and_what_floats_is_ignored() -> None:
    generator = np.random.default_rng(0)
    body = generator.uniform([-0.1, -0.2, -0.1], [0.1, 0.2, 0.1], (4000, 3))
    handle = np.linspace([0.1, 0.0, 0.0], [0.17, 0.0, 0.0], 12)  # 0.3 % of the points, beyond the body's margin
    plain, held, floats = (
        ImageZoom.around(np.concatenate(parts), camera(), 100, 200)
        for parts in ((body,), (body, handle), (body, handle, [[1.5, 0.0, 0.0]]))
    )
    tip = np.array([[0.17, 0.0, 0.0]])
    ends = [float(zoom.camera(camera(), 100, 200).project(tip)[0][0, 0]) for zoom in (plain, held, floats)]
    assert ends[0] > 100, "it would be cut"
    assert ends[1] < 98
    assert floats.zoom == pytest.approx(held.zoom, rel=0.01), "one splat in 4,000 does not zoom out"


def test_views_from_where_nothing_was_filmed_are_faded():
    covered = view_range([camera_at("cam0", (3.0, 0.0, 0.0))], (0, 0, 0))
    picture = np.full((60, 200, 3), 200, np.uint8)
    near = faded(picture, covered, camera_at("near", (2.0, 0.5, 0.0)), (0, 0, 1))
    assert (near == picture).all()
    assert (faded(picture, None, camera_at("back", (-2.0, 0.0, 0.0)), (0, 0, 1)) == picture).all()
    back = faded(picture, covered, camera_at("back", (-2.0, 0.0, 0.0)), (0, 0, 1))
    assert back[-1, -1].tolist() == [20, 20, 250], "a tenth of the picture over the background"
    assert len(np.unique(back.reshape(-1, 3), axis=0)) > 2, "and a word"
    assert (picture == 200).all(), "the drawing itself is kept"
