"""Colors of cameras from a ColorChecker in the footage: its 24 patches, and a 3x4 matrix per camera.

The reference is the mean of the cameras that see the chart, not the chart's published colors: as with matrices that are
fitted to splats (`studio.training.camera_colors`), only differences between cameras are corrected, and the stream keeps
the colors that were filmed. Published colors only tell which way the chart is held, and whether it is one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.footage.footage import Footage
from v3studio.studio.progress import ProgressFn, no_progress

REFERENCE = np.array(
    [
        (115, 82, 68), (194, 150, 130), (98, 122, 157), (87, 108, 67), (133, 128, 177), (103, 189, 170),
        (214, 126, 44), (80, 91, 166), (193, 90, 99), (94, 60, 108), (157, 188, 64), (224, 163, 46),
        (56, 61, 150), (70, 148, 73), (175, 54, 60), (231, 199, 31), (187, 86, 149), (8, 133, 161),
        (243, 243, 242), (200, 200, 200), (160, 160, 160), (122, 122, 121), (85, 85, 85), (52, 52, 52),
    ]
)  # fmt: skip
"""(24, 3) sRGB, 0 to 255: patches of a ColorChecker Classic by rows, of "RGB coordinates of the Macbeth ColorChecker",
D. Pascale (2006)."""

_LONGEST = 2000  # pixels; larger images are searched at this size
_DARK, _BRIGHT = 3, 250  # beyond, a channel may be clipped, and is no linear function of the light
_MOST_CLIPPED = 8  # patches of one camera
_LEAST_PATCHES = 12
_SMALLEST = 15  # pixels of a patch; charts of 4 by 6 patches of 9 pixels were found in tests, but not reliably
_WRONG = 0.09  # colors 0 to 1; with the patches in another order, the misfit is 0.17 and more


@dataclass(frozen=True, eq=False)
class ChartColors:
    """The patches of a chart as a camera sees them."""

    colors: np.ndarray  # (24, 3) RGB of each patch, 0 to 1, in the order of `REFERENCE`
    clipped: np.ndarray  # (24,) whether a channel of the patch is too dark or too bright to be measured
    corners: np.ndarray  # (24, 4, 2) corners of the middle of each patch, which is measured, in pixels


@dataclass(frozen=True, eq=False)
class ChartFit:
    """Color matrices of cameras that see a chart."""

    frame: int
    # camera to its (3, 4) float64 matrix, from the colors of the mean camera (RGB 0 to 1, and 1) to its own. Their mean
    # changes nothing
    matrices: dict[str, np.ndarray]
    # before, after: camera to the root mean square difference of its patches from those of the mean camera, in levels
    # of 255: as filmed, and after the matrix is applied to the mean camera
    before: dict[str, float]
    after: dict[str, float]
    without: dict[str, StudioError]  # camera to the reason why it has no matrix
    patches: int  # number of patches that were used; those that are clipped in a camera are left out for all


def find_chart(image: np.ndarray) -> ChartColors:
    """Find a ColorChecker Classic (24 patches), maybe upside down, in an (H, W, 3) uint8 RGB image and measure its
    colors. StudioError: `color_chart.not_found`; `color_chart.camera_clipped`: too much of it is clipped; or
    `color_chart.wrong`: there are 24 patches, but not with its colors in its order, as on other charts."""
    if min(image.shape[:2]) < 4 * _SMALLEST or max(image.shape[:2]) < 6 * _SMALLEST:
        raise _not_found()  # the detector takes minutes for images of few rows or columns
    shrink = min(1.0, _LONGEST / max(image.shape[:2]))
    small = image if shrink == 1 else cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    if not detector.process(cv2.cvtColor(small, cv2.COLOR_RGB2BGR), 1):
        raise _not_found()
    # half the width and height of each patch
    corners = np.array(detector.getBestColorChecker().getColorCharts(), np.float64).reshape(24, 4, 2) / shrink
    seen = _measure(image, corners)
    if seen.clipped.sum() > _MOST_CLIPPED:
        problem = f"{seen.clipped.sum()} of the 24 patches are too dark or too bright to be measured"
        fix = "Change the camera's exposure, or choose a frame with other light."
        raise StudioError("color_chart.camera_clipped", problem, value=int(seen.clipped.sum()), fix=fix)
    upside_down = replace(
        seen, colors=seen.colors[::-1], clipped=seen.clipped[::-1], corners=np.roll(seen.corners[::-1], 2, axis=1)
    )
    chart = min((seen, upside_down), key=_misfit)
    misfit = _misfit(chart)
    if misfit > _WRONG:
        problem = (
            f"24 patches are seen, but they are not those of a ColorChecker Classic (off by {255 * misfit:.0f} levels)"
        )
        fix = "Use a ColorChecker Classic that nothing covers."
        raise StudioError("color_chart.wrong", problem, value=round(255 * misfit, 1), fix=fix)
    return chart


def _not_found() -> StudioError:
    fix = f"It needs 24 patches of at least {_SMALLEST} pixels that nothing covers, facing the camera."
    return StudioError("color_chart.not_found", "no ColorChecker is seen", fix=fix)


def _measure(image: np.ndarray, corners: np.ndarray) -> ChartColors:
    """Colors in the middle of the patches."""
    colors = np.zeros((24, 3))
    for number, patch in enumerate(corners):
        low = np.floor(patch.min(0)).astype(int).clip(0)
        high = np.ceil(patch.max(0)).astype(int) + 1
        part = image[low[1] : high[1], low[0] : high[0]]
        inside = np.zeros(part.shape[:2], np.uint8)
        if inside.size:
            cv2.fillConvexPoly(inside, np.round(patch - low).astype(np.int32), 1)
        pixels = part[inside > 0]
        # unlike the median, the mean of the middle half finds fractions of a level
        ordered = np.sort(pixels, axis=0).astype(np.float64)
        middle = ordered[len(ordered) // 4 : len(ordered) - len(ordered) // 4]
        colors[number] = middle.mean(0) / 255 if len(middle) else np.nan
    clipped = np.asarray(~((255 * colors > _DARK) & (255 * colors < _BRIGHT)).all(1))
    return ChartColors(colors, clipped, corners)


def _misfit(seen: ChartColors) -> float:
    """Root mean square distance of the colors from an affine function of the published ones."""
    usable = ~seen.clipped
    base = np.column_stack([REFERENCE[usable] / 255, np.ones(usable.sum())])
    off = base @ np.linalg.lstsq(base, seen.colors[usable], rcond=None)[0] - seen.colors[usable]
    return float(np.sqrt((off**2).mean()))


def fit_chart_colors(
    footage: Footage, frame: int, cameras: Sequence[str], progress: ProgressFn = no_progress
) -> ChartFit:
    """Find the chart in the images of a frame and fit a matrix for each camera that sees it; the mean is taken over
    these.

    Images are read as filmed, in the sRGB values that training compares. `frame` need not be one of `footage.frames`.
    """
    if not any(frame in footage.frames_of(name) for name in cameras):
        first, last = (end(pick(footage.frames_of(name)) for name in cameras) for end, pick in ((min, min), (max, max)))
        problem = f"no camera has frame {frame}; the footage has frames {first} to {last}"
        fix = "Choose a frame in which the cameras see the ColorChecker."
        raise StudioError("color_chart.no_frame", problem, value=frame, fix=fix, setting="train.camera_colors")
    seen: dict[str, ChartColors] = {}
    without: dict[str, StudioError] = {}
    for number, name in enumerate(cameras):
        progress(number, len(cameras))
        try:
            if frame not in footage.frames_of(name):
                problem = f"it has no frame {frame}"
                raise StudioError("color_chart.camera_without_frame", problem, value=frame, camera=name)
            seen[name] = find_chart(footage.raw_image(name, frame))
        except StudioError as error:
            if not error.code.startswith("color_chart."):
                raise
            without[name] = error
    progress(len(cameras), len(cameras))
    if len(seen) < 2:
        problem = (
            f"a ColorChecker can be measured in {len(seen)} of {len(cameras)} cameras in frame {frame}, and it takes "
            f"two to compare; {reasons(without)}"
        )
        fix = "Choose a frame in which several cameras see the ColorChecker, well exposed."
        raise StudioError(
            "color_chart.too_few", problem, value=len(seen), fix=fix, setting="train.camera_colors", frame=frame
        )
    usable = ~np.any([chart.clipped for chart in seen.values()], axis=0)
    if usable.sum() < _LEAST_PATCHES:
        raise StudioError(
            "color_chart.clipped",
            f"only {usable.sum()} of the 24 patches are neither too dark nor too bright in all cameras",
            value=int(usable.sum()),
            fix="Choose another frame, or leave out the cameras that are over- or underexposed.",
            setting="train.camera_colors",
            expected=_LEAST_PATCHES,
            frame=frame,
        )
    colors = {name: chart.colors[usable] for name, chart in seen.items()}
    mean = np.mean(list(colors.values()), axis=0)
    matrices = {name: _matrix(mean, patches) for name, patches in colors.items()}
    base = np.column_stack([mean, np.ones(len(mean))])
    before = {name: _levels(patches - mean) for name, patches in colors.items()}
    after = {name: _levels(patches - base @ matrices[name].T) for name, patches in colors.items()}
    return ChartFit(frame, matrices, before, after, without, int(usable.sum()))


def reasons(without: Mapping[str, StudioError]) -> str:
    """Return why cameras cannot be measured, see `ChartFit.without`, for a sentence."""
    return "; ".join(f"{name}: {error.problem}" for name, error in without.items())


def _matrix(mean: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """(3, 4) least squares solution; linear in `colors`, so that the mean of all cameras gets the neutral matrix."""
    import torch

    from v3studio.studio.color_fit import fit_color

    fitted = fit_color(torch.from_numpy(mean), torch.ones(len(mean)), torch.from_numpy(colors))
    return np.asarray(fitted.numpy())


def _levels(difference: np.ndarray) -> float:
    return float(255 * np.sqrt((difference**2).mean()))
