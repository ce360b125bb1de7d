"""What a board shows, as geometry instead of as a picture: for drawing by Open3D's scene on a GPU."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gui.presenters.orbit import OrbitCamera

SCENE_CHOICES = ("automatic", "our own", "Open3D")
"""Preference: by whom cameras, meshes and points are drawn; automatic is Open3D on a real GPU, else our own."""


def wants_scene(choice: str, software: bool) -> bool:
    """Whether Open3D's scene draws, by that preference and that device."""
    return choice == "Open3D" or (choice == "automatic" and not software)


@dataclass(frozen=True, eq=False)
class SceneParts:
    """World coordinates; colours 0 to 1.

    Attributes:
        stamp: changes whenever the geometry does.
        home: from where to look at first.
        points, colors: (N, 3) each.
        lines: (M, 2, 3) ends; `line_colors` (M, 3).
        mesh: a PLY file; None for none.
    """

    stamp: Hashable
    home: OrbitCamera
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    colors: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    lines: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3)))
    line_colors: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    mesh: Path | None = None
