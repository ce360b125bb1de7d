"""The adjustment of cameras and points marked by hand: few unknowns, measured places, robust against wrong marks.

SciPy's least squares and not COLMAP's bundle adjustment, which knows no places that were measured to a centimeter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studio.calibration.manual.bootstrap import Observations, TieRig

_FOCAL, _RADIAL = 0.5, 0.1
"""How far focal lengths (their logarithm) and k1 may be from the start, in standard deviations: a few points cannot
tell them, and then they should stay."""
_LOSS = 2.0
"""In standard deviations: beyond it an error counts linearly (soft L1)."""


@dataclass(frozen=True)
class Accuracy:
    """Standard deviations of what is given.

    Attributes:
        mark: of a mark in pixels.
        world: of a measured place in meters.
    """

    mark: float
    world: float


def adjust(
    rig: TieRig,
    observations: Observations,
    groups: Sequence[Sequence[str]],
    accuracy: Accuracy,
    *,
    radial: bool = True,
    steps: int = 200,
) -> TieRig:
    """Cameras and points so that all errors, in their standard deviations, are least.

    Args:
        rig: where to start.
        observations: the marks.
        groups: cameras whose lens is not known, those that have one in common together; all others keep theirs.
        accuracy: of marks and measured places.
        radial: estimate the lenses' first radial term too.
        steps: at most.
    """
    from scipy.optimize import least_squares

    problem = Problem(rig, observations, groups, accuracy, radial)
    solution = least_squares(
        problem.residuals,
        problem.start(),
        jac=problem.jacobian,  # type: ignore[arg-type]
        loss="soft_l1",
        f_scale=_LOSS,
        x_scale="jac",
        ftol=1e-9,
        max_nfev=steps,
    )
    return problem.rig(solution.x)


class Problem:
    """The unknowns as one vector: 6 a camera, 1 or 2 a group of lenses, 3 a point.

    A camera's are the rotation vector and the translation to it; a lens's the logarithm of its focal length's factor,
    and its first radial term.
    """

    def __init__(
        self, rig: TieRig, observations: Observations, groups: Sequence[Sequence[str]], accuracy: Accuracy, radial: bool
    ) -> None:
        self.begun, self.accuracy = rig, accuracy
        self.names = list(rig.cameras)
        self.terms = 2 if radial else 1
        used = [[name for name in group if name in rig.cameras] for group in groups]
        self.groups = [group for group in used if group]
        self.group_of = {name: number for number, group in enumerate(self.groups) for name in group}
        self.placed = np.flatnonzero(rig.placed)
        self.columns = {name: np.flatnonzero(observations.seen(name)[self.placed]) for name in self.names}
        self.pixels = {name: observations.pixels[name][self.placed][self.columns[name]] for name in self.names}
        self.measured = np.flatnonzero(observations.measured[self.placed])
        self.world = observations.world[self.placed][self.measured]
        self.first_lens = 6 * len(self.names)
        self.first_point = self.first_lens + self.terms * len(self.groups)

    def start(self) -> np.ndarray:
        """(U,) unknowns at the beginning."""
        from scipy.spatial.transform import Rotation

        values = np.zeros(self.first_point + 3 * len(self.placed))
        for number, name in enumerate(self.names):
            camera = self.begun.cameras[name]
            values[6 * number : 6 * number + 3] = Rotation.from_matrix(camera.rotation).as_rotvec()
            values[6 * number + 3 : 6 * number + 6] = camera.translation
        if self.terms == 2:
            for number, group in enumerate(self.groups):
                camera = self.begun.cameras[group[0]]
                values[self.first_lens + 2 * number + 1] = camera.distortion[0] if camera.distortion.size else 0.0
        values[self.first_point :] = self.begun.places[self.placed].ravel()
        return values

    def _lens(self, values: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """K (3, 3) and the distortion, at least 4 terms."""
        camera = self.begun.cameras[name]
        K, distortion = camera.K.copy(), camera.distortion if camera.distortion.size else np.zeros(4)
        if name in self.group_of:
            own = values[self.first_lens + self.terms * self.group_of[name] :][: self.terms]
            K[0, 0], K[1, 1] = K[0, 0] * np.exp(own[0]), K[1, 1] * np.exp(own[0])
            if self.terms == 2:
                distortion = np.array([own[1], 0.0, 0.0, 0.0])
        return K, distortion

    def rig(self, values: np.ndarray) -> TieRig:
        """What the unknowns mean."""
        from scipy.spatial.transform import Rotation

        cameras = {}
        for number, name in enumerate(self.names):
            own = values[6 * number : 6 * number + 6]
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(own[:3]).as_matrix(), own[3:]
            K, distortion = self._lens(values, name)
            distortion = distortion if distortion.any() else np.zeros(0)
            cameras[name] = replace(self.begun.cameras[name], world_to_camera=pose, K=K, distortion=distortion)
        places = np.full_like(self.begun.places, np.nan)
        places[self.placed] = values[self.first_point :].reshape(-1, 3)
        return TieRig(cameras, places)

    def _project(self, values: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) of what a camera sees, and their derivatives (2N, 10 + distortion) as OpenCV gives them."""
        import cv2

        own = values[6 * self.names.index(name) :][:6]
        K, distortion = self._lens(values, name)
        places = values[self.first_point :].reshape(-1, 3)[self.columns[name]]
        pixels, derivatives = cv2.projectPoints(places, own[:3], own[3:], K, distortion)
        return pixels.reshape(-1, 2), derivatives

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """(R,) errors in standard deviations: marks, measured places, lenses."""
        places = values[self.first_point :].reshape(-1, 3)
        marks = [
            ((self._project(values, name)[0] - self.pixels[name]) / self.accuracy.mark).ravel()
            for name in self.names
            if len(self.columns[name])
        ]
        lens = values[self.first_lens : self.first_point].reshape(len(self.groups), self.terms)
        return np.concatenate(
            [
                *marks,
                ((places[self.measured] - self.world) / self.accuracy.world).ravel(),
                (lens / np.array([_FOCAL, _RADIAL])[: self.terms]).ravel(),
            ]
        )

    def jacobian(self, values: np.ndarray) -> np.ndarray:
        """(R, U) derivatives of the residuals."""
        import cv2

        blocks = []
        for number, name in enumerate(self.names):
            columns = self.columns[name]
            if not len(columns):
                continue
            _, derivatives = self._project(values, name)
            derivatives = derivatives / self.accuracy.mark
            block = np.zeros((2 * len(columns), len(values)))
            block[:, 6 * number : 6 * number + 6] = derivatives[:, :6]
            if name in self.group_of:
                K, _ = self._lens(values, name)
                at = self.first_lens + self.terms * self.group_of[name]
                block[:, at] = derivatives[:, 6] * K[0, 0] + derivatives[:, 7] * K[1, 1]
                if self.terms == 2:
                    block[:, at + 1] = derivatives[:, 10]
            turned = derivatives[:, 3:6] @ cv2.Rodrigues(values[6 * number : 6 * number + 3])[0]
            rows = np.arange(2 * len(columns))
            for axis in range(3):
                block[rows, self.first_point + 3 * np.repeat(columns, 2) + axis] = turned[:, axis]
            blocks.append(block)
        places = np.zeros((3 * len(self.measured), len(values)))
        columns = (self.first_point + 3 * self.measured[:, None] + np.arange(3)).ravel()
        places[np.arange(len(columns)), columns] = 1 / self.accuracy.world
        lens = np.zeros((self.first_point - self.first_lens, len(values)))
        lens[:, self.first_lens : self.first_point] = np.diag(
            np.tile(1 / np.array([_FOCAL, _RADIAL])[: self.terms], len(self.groups))
        )
        return np.concatenate([*blocks, places, lens])
