"""Lines, points and images as pixels with depths, against the camera's own projection and against ray casting."""

import numpy as np

from v3studio.gui.models.scene.contents import Lines
from v3studio.gui.models.scene.fragments import image_on_quad, line_fragments, point_fragments
from v3studio.studio.cameras import Camera

K = np.array([[100.0, 0, 60], [0, 110.0, 40], [0, 0, 1]])


def camera(seed: int = 1) -> Camera:
    """120 x 80 pixels, a few units in front of the origin, tilted."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(np.eye(3) + 0.2 * rng.standard_normal((3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = q * np.sign(np.linalg.det(q))
    pose[:3, 3] = (0, 0, 4)
    return Camera("view", 120, 80, K, pose)


def test_a_lines_pixels_lie_on_it_at_its_depth() -> None:
    view = camera()
    ends = np.array([[[-0.9, -0.3, -0.8], [0.8, 0.4, 0.7]], [[0.1, -0.5, 0.6], [-0.1, 0.5, -0.6]]])
    for line in ends:
        drawn = line_fragments(view, Lines.of([line], (9, 8, 7), 2.0))
        strong = drawn[drawn["cover"] > 0.6]
        assert len(strong) > 40
        places = np.column_stack([strong["pixel"] % 120, strong["pixel"] // 120]) + 0.5
        # points along the line, densely: the nearest one to each pixel
        along = line[0] + np.linspace(0, 1, 4001)[:, None] * (line[1] - line[0])
        pixels, depth = view.project(along)
        apart = np.linalg.norm(places[:, None] - pixels[None], axis=2)
        assert apart.min(axis=1).max() < 1.0
        assert np.abs(depth[apart.argmin(axis=1)] / strong["depth"] - 1).max() < 0.01
        # as much ink as a band of that width
        length = np.linalg.norm(pixels[-1] - pixels[0])
        assert abs(drawn["cover"].sum() / (2.0 * length) - 1) < 0.06
        assert (drawn["color"] == (9, 8, 7)).all()


def test_a_pixel_has_the_nearest_of_the_points_on_it() -> None:
    view, rng = camera(2), np.random.default_rng(3)
    points, colors = rng.normal(size=(3000, 3)), rng.integers(0, 256, (3000, 3)).astype(np.uint8)
    drawn = point_fragments(view, points, colors, 2)
    pixels, depth = view.project(points)
    expected: dict[int, tuple[float, list[int]]] = {}
    for (x, y), away, color in zip(np.floor(pixels).astype(int), depth, colors.tolist(), strict=True):
        for column in range(max(x - 1, 0), min(x + 2, 120)):
            for row in range(max(y - 1, 0), min(y + 2, 80)) if away > 0 else ():
                expected[row * 120 + column] = min(expected.get(row * 120 + column, (np.inf, [])), (away, color))
    assert {fragment["pixel"]: (fragment["depth"], fragment["color"].tolist()) for fragment in drawn} == expected
    assert len(drawn) == len(expected)


def test_an_image_on_a_quad_has_the_depth_of_its_plane() -> None:
    view = camera(4)
    corners = np.array([[-0.6, -0.4, 0.5], [0.6, -0.4, -0.5], [0.6, 0.4, -0.5], [-0.6, 0.4, 0.5]])
    image = np.zeros((20, 30, 3), np.uint8)
    image[:, :15] = (200, 0, 0)
    patch = image_on_quad(view, corners, image)
    where = patch.where
    rows, columns = np.nonzero(where)
    corner = np.array([patch.columns.start, patch.rows.start])
    at = np.column_stack([columns, rows]) + corner + 0.5
    places = view.unproject(at, patch.depth[where].astype(np.float64))
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal /= np.linalg.norm(normal)
    assert np.abs((places - corners[0]) @ normal).max() < 1e-4
    # the left half of the image is the half next to the first corner
    left = (places - corners[0]) @ (corners[1] - corners[0]) / np.sum((corners[1] - corners[0]) ** 2)
    red = patch.pixels[where][:, 0]
    assert (red[left < 0.45] == 200).all()
    assert (red[left > 0.55] == 0).all()
    behind = corners - 20 * view.forward
    assert image_on_quad(view, behind, image) is None
