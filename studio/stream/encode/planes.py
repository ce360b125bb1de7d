"""Encoder of the profile `planes` (paper, "Baking 3D Gaussians"): one video per component of a splat."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn
from v3studio.studio.stream.attributes import Attribute, attribute_rows, components
from v3studio.studio.stream.encode.files import named_by_content
from v3studio.studio.stream.layout import component_frames, plane_side, scale_floor, to_plane, typical_size
from v3studio.studio.stream.manifest import Box, ComponentEntry, Part, PlaneEntry, PlanesRendition, point
from v3studio.studio.stream.morton import morton_order
from v3studio.studio.stream.quantize import quantize, split_bytes
from v3studio.studio.stream.settings import BakeSettings
from v3studio.studio.stream.video import PlaneEncoder, encoding


class PlanesBake:
    """One group, keyframe first. The constructor reads all frames once for their ranges, each `write` reads them again,
    for any QP.

    The splats of all frames are put into the Morton order of the keyframe, each component is rounded to levels over its
    range in the group, and the planes are encoded in parallel. `progress` is called before each frame, so that it can
    cancel.
    """

    def __init__(self, frames: Sequence[Gaussians], progress: ProgressFn) -> None:
        self._frames = frames
        means = frames[0].means.detach().cpu().numpy()
        self._order = morton_order(means) if np.isfinite(means).all() else np.arange(len(means))
        self._low, self._high = _ranges(component_frames(_reported(frames, progress)))
        rows = attribute_rows("planes", frames[0].sh_degree)
        least, most = self._low[rows["means"]], self._high[rows["means"]]
        self._box = Box(min=point(least), max=point(most))
        extent = float((most - least).max())
        floor = scale_floor(typical_size(frames[0].log_scales.detach().cpu().numpy().T, extent))
        scales = rows["scales"]
        self._low[scales] = np.minimum(np.maximum(self._low[scales], floor), self._high[scales])

    def write(
        self,
        folder: Path,
        identity: Mapping[str, Any],
        settings: BakeSettings,
        progress: ProgressFn,
        threads: int,
        fps: float,
    ) -> PlanesRendition:
        """Write the videos into `folder`, under the names of their content; see `MotionBake.write`."""
        keyframe, low, high = self._frames[0], self._low, self._high
        planes, side = _planes(keyframe.sh_degree, settings), plane_side(len(keyframe))
        encoders: list[PlaneEncoder] = []

        def encode(index: int, frame: np.ndarray) -> None:
            row, attribute, part, _ = planes[index]
            codes = quantize(frame[row], low[row], high[row], (1 << attribute.bits) - 1)
            if part != "all":
                codes = split_bytes(codes, mirrored=part == "low_mirrored")[0 if part == "high" else 1]
            encoders[index].add(to_plane(codes, side))

        with encoding(encoders, threads) as pool:
            for index, (*_, qp) in enumerate(planes):
                encoders.append(PlaneEncoder(folder / f"{index}.mp4", (side, side), qp, settings.preset, fps=fps))
            for number, frame in enumerate(component_frames(self._frames, self._order)):
                list(pool.map(encode, range(len(planes)), repeat(frame)))
                progress(number + 1, len(self._frames))
        entries: dict[int, list[PlaneEntry]] = {}
        for index, (row, _, part, qp) in enumerate(planes):
            facts = dict(named_by_content(folder / f"{index}.mp4"))
            plane = PlaneEntry.model_construct(**facts, qp=qp, part=part, checks=())
            entries.setdefault(row, []).append(plane)
        wanted = components(keyframe.sh_degree)
        return PlanesRendition.model_construct(
            **identity,
            splats=len(keyframe),
            sh_degree=keyframe.sh_degree,
            side=side,
            bounding_box=self._box,
            bytes=sum(plane.bytes for files in entries.values() for plane in files),
            dilation=keyframe.dilation,
            components=tuple(
                ComponentEntry.model_construct(
                    name=wanted[row][0], min=float(low[row]), max=float(high[row]), planes=tuple(files)
                )
                for row, files in entries.items()
            ),
        )


def _reported(frames: Sequence[Gaussians], progress: ProgressFn) -> Iterator[Gaussians]:
    """The frames; `progress` can cancel before each."""
    for frame in frames:
        progress(0, len(frames))
        yield frame


def _ranges(values: Iterator[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Minima and maxima of the components over the group, both (C,) float64."""
    ends = np.array([(frame.min(axis=1), frame.max(axis=1)) for frame in values], np.float64)
    return ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)


def _planes(sh_degree: int, settings: BakeSettings) -> list[tuple[int, Attribute, Part, int]]:
    """(row of the component, its attribute, part, QP) of each file, in the order of the manifest."""
    result: list[tuple[int, Attribute, Part, int]] = []
    for row, (_, attribute) in enumerate(components(sh_degree)):
        if attribute.bits == 16:
            result.append((row, attribute, "high", 0))
            low: Part = "low_mirrored" if settings.mirror_low_bytes else "low"
            result.append((row, attribute, low, settings.attribute_qp(attribute)))
        else:
            result.append((row, attribute, "all", settings.attribute_qp(attribute)))
    return result
