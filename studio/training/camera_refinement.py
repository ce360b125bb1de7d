"""Cameras refined together with the splats of a keyframe: pose, principal point, focal length and one radial term.

A calibration from footage is off by a few pixels at the performer, whose surface has few of the points that it was
made from. The splats see every pixel of the performer. Moving a camera equals moving the splats the other way and
shifting them in the image, so that the rasterizer needs no gradient of the camera.

The splats only determine the cameras up to a similarity, and focal lengths hardly up to a common factor, since all
cameras look at one place: the mean motion and the mean zoom of all cameras are removed at the end.

More freedom always fits the images better, also their noise. Whether refined cameras are better is therefore judged by
blocks of pixels that are hidden from training: what is seen there follows from the other cameras.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.rotations import quats_to_matrices
from v3studio.studio.similarity import Similarity
from v3studio.studio.torch_rotations import quat_multiply, rotate_vectors
from v3studio.studio.training.adam import Adam, ParameterGroup
from v3studio.studio.training.interframe import rate_factor
from v3studio.studio.training.keyframe import initial_gaussians, scene_extent
from v3studio.studio.training.settings import TrainSettings
from v3studio.studio.training.splat_optimizer import SplatOptimizer
from v3studio.studio.training.step import Stepper, regularized
from v3studio.studio.training.views import TrainingView

WORTH = 0.1  # gain in dB from which on refined cameras are used
_VISITS = 75  # steps per camera in which cameras are refined; a third as many with fixed cameras come before
ALIGN_STEPS = 150  # steps that align a camera to finished splats
_RATE = 1e-3  # Adam's, so that a step moves the performer by a thousandth of its size; decays with `rate_factor`
_USUAL = (*[0.03] * 6, 0.02, 0.02, 0.03, 0.03)
"""Usual errors of a calibration: rotation in radians and translation as a fraction of the performer's radius (three
each), principal point as a fraction of the focal length (two), relative focal length, radial term."""
_PRIOR = 1e-4  # Loss of one of them. Without it, what a small performer hardly shows, such as the radial term, drifts.
_LEAST_DISTORTION = 0.1
"""Pixels in the corner of the image from which on the radial term is used: less does not justify resampling."""


@dataclass(frozen=True)
class Correction:
    """The changes that refinement makes to a camera.

    Attributes:
        moved: from the world of the given cameras to the one that the camera sees, before its pose.
        shift: (2,) of the principal point, pixels.
        zoom: relative change of the focal lengths.
        radial: OpenCV's k1 that is added.
    """

    moved: Similarity
    shift: np.ndarray
    zoom: float
    radial: float

    def of(self, camera: Camera, larger: float = 1.0) -> Camera:
        """The refined camera.

        Args:
            camera: the given one, with or without lens distortion, of the whole image.
            larger: its image size as a multiple of that of the training image.
        """
        K, distortion = camera.K.copy(), camera.distortion
        translation = (camera.rotation @ self.moved.translation + camera.translation) / self.moved.scale
        pose = np.column_stack([camera.rotation @ self.moved.rotation, translation])
        K[:2, :2] *= 1 + self.zoom  # and the skew, which is zero
        K[:2, 2] += larger * self.shift
        corner = math.hypot(camera.width / camera.fx, camera.height / camera.fy) / 2
        if abs(self.radial) * corner**3 * camera.fx >= larger * _LEAST_DISTORTION:
            distortion = distortion.copy() if distortion.size else np.zeros(4)
            distortion[0] += self.radial
        return replace(camera, K=K, world_to_camera=pose, distortion=distortion)


@dataclass(frozen=True)
class RefinedCameras:
    """Result of a refinement.

    Attributes:
        corrections: of each training view's camera, in order.
        held_out: of each held-out view's camera, aligned to the finished splats.
        before, after: mean PSNR in dB of pixels of the training views that were hidden from training, after equally
            many steps with the given and with the refined cameras.
        held_out_calibrated: that of the held-out views with the given cameras; None without them.
        held_out_before, held_out_after: the same as `before` and `after` for the held-out views, each of which is
            aligned to the splats; None without them.
    """

    corrections: tuple[Correction, ...]
    held_out: tuple[Correction, ...]
    before: float
    after: float
    held_out_calibrated: float | None = None
    held_out_before: float | None = None
    held_out_after: float | None = None

    @property
    def gain(self) -> float:
        """Gain of the hidden pixels in dB."""
        return self.after - self.before


def refinement_steps(settings: TrainSettings, views: int) -> int:
    """Steps in which cameras are refined: not more than a keyframe has."""
    return min(_VISITS * views, settings.keyframe_iterations)


def warm_up_steps(settings: TrainSettings, views: int) -> int:
    """Steps with fixed cameras before them."""
    return refinement_steps(settings, views) // 3


def all_steps(settings: TrainSettings, views: int, held_out: int) -> int:
    """All that `refine_cameras` does: with fixed and with refined cameras, and the alignment of held-out ones."""
    both = refinement_steps(settings, views) + held_out * ALIGN_STEPS
    return warm_up_steps(settings, views) + 2 * both


def refine_cameras(
    views: Sequence[TrainingView],
    points: Tensor,
    colors: Tensor,
    settings: TrainSettings,
    *,
    held_out: Sequence[TrainingView] = (),
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> RefinedCameras:
    """Train splats twice from the same start, with fixed cameras and with cameras that are refined.

    Args:
        views: training views of a keyframe, one per camera.
        points: (N, 3) initial means, world units.
        colors: (N, 3) RGB of the points, 0 to 1.
        settings: see `TrainSettings`; the splats have one color each, whatever `sh_degree` is.
        held_out: views of cameras that are aligned to the refined splats, which do not see them.
        seed: equal seeds and inputs give equal cameras, bit for bit.
        progress: called with completed and total steps, and regularly also with figures.

    Raises:
        StudioError: as `train_keyframe`.
        Cancelled: raised by `progress`.
    """
    views = [view.with_hidden(number) for number, view in enumerate(views)]
    run = _Run(views, points, colors, settings, seed, progress, len(held_out))
    run.train(run.warm_up, refine=False)
    start = run.state()
    run.train(run.steps, refine=False)
    fixed = run.optimizer.gaussians.clone()
    before = _psnr(fixed, views, run.placements)
    run.restore(start)
    run.train(run.steps, refine=True)
    refined = run.optimizer.gaussians.clone()
    after = _psnr(refined, views, run.placements)
    placed = [run.placement(view) for view in held_out]
    with_fixed = [run.placement(view) for view in held_out]
    calibrated = _psnr(fixed, held_out, with_fixed)
    for view, corrected, other in zip(held_out, placed, with_fixed, strict=True):
        run.align(refined, view, corrected)
        run.align(fixed, view, other)
    corrections = _without_gauge([*run.placements, *placed], len(views))
    return RefinedCameras(
        tuple(corrections[: len(views)]),
        tuple(corrections[len(views) :]),
        before or 0.0,
        after or 0.0,
        calibrated,
        _psnr(fixed, held_out, with_fixed),
        _psnr(refined, held_out, placed),
    )


class _Placement:
    """A camera's correction as parameters of equal effect, about 1 for the size of the performer in the image.

    Args:
        middle: (3,) about which the splats turn, world units.
        radius: of the performer, world units.
    """

    def __init__(self, camera: Camera, middle: Tensor, radius: float) -> None:
        self.camera, self.middle, self.radius = camera, middle, radius
        depth = float((camera.world_to_camera[:3] @ np.append(middle.cpu().double().numpy(), 1))[2])
        self.slope = radius / max(depth, 1e-6)  # of the performer's border, seen from the camera
        units = [1.0] * 6 + [self.slope] * 2 + [1.0, self.slope**-2]
        self._usual = torch.tensor(_USUAL, device=middle.device) / torch.tensor(units, device=middle.device)
        self.values = torch.zeros(10, device=middle.device, requires_grad=True)
        self.adam = Adam([ParameterGroup([self.values], _RATE)], eps=1e-15)

    def __call__(self, gaussians: Gaussians) -> tuple[Gaussians, Tensor]:
        """The moved splats, and their (N, 2) offsets in the image."""
        quat, shift, zoom, radial = self._parts()
        means = rotate_vectors(quat.expand(len(gaussians), 4), gaussians.means - self.middle)
        means = means + self.middle + self.values[3:6] * self.radius
        turned = replace(gaussians, means=means, quats=quat_multiply(quat, gaussians.quats))
        pose = torch.from_numpy(self.camera.world_to_camera[:3]).to(means)
        local = means.detach() @ pose[:, :3].T + pose[:, 3]
        slopes = local[:, :2] / local[:, 2:].clamp_min(1e-6)
        stretch = zoom + radial * (slopes * slopes).sum(1, keepdim=True)
        return turned, shift + slopes * self._focal(means) * stretch

    def prior(self) -> Tensor:
        """The penalty for the distance from the given camera."""
        return _PRIOR * (self.values / self._usual).square().sum()

    def step(self, progress: float) -> None:
        """Take a step with the gradient, if it has one; `progress`: 0 at the first step, 1 after the last."""
        self.adam.groups[0].rate = _RATE * rate_factor(progress)
        self.adam.step()
        self.adam.zero_grad()

    @torch.no_grad()
    def correction(self) -> Correction:
        """The correction so far; it still contains the mean motion of all cameras."""
        quat, shift, zoom, radial = self._parts()
        rotation = quats_to_matrices(quat[0].cpu().double().numpy())
        middle = self.middle.cpu().double().numpy()
        offset = self.values[3:6].cpu().double().numpy() * self.radius
        moved = Similarity(1.0, rotation, middle + offset - rotation @ middle)
        shifted: np.ndarray = shift[0].cpu().double().numpy()
        return Correction(moved, shifted, float(zoom), float(radial) / (1 + float(zoom)))

    def _parts(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """(1, 4) unit quaternion, (1, 2) shift in pixels, zoom, and radial term."""
        values = self.values
        quat = torch.cat([torch.ones_like(values[:1]), values[:3] / 2])
        quat = torch.nn.functional.normalize(quat, dim=0)[None]
        shift = (values[6:8] * self.slope)[None] * self._focal(values)
        return quat, shift, values[8], values[9] / self.slope**2

    def _focal(self, like: Tensor) -> Tensor:
        return torch.tensor([[self.camera.fx, self.camera.fy]]).to(like)


class _Run:
    """Training of the splats, and where they are for each camera."""

    def __init__(
        self,
        views: Sequence[TrainingView],
        points: Tensor,
        colors: Tensor,
        settings: TrainSettings,
        seed: int,
        progress: ProgressFn,
        held_out: int,
    ) -> None:
        self._views, self._settings, self._progress = views, settings, progress
        self._generator = torch.Generator().manual_seed(seed)
        self._stepper = Stepper(views, settings, self._generator)
        self._extent = scene_extent(points)
        self._middle = (points.amax(0) + points.amin(0)).float() / 2
        start = initial_gaussians(points, colors, 0, settings.dilation)
        self.optimizer = SplatOptimizer(start, settings.rates, self._extent)
        self.steps = refinement_steps(settings, len(views))
        self.warm_up = warm_up_steps(settings, len(views))
        self.placements = [self.placement(view) for view in views]
        self._at = 0
        self._done, self._total = 0, all_steps(settings, len(views), held_out)

    def placement(self, view: TrainingView) -> _Placement:
        """The camera of a view as it is given."""
        return _Placement(view.camera, self._middle, self._extent / 2)

    def train(self, steps: int, *, refine: bool) -> None:
        """Train the splats; with `refine`, also the cameras."""
        placed = {id(view): place for view, place in zip(self._views, self.placements, strict=True)}
        for step in range(steps):
            self._at += 1
            self.optimizer.set_means_progress(self._at / (self.warm_up + self.steps))
            gaussians = self.optimizer.gaussians
            self._stepper.moved = (lambda splats, view: placed[id(view)](splats)) if refine else None
            step_loss = self._stepper(gaussians, dropout=True)
            loss = regularized(step_loss.loss, gaussians, self._settings, self._extent)
            loss = loss + placed[id(step_loss.view)].prior() if refine else loss
            loss.backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            if refine:
                placed[id(step_loss.view)].step(step / steps)
            self._done += 1
            self._progress(self._done, self._total, **step_loss.figures(self._done, "camera", len(self.optimizer)))

    def align(self, gaussians: Gaussians, view: TrainingView, place: _Placement) -> None:
        """Align a camera to splats, which stay."""
        stepper = Stepper([view], self._settings, self._generator)
        stepper.moved = lambda splats, view: place(splats)
        for step in range(ALIGN_STEPS):
            (stepper(gaussians).loss + place.prior()).backward()  # type: ignore[no-untyped-call]
            place.step(step / ALIGN_STEPS)
            self._done += 1
            self._progress(self._done, self._total)

    def state(self) -> dict[str, Tensor]:
        """The splats and what is random, copied; cameras are not in it."""
        state = {
            "at": torch.tensor(self._at),
            "generator": self._generator.get_state(),
            **self._stepper.state(),
            **self.optimizer.state(),
        }
        return {name: value.clone() for name, value in state.items()}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`."""
        self._at = int(state["at"])
        self._generator.set_state(state["generator"])
        self._stepper.restore(state)
        self.optimizer.restore(state)


