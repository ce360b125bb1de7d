"""The images that a compositor needs of a frame: its colors with alpha, and where each pixel is, faces and moves.

Colors may be blurred by motion: the mean of several instants while the shutter is open. Between two frames of a group,
whose splats correspond, splats move on straight lines; at the ends of a group they move on as they did.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from v3studio.studio.cameras import Camera
from v3studio.studio.formats.performers import Performers
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.rasterizer import preferred_device, rasterize
from v3studio.studio.rasterizer.deep_samples import DeepSamples, deep_samples
from v3studio.studio.rasterizer.types import Render, mean_depth
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.torch_rotations import align_axes, quats_to_matrices

FAR = 1e10  # depth where there is nothing, as renderers write it


@dataclass(frozen=True)
class Plate:
    """Layers of one frame."""

    rgba: np.ndarray  # (H, W, 4) premultiplied colors in the space that was asked for, and alpha
    depth: np.ndarray  # (H, W) mean distance along the viewing axis; `FAR` where nothing is drawn
    position: np.ndarray  # (H, W, 3) place in the world at that depth; 0 where nothing is drawn
    normal: np.ndarray  # (H, W, 3) unit vector in the world, toward the camera; 0 where nothing is drawn
    forward: np.ndarray  # (H, W, 2) pixels to the right and up from this frame to the next; 0 where nothing is drawn
    mattes: np.ndarray  # (H, W, performers) their shares of alpha
    # samples in the same color space and units, without motion blur; None unless they are asked for
    deep: DeepSamples | None = None


@dataclass(frozen=True)
class Shutter:
    """The time in which the colors of a frame are recorded: degrees (0 to 360; 0: an instant) for which the shutter is
    open around the time of the frame, and the number of instants whose mean is taken, at least 1."""

    angle: float = 0.0
    samples: int = 1

    @property
    def times(self) -> list[float]:
        """The instants, in frames after the frame."""
        if self.angle == 0:
            return [0.0]
        return [((index + 0.5) / self.samples - 0.5) * self.angle / 360 for index in range(self.samples)]


class Plates:
    """Renders the plates of a video.

    Args:
        camera: returns the camera at an index of a frame, also between two of them, in the world of the splats.
        world: from the world of the splats to that of the plates.
        linear: from (H, W, 4) premultiplied sRGB to the color space of the plates.
        shutter: of the colors; the other layers show the frame itself.
        performers: number of the performers who get mattes, from left to right in the first frame; they must not touch
            in the first frame of a group. 0: no mattes.
        deep: most deep samples of a pixel; 0: none.
    """

    def __init__(
        self,
        video: SplatVideo,
        camera: Callable[[float], Camera],
        world: Similarity,
        linear: Callable[[np.ndarray], np.ndarray],
        shutter: Shutter,
        performers: int = 0,
        deep: int = 0,
    ) -> None:
        self._video, self._camera, self._world = video, camera, world
        self._linear, self._shutter = linear, shutter
        self._device = preferred_device()
        self._read: dict[int, Gaussians] = {}
        self._groups = {index: group for group in video.groups for index in group}
        self._performers = Performers(performers)
        self._deep = deep

    @torch.no_grad()
    def render(self, index: int) -> Plate:
        """The plate of a frame; mattes need their order. StudioError: unreadable, or `exr.performers` (they touch)."""
        camera = self._camera(index)
        splats = self._frame(index)
        rendered = rasterize(splats, camera)
        colors = [
            self._colors(rendered if time == 0 else rasterize(self._at(index, time), self._camera(index + time)))
            for time in self._shutter.times
        ]
        drawn = rendered.alpha.cpu().numpy() > 0
        depth = rendered.depth.cpu().numpy()
        shape = (*depth.shape, 3)
        columns, rows = np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0]) + 0.5)
        places = camera.unproject(np.stack([columns, rows], -1).reshape(-1, 2), depth.reshape(-1)).reshape(shape)
        facing = _mean_features(splats, camera, _normals(splats, camera)).cpu().numpy()
        moving = _mean_features(splats, camera, self._motion(index, splats)).cpu().numpy()[..., :2]
        length = np.linalg.norm(facing, axis=-1, keepdims=True)
        return Plate(
            rgba=np.mean(colors, axis=0),
            depth=np.where(drawn, depth * self._world.scale, FAR),
            position=np.where(drawn[..., None], self._world.points(places), 0),
            normal=self._world.directions(facing / np.maximum(length, 1e-12)),
            forward=moving,
            mattes=self._mattes(index, splats, camera) * rendered.alpha[..., None].cpu().numpy(),
            deep=self._samples(splats, camera, rendered) if self._deep else None,
        )

    def _colors(self, rendered: Render) -> np.ndarray:
        return self._linear(torch.cat([rendered.image, rendered.alpha[..., None]], -1).cpu().numpy())

    def _samples(self, splats: Gaussians, camera: Camera, rendered: Render) -> DeepSamples:
        samples = deep_samples(splats, camera, rendered, self._deep, self._linear)
        samples.values[:, 4] *= self._world.scale
        return samples

    def _mattes(self, index: int, splats: Gaussians, camera: Camera) -> np.ndarray:
        """(H, W, performers) share that each performer's splats have in each pixel."""
        performers = self._performers
        if performers.count and index == self._groups[index].start:
            before = self._frame(index - 1) if index > 0 else None
            performers.enter(splats, before, self._video.number(index), camera.rotation[0])
        if not performers.count:
            return np.zeros((camera.height, camera.width, 0), np.float32)
        marks = torch.nn.functional.one_hot(torch.as_tensor(performers.labels), performers.count)
        marks = torch.nn.functional.pad(marks, (0, -performers.count % 3)).to(splats.means)
        shares = [_mean_features(splats, camera, three) for three in marks.split(3, dim=1)]
        return torch.cat(shares, -1)[..., : performers.count].cpu().numpy()

    def _frame(self, index: int) -> Gaussians:
        if index not in self._read:
            self._read = {at: splats for at, splats in self._read.items() if abs(at - index) <= 1}
            self._read[index] = self._video.read(index).to(self._device)
        return self._read[index]

    def _at(self, index: int, time: float) -> Gaussians:
        """The splats `time` frames after a frame, from -0.5 to 1."""
        group = self._groups[index]
        step = 1 if (time > 0 and index + 1 in group) or index - 1 not in group else -1
        if time == 0 or index + step not in group:
            return self._frame(index)
        return _between(self._frame(index), self._frame(index + step), time * step)

    def _motion(self, index: int, splats: Gaussians) -> torch.Tensor:
        """(N, 3) pixels to the right and up to the next frame, and 0."""
        here, _ = self._camera(index).project(splats.means.cpu().numpy())
        there, depths = self._camera(index + 1).project(self._at(index, 1.0).means.cpu().numpy())
        moved = np.where((depths > 0)[:, None], (there - here) * [1, -1], 0)
        moved = np.nan_to_num(np.column_stack([moved, np.zeros(len(moved))]), posinf=0, neginf=0)
        return torch.from_numpy(moved).to(splats.means)


