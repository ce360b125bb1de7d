"""Focal lengths from pairs of images, before mapping. Runs in the worker process."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

_LEAST, _MOST = 0.7, 1.4  # an estimate is used if it is within these factors of the median of all


def guess_focal_lengths(database: Path, folder: Path, cameras: Sequence[int], seed: int) -> None:
    """Write focal lengths estimated from fundamental matrices to the database where the estimates are consistent.

    With a poor initial focal length the mapper can close a ring of cameras wrongly.

    Args:
        folder: folder for a temporary copy of it.
        cameras: ids of the cameras with unknown focal length.
    """
    guessed = folder / "focal_lengths.db"
    shutil.copyfile(database, guessed)
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = seed
    options.reestimate_relative_pose = False
    pycolmap.calibrate_view_graph(guessed, options)
    with pycolmap.Database.open(guessed) as source, pycolmap.Database.open(database) as target:
        stored = {key: source.read_camera(key) for key in cameras}
        ratios = {key: focal_ratio(camera) for key, camera in stored.items()}
        middle = float(np.median([ratios[key] for key in cameras if stored[key].has_prior_focal_length] or [np.nan]))
        for key, camera in stored.items():
            if camera.has_prior_focal_length and _LEAST < ratios[key] / middle < _MOST:
                target.update_camera(camera)
    guessed.unlink()


def is_any_unknown(database: Path) -> bool:
    """Return whether any camera in the database has neither a given nor an estimated focal length."""
    with pycolmap.Database.open(database) as opened:
        return not all(camera.has_prior_focal_length for camera in opened.read_all_cameras())


def focal_ratio(camera: Any) -> float:
    """Focal length divided by the longer image side."""
    return float(camera.mean_focal_length()) / longer_side(camera)


def longer_side(camera: Any) -> int:
    """Longer image side in pixels."""
    return max(int(camera.width), int(camera.height))
