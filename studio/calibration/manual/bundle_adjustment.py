"""Robust bundle adjustment of cameras and tie points, with measured positions.

Uses SciPy's least squares, because COLMAP's bundle adjustment has no priors on point positions.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from v3studio.studio.calibration.manual.bootstrap import TieRig

_FOCAL, _RADIAL = 0.5, 0.1
"""Standard deviations of the priors on k1 and on changes of log focal length; a few points do not determine either."""
_LOSS = 2.0  # width of the soft L1 loss in standard deviations

MARK, WORLD = 1.0, 0.01
"""Standard deviations of the input, of marks in pixels and of measured positions in meters: marks are set by hand to
about a pixel; positions are measured with a tape measure to about a centimeter."""


def adjust(rig: TieRig, groups: Sequence[Sequence[str]], *, radial: bool, steps: int = 200) -> TieRig:
    """The rig after bundle adjustment. `groups`: cameras with shared unknown intrinsics; others keep theirs."""
    from scipy.optimize import least_squares

    problem = Problem(rig, groups, radial)
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
    """The least-squares problem. Its unknowns are one vector: 6 per camera, 1 or 2 per intrinsics group, 3 per point.

    Each camera has a world-to-camera rotation vector and translation; each group has the logarithm of the focal length
    relative to its initial value and, if estimated, the first radial distortion term.
    """

    def __init__(self, rig: TieRig, groups: Sequence[Sequence[str]], radial: bool) -> None:
        self.initial, observations = rig, rig.observations
        self.names = list(rig.cameras)
        self.terms = 2 if radial else 1
        used = [[name for name in group if name in rig.cameras] for group in groups]
        self.groups = [group for group in used if group]
        self.group_of = {name: number for number, group in enumerate(self.groups) for name in group}
        self.triangulated = np.flatnonzero(rig.triangulated)
        self.columns = {name: np.flatnonzero(observations.seen(name)[self.triangulated]) for name in self.names}
        self.pixels = {name: observations.pixels[name][self.triangulated][self.columns[name]] for name in self.names}
        self.measured = np.flatnonzero(observations.measured[self.triangulated])
        self.world = observations.world[self.triangulated][self.measured]
        self.first_intrinsics = 6 * len(self.names)
        self.first_point = self.first_intrinsics + self.terms * len(self.groups)

    def start(self) -> np.ndarray:
        """(U,) initial values of the unknowns."""
        from scipy.spatial.transform import Rotation

        parameters = np.zeros(self.first_point + 3 * len(self.triangulated))
        for number, name in enumerate(self.names):
            camera = self.initial.cameras[name]
            parameters[6 * number : 6 * number + 3] = Rotation.from_matrix(camera.rotation).as_rotvec()
            parameters[6 * number + 3 : 6 * number + 6] = camera.translation
        if self.terms == 2:
            for number, group in enumerate(self.groups):
                camera = self.initial.cameras[group[0]]
                parameters[self.first_intrinsics + 2 * number + 1] = (
                    camera.distortion[0] if camera.distortion.size else 0.0
                )
        parameters[self.first_point :] = self.initial.points3d[self.triangulated].ravel()
        return parameters

    def _intrinsics(self, parameters: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """K (3, 3) and distortion, at least 4 terms."""
        camera = self.initial.cameras[name]
        K, distortion = camera.K.copy(), camera.distortion if camera.distortion.size else np.zeros(4)
        if name in self.group_of:
            own = parameters[self.first_intrinsics + self.terms * self.group_of[name] :][: self.terms]
            K[0, 0], K[1, 1] = K[0, 0] * np.exp(own[0]), K[1, 1] * np.exp(own[0])
            if self.terms == 2:
                distortion = np.array([own[1], 0.0, 0.0, 0.0])
        return K, distortion

    def rig(self, parameters: np.ndarray) -> TieRig:
        """The rig that a vector of unknowns describes."""
        from scipy.spatial.transform import Rotation

        cameras = {}
        for number, name in enumerate(self.names):
            own = parameters[6 * number : 6 * number + 6]
            pose = np.column_stack([Rotation.from_rotvec(own[:3]).as_matrix(), own[3:]])
            K, distortion = self._intrinsics(parameters, name)
            distortion = distortion if distortion.any() else np.zeros(0)
            cameras[name] = replace(self.initial.cameras[name], world_to_camera=pose, K=K, distortion=distortion)
        points3d = np.full_like(self.initial.points3d, np.nan)
        points3d[self.triangulated] = parameters[self.first_point :].reshape(-1, 3)
        return TieRig(cameras, points3d, self.initial.observations)

    def _project(self, parameters: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) of a camera's points, and OpenCV's derivatives (2N, 10 + distortion terms)."""
        own = parameters[6 * self.names.index(name) :][:6]
        K, distortion = self._intrinsics(parameters, name)
        points3d = parameters[self.first_point :].reshape(-1, 3)[self.columns[name]]
        pixels, derivatives = cv2.projectPoints(points3d, own[:3], own[3:], K, distortion)
        return pixels.reshape(-1, 2), derivatives

    def residuals(self, parameters: np.ndarray) -> np.ndarray:
        """(R,) errors in standard deviations: marks, measured positions, intrinsics priors."""
        points3d = parameters[self.first_point :].reshape(-1, 3)
        marks = [
            ((self._project(parameters, name)[0] - self.pixels[name]) / MARK).ravel()
            for name in self.names
            if len(self.columns[name])
        ]
        intrinsics = parameters[self.first_intrinsics : self.first_point].reshape(len(self.groups), self.terms)
        return np.concatenate(
            [
                *marks,
                ((points3d[self.measured] - self.world) / WORLD).ravel(),
                (intrinsics / np.array([_FOCAL, _RADIAL])[: self.terms]).ravel(),
            ]
        )

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        """(R, U) derivatives of the residuals."""
        blocks = []
        for number, name in enumerate(self.names):
            columns = self.columns[name]
            if not len(columns):
                continue
            _, derivatives = self._project(parameters, name)
            derivatives = derivatives / MARK
            block = np.zeros((2 * len(columns), len(parameters)))
            block[:, 6 * number : 6 * number + 6] = derivatives[:, :6]
            if name in self.group_of:
                K, _ = self._intrinsics(parameters, name)
                at = self.first_intrinsics + self.terms * self.group_of[name]
                block[:, at] = derivatives[:, 6] * K[0, 0] + derivatives[:, 7] * K[1, 1]
                if self.terms == 2:
                    block[:, at + 1] = derivatives[:, 10]
            turned = derivatives[:, 3:6] @ cv2.Rodrigues(parameters[6 * number : 6 * number + 3])[0]
            rows = np.arange(2 * len(columns))
            for axis in range(3):
                block[rows, self.first_point + 3 * np.repeat(columns, 2) + axis] = turned[:, axis]
            blocks.append(block)
        points3d = np.zeros((3 * len(self.measured), len(parameters)))
        columns = (self.first_point + 3 * self.measured[:, None] + np.arange(3)).ravel()
        points3d[np.arange(len(columns)), columns] = 1 / WORLD
        intrinsics = np.zeros((self.first_point - self.first_intrinsics, len(parameters)))
        intrinsics[:, self.first_intrinsics : self.first_point] = np.diag(
            np.tile(1 / np.array([_FOCAL, _RADIAL])[: self.terms], len(self.groups))
        )
        return np.concatenate([*blocks, points3d, intrinsics])