def _between(first: Gaussians, second: Gaussians, share: float) -> Gaussians:
    """Splats on the straight line from one frame to another; `share` may be below 0."""
    first = replace(first, quats=first.unit_quats)
    quats, log_scales = align_axes(second.unit_quats, second.log_scales, first.quats)
    ends = dict(replace(second, quats=quats, log_scales=log_scales).items())
    mixed = {name: torch.lerp(tensor, ends[name], share) for name, tensor in first.items()}
    return Gaussians(**mixed, dilation=first.dilation)


def _normals(splats: Gaussians, camera: Camera) -> torch.Tensor:
    """(N, 3) the thinnest direction of each splat, toward the camera."""
    axes = quats_to_matrices(splats.unit_quats)
    thinnest = splats.log_scales.argmin(-1)
    normals = axes[torch.arange(len(axes), device=axes.device), :, thinnest]
    toward = torch.as_tensor(camera.center).to(splats.means) - splats.means
    flipped = torch.where((normals * toward).sum(-1, keepdim=True) < 0, -normals, normals)
    return torch.nan_to_num(flipped)


@torch.no_grad()
def _mean_features(gaussians: Gaussians, camera: Camera, features: torch.Tensor) -> torch.Tensor:
    """(H, W, 3) float32: features (N, 3) of the splats that a pixel shows, by blending weight; 0 for none."""
    if not len(gaussians):
        return torch.zeros(camera.height, camera.width, 3)
    low = features.amin(0)
    extent = (features.amax(0) - low).clamp_min(1e-12)
    # the rasterizer blends colors: 0.5 + SH_C0 * sh, not below 0
    colors = ((features - low) / extent - 0.5) / SH_C0
    rendered = rasterize(replace(gaussians, sh=colors[:, None].to(gaussians.means)), camera)
    shares = torch.stack([mean_depth(feature, rendered.alpha) for feature in rendered.image.unbind(-1)], -1)
    return torch.where(rendered.alpha[..., None] > 0, low + extent * shares, 0.0)
