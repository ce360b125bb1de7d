"""Colors of cameras from a chart, drawn in perspective with known color matrices and noise."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.color_charts import HEIGHT, WIDTH, flat_chart, matrices, view_of_chart, write_charts
from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.color_fit import neutral
from v3studio.studio.footage import Footage, open_footage
from v3studio.studio.footage.color_chart import REFERENCE, find_chart, fit_chart_colors

NEUTRAL = np.eye(3, 4)
WALL = np.full((HEIGHT, WIDTH, 3), 140, np.uint8)
COLORS = np.array([[0.2, 0.5, 0.8, 1.0], [0.8, 0.4, 0.2, 1.0], [0.5, 0.5, 0.5, 1.0], [0.3, 0.7, 0.3, 1.0]]).T


def footage_of(folder: Path, **views: np.ndarray | list[np.ndarray]) -> Footage:
    write_charts(folder, views)
    return open_footage(CaptureSettings(root=folder, masks="none"), strict=False)


@pytest.mark.parametrize("turned", [False, True])
def test_patches_are_measured_in_the_order_of_the_chart(turned: bool) -> None:
    chart = find_chart(view_of_chart(NEUTRAL, seed=4, turned=turned))
    assert not chart.clipped[18:].any()
    assert np.abs(255 * chart.colors - REFERENCE).max() < 1.5
    # brown is the first patch: at the upper left of a chart that is not turned
    first, last = chart.corners[0].mean(0), chart.corners[-1].mean(0)
    assert (first < last).all() != turned


@pytest.mark.parametrize("noise", [0.0, 2.0, 6.0])
def test_the_matrices_of_cameras_are_recovered(tmp_path: Path, noise: float) -> None:
    truth = matrices(5)
    views = {f"cam{number}": view_of_chart(matrix, number, noise=noise) for number, matrix in enumerate(truth)}
    fit = fit_chart_colors(footage_of(tmp_path, **views), 0, list(views))
    assert not fit.without
    fitted = np.stack([fit.matrices[name] for name in views])
    assert np.allclose(fitted.mean(0), neutral().numpy(), atol=1e-9), "the mean camera is neutral"
    off = np.abs(fitted @ COLORS - truth @ COLORS).max()
    assert off < 0.006 < 0.04 < np.abs((truth - NEUTRAL) @ COLORS).max()
    assert max(fit.after.values()) < 1.0
    assert min(fit.before.values()) > 2.0


def test_cameras_without_a_chart_and_with_a_wrong_one_are_named(tmp_path: Path) -> None:
    truth = matrices(3)
    shuffled = flat_chart(REFERENCE[np.random.default_rng(0).permutation(24)])
    bright = np.column_stack([2.2 * np.eye(3), np.zeros(3)])
    views = {
        "a": view_of_chart(truth[0], 1),
        "b": view_of_chart(truth[1], 2, turned=True),
        "c": view_of_chart(truth[2], 3),
        "wall": WALL,
        "wrong": view_of_chart(NEUTRAL, 5, chart=shuffled),
        "bright": view_of_chart(bright, 7),
    }
    fit = fit_chart_colors(footage_of(tmp_path, **views), 0, list(views))
    assert set(fit.matrices) == {"a", "b", "c"}
    codes = {name: error.code.removeprefix("color_chart.") for name, error in fit.without.items()}
    assert codes == {"wall": "not_found", "wrong": "wrong", "bright": "camera_clipped"}
    fitted = np.stack([fit.matrices[name] for name in "abc"])
    assert np.abs(fitted @ COLORS - truth @ COLORS).max() < 0.006


def test_what_cannot_be_fitted_is_refused(tmp_path: Path) -> None:
    chart = view_of_chart(NEUTRAL, 1)
    footage = footage_of(tmp_path, a=[WALL, chart], b=[WALL, WALL], c=[WALL, chart, chart])
    with refuses("color_chart.no_frame", value=7, setting="train.camera_colors"):
        fit_chart_colors(footage, 7, "abc")
    with refuses("color_chart.too_few", value=0):
        fit_chart_colors(footage, 0, "abc")
    with refuses("color_chart.too_few", value=1):
        fit_chart_colors(footage, 2, "abc")
    fit = fit_chart_colors(footage, 1, "abc")
    assert set(fit.matrices) == {"a", "c"}
