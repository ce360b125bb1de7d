"""Quality of a solution. Runs in the worker process."""

from pathlib import Path
from typing import Any

import numpy as np

WEAK = 0.005  # position uncertainty above which a camera is weak: 2 sigma are 1 cm per meter
TRUSTED = 0.6
"""Match inlier ratio above which a solution is accepted: correct ones have 0.75, a wrongly closed ring has 0.45."""
MISPLACED = 0.4  # match inlier ratio of a single camera below which it is registered again, and named if it stays there


def match_inlier_ratio(model: Any, database: Path) -> float:
    """Fraction of the verified matches whose two features observe the same point of the model.

    A small reprojection error is not sufficient: wrongly placed cameras keep the few points that fit, but lose their
    matches with other cameras.

    Returns:
        0 to 1, over all pairs of registered images; 0 if there are none.
    """
    good, total = np.sum([(0, 0), *_matches(model, database).values()], axis=0).tolist()
    return good / total if total else 0.0


def match_inlier_ratios(model: Any, database: Path) -> dict[int, float]:
    """`match_inlier_ratio` of single images, by image id: over the pairs that the image is part of. Images without
    matches are left out."""
    sums: dict[int, np.ndarray] = {}
    for pair, counts in _matches(model, database).items():
        for image in pair:
            sums[image] = sums.get(image, 0) + np.array(counts)
    return {image: good / total for image, (good, total) in sums.items()}


def _matches(model: Any, database: Path) -> dict[tuple[int, int], tuple[int, int]]:
    """Verified matches whose features observe the same point, and all, of each pair of registered images with some."""
    import pycolmap

    seen: dict[int, np.ndarray] = {}
    for image_id in model.reg_image_ids():
        points = model.images[image_id].points2D
        seen[image_id] = np.array([point.point3D_id if point.has_point3D() else -1 for point in points], np.int64)
    by_pair: dict[tuple[int, int], tuple[int, int]] = {}
    with pycolmap.Database.open(database) as source:
        for key in source.read_two_view_geometry_num_inliers()[0]:
            first, second = pycolmap.pair_id_to_image_pair(key)
            if first in seen and second in seen:
                matches = np.asarray(source.read_two_view_geometry(first, second).inlier_matches).reshape(-1, 2)
                ids = seen[first][matches[:, 0]]
                good = int(((ids >= 0) & (ids == seen[second][matches[:, 1]])).sum())
                if len(matches):
                    by_pair[first, second] = good, len(matches)
    return by_pair


def reprojection_errors(model: Any) -> np.ndarray:
    """(N,) reprojection errors of all observations in pixels."""
    errors = []
    for image_id in model.reg_image_ids():
        image = model.images[image_id]
        for feature in image.points2D:
            if feature.has_point3D():
                drawn = image.project_point(model.points3D[feature.point3D_id].xyz)
                if drawn is not None:
                    errors.append(float(np.linalg.norm(drawn - feature.xy)))
    return np.array(errors)


def noise(model: Any) -> float:
    """Standard deviation of the features per axis in pixels, from the median reprojection error (robust)."""
    errors = reprojection_errors(model)
    # the median of a 2D Gaussian error's length is 1.177 sigma; 0.01 is the rounding error
    return max(float(np.median(errors)) / 1.177, 0.01) if len(errors) else 1.0
