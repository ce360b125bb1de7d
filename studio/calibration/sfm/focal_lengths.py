"""Focal lengths before mapping: what the pairs of images agree on. Runs inside the worker's process."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

_LEAST, _MOST = 0.7, 1.4
"""A guess counts within these factors of the middle of all."""


def guess_focal_lengths(database: Path, folder: Path, lenses: Sequence[int], seed: int) -> None:
    """Write into the database the focal lengths that the pairs of images agree on, where they do.

    From a guess that is far off, the mapper can close a ring of cameras wrongly.

    Args:
        database: with verified matches.
        folder: for a copy of it that is calibrated in its place.
        lenses: numbers in the database of the lenses of which nothing is known.
        seed: of all that is random.
    """
    import pycolmap

    guessed = folder / "focal_lengths.db"
    shutil.copyfile(database, guessed)
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = seed
    options.reestimate_relative_pose = False
    pycolmap.calibrate_view_graph(guessed, options)
    source, target = pycolmap.Database.open(guessed), pycolmap.Database.open(database)
    found = {key: source.read_camera(key) for key in lenses}
    ratios = {key: focal_ratio(lens) for key, lens in found.items()}
    middle = float(np.median([ratios[key] for key in lenses if found[key].has_prior_focal_length] or [np.nan]))
    for key, lens in found.items():
        if lens.has_prior_focal_length and _LEAST < ratios[key] / middle < _MOST:
            target.update_camera(lens)
    source.close()
    target.close()
    guessed.unlink()


def is_any_unknown(database: Path) -> bool:
    """Whether nothing is known of the focal length of a lens in the database: not given, and not guessed either."""
    import pycolmap

    opened = pycolmap.Database.open(database)
    found = not all(camera.has_prior_focal_length for camera in opened.read_all_cameras())
    opened.close()
    return found


def focal_ratio(camera: Any) -> float:
    """Focal length by the image's longer side."""
    return float(camera.mean_focal_length()) / longer_side(camera)


def longer_side(camera: Any) -> int:
    """Of the image, pixels."""
    return max(int(camera.width), int(camera.height))