@torch.no_grad()
def _psnr(gaussians: Gaussians, views: Sequence[TrainingView], placements: Sequence[_Placement]) -> float | None:
    """PSNR in dB over black of all views, in their hidden pixels or, if they have none, in their crops; None without
    views."""
    errors = []
    for view, place in zip(views, placements, strict=True):
        black = torch.zeros(3, device=view.device)
        target, behind = view.over(black)
        moved, offsets = place(gaussians)
        render = rasterize(moved, view.camera, behind, screen_offsets=offsets)
        image = view.in_its_colors(render.image, render.alpha, behind)
        off = (image - target).square()
        errors.append(float((off if view.hidden is None else off[view.hidden]).mean()))
    return -10 * math.log10(max(float(np.mean(errors)), 1e-12)) if errors else None


def _without_gauge(placements: Sequence[_Placement], count: int) -> list[Correction]:
    """The corrections without the similarity that fits the motion of the first `count` cameras best, and without their
    mean zoom: where all splats are, and how large, is not for them to decide."""
    first = placements[0]
    middle, radius = first.middle.cpu().double().numpy(), first.radius
    rows, values = [], []
    for place in placements[:count]:
        # a scene that is larger by a fraction looks the same when it is farther away by as much
        away = (middle - place.camera.center) / radius
        turn = np.hstack([np.eye(3), np.zeros((3, 4))])
        move = np.hstack([np.zeros((3, 3)), np.eye(3), -away[:, None]])
        rows.append(np.vstack([turn, move]))
        values.append(place.values[:6].detach().cpu().double().numpy())
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=1e-9)[0]
    length = float(np.linalg.norm(solution[:3])) / 2
    half = np.append(math.cos(length), solution[:3] / 2 * (math.sin(length) / length if length > 0 else 1.0))
    rotation, scale = quats_to_matrices(half), math.exp(float(solution[6]))
    common = Similarity(scale, rotation, middle + solution[3:6] * radius - scale * (rotation @ middle))
    corrections = [place.correction() for place in placements]
    zoom = float(np.mean([correction.zoom for correction in corrections[:count]]))
    return [
        replace(own, moved=own.moved.after(common.inverse), zoom=(1 + own.zoom) / (1 + zoom) - 1) for own in corrections
    ]
