"""The set behind the performer in the views that training sees, and where it contradicts their masks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.take_set import take_set
from v3studio.pipelines.takes.results.stage_files import SetReport
from v3studio.studio.color_fit import correct_color, neutral
from v3studio.studio.comparison.contradictions import doubted
from v3studio.studio.masks.clean_plate import Background
from v3studio.studio.masks.median_background import background_cache
from v3studio.studio.rasterizer import rasterize

if TYPE_CHECKING:
    from v3studio.pipelines.stages.inputs import Inputs
    from v3studio.studio.cameras import FootageView, Rig
    from v3studio.studio.capture.settings import DifferenceSettings
    from v3studio.studio.footage import EmptySets
    from v3studio.studio.gaussians import Gaussians

_OPAQUE = 0.9  # alpha from which splats of the set hide what is behind them


class SeenSets:
    """The set in each camera: its plate, given or estimated, and where that is not reliable, the splats of the set."""

    def __init__(
        self, sets: EmptySets, rig: Rig, settings: DifferenceSettings, scene: Gaussians, colors: Mapping[str, Tensor]
    ) -> None:
        self._sets, self._rig, self._settings = sets, rig, settings
        self._scene, self._colors, self._seen = scene, colors, background_cache()

    @classmethod
    def of(cls, inputs: Inputs, calibrated: bool = False) -> SeenSets | None:
        """The sets of a take, in cameras as `calibrated`, or as splats are trained with; None without splats of the
        set. Raises StudioError: damage."""
        scene = take_set(inputs.take)
        if scene is None:
            return None
        footage = inputs.calibrated_footage if calibrated else inputs.trained_footage
        sets = inputs.calibrated_sets if calibrated else inputs.sets
        colors = read_model(inputs.take.set_report, SetReport).colors
        matrices = {name: torch.tensor(matrix) for name, matrix in colors.items()}
        return cls(sets, footage.rig, inputs.capture, scene, matrices)

    def doubting(self, view: FootageView) -> FootageView:
        """A view with its set as its plate, which says where its mask is doubted."""
        plate = self._seen.get_or_make(view.camera.name, lambda name: Background(self._make(name))).plate
        return replace(view, plate=plate, doubted=doubted(view.image, view.mask, plate, self._settings))

    def _make(self, camera: str) -> np.ndarray:
        own = self._sets.plate(camera)
        if own is not None and own.shape[2] == 3:
            return own
        render = rasterize(self._scene, self._rig[camera], torch.zeros(3))
        image = correct_color(render.image, render.alpha, self._colors.get(camera, neutral())).clamp(0, 1)
        opaque = (render.alpha > _OPAQUE)[..., None]
        drawn = (torch.cat([image, opaque], 2) * 255 + 0.5).to(torch.uint8).numpy()
        return drawn if own is None else np.where(own[..., 3:] > 0, own, drawn)
