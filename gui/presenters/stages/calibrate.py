"""Calibrate: camera frustums with images and sparse points, colored by reprojection error; the report as a table."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from gui.presenters.drawing.canvas import Canvas, line_height
from gui.presenters.drawing.painter import NEAR, draw_frustum, draw_points, frustum, project
from gui.presenters.drawing.palette import BAD, DIM, FAIR, GOOD, GROUND, LINE, RAISED, RGB, SECOND, TEXT
from gui.presenters.playback.orbit import OrbitCamera
from gui.presenters.run.workspace import Workspace
from gui.presenters.stages.stage_view import OrbitView, Size, rectangle
from pipelines.takes.calibration import CamerasReport, read_cameras_report
from pipelines.takes.point_files import read_points
from pipelines.takes.take import Take
from studio.calibration.report import CalibrationReport, CameraReport
from studio.cameras import Camera, Rig
from studio.errors import StudioError

BANDS: dict[str, tuple[str, RGB]] = {
    "excellent": ("good: below 0.5 px", GOOD),
    "acceptable": ("acceptable: 0.5 to 1 px", FAIR),
    "review": ("review: 1 px or more", BAD),
}
UNKNOWN: tuple[str, RGB] = ("no reprojection error: cameras from a file", SECOND)


class CalibrateView(OrbitView):
    """See the module."""

    modes = ("cameras", "report", "points by hand")  # the last is `PointsView`'s

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._read_of: Hashable = None
        self._rig: Rig | None = None
        self._report: CamerasReport | None = None
        self._points: tuple[np.ndarray, np.ndarray] | None = None
        self._thumbnails: dict[tuple[str, int], np.ndarray | None] = {}

    def state(self) -> Hashable:
        """The calibration files, the view, and the frame whose images are on the frustums."""
        take = self.workspace.take
        stamp = _stamp(take) if take is not None else None
        if stamp != self._read_of:
            self.orbit = None  # other cameras need another view
        view = self.orbit.key if self.orbit is not None else None
        return (stamp, self.mode, self.camera, view, self.frame if self.mode == "cameras" else 0, self.em)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        """See `StageView`."""
        take = self.workspace.take
        if take is None or not take.rig.is_file():
            raise StudioError("take.no_cameras", "no cameras yet", fix="Run Calibrate.")
        self._read(take)
        return self._table(size) if self.mode == "report" else self._scene(size)

    def _read(self, take: Take) -> None:
        stamp = _stamp(take)
        if stamp == self._read_of:
            return
        from studio.camera_files import read_rig

        self._rig = read_rig(take.rig)
        self._report = read_cameras_report(take)
        self._points = read_points(take.calibration_points) if take.calibration_points.is_file() else None
        self._thumbnails.clear()
        self._home = _overview(self._rig)
        self._read_of = stamp

    def _error(self, name: str) -> float | None:
        figures = self._figures(name)
        return None if figures is None else figures.mean

    def _figures(self, name: str) -> CameraReport | None:
        """None if the cameras are from a file."""
        return self._report.cameras.get(name) if isinstance(self._report, CalibrationReport) else None

    def _color(self, name: str) -> RGB:
        from studio.calibration.result import quality_of

        error = self._error(name)
        return UNKNOWN[1] if error is None else BANDS[quality_of(error)][1]

    def _scene(self, size: Size) -> np.ndarray:
        assert self._rig is not None
        assert self._home is not None
        orbit = self.orbit or self._home
        view = orbit.camera(*size)
        canvas = Canvas(*size, GROUND)
        self._floor(canvas, view, self._home)
        if self._points is not None:
            points, colors = self._points
            draw_points(canvas, view, points, (np.clip(colors, 0, 1) * 255).astype(np.uint8), 2)
        length = 0.16 * float(np.median([np.linalg.norm(camera.center - self._home.target) for camera in self._rig]))
        far_first = sorted(self._rig, key=lambda camera: -float(np.linalg.norm(camera.center - orbit.eye)))
        small = round(0.85 * self.em)
        places = []
        for camera in far_first:
            color = TEXT if camera.name == self.camera else self._color(camera.name)
            center, corners = frustum(camera, length)
            pixels, depth = project(view, np.vstack([center[None], corners]))
            if (depth > NEAR).all():
                places.append((camera.name, pixels))
            place = draw_frustum(canvas, view, camera, length, color, self._thumbnail(camera.name), 2)
            if place is not None:
                error = self._error(camera.name)
                words = camera.name if error is None else f"{camera.name}  {error:.2f} px"
                canvas.text(place[0], place[1] + 4, words, small, TEXT, align="middle")
        self.places = places
        self._legend(canvas, small)
        return canvas.pixels

    def _floor(self, canvas: Canvas, view: Camera, home: OrbitCamera) -> None:
        """Draw a ring around the target, so that rotation is visible."""
        from gui.presenters.drawing.painter import draw_line

        first, second = home.basis()
        radius = 0.25 * home.distance
        for step in range(24):
            angles = np.array([step, step + 1]) * np.pi / 12
            ends = [home.target + radius * (np.cos(angle) * first + np.sin(angle) * second) for angle in angles]
            draw_line(canvas, view, ends[0], ends[1], LINE)

    def _legend(self, canvas: Canvas, small: int) -> None:
        known = any(self._error(camera.name) is not None for camera in self._rig or ())
        entries = list(BANDS.values()) if known else [UNKNOWN]
        for number, (words, color) in enumerate(entries):
            y = self.em * 0.7 + number * line_height(small)
            canvas.dot(self.em, y + 0.6 * small, 0.3 * small, color)
            canvas.text(1.7 * self.em, y, words, small, DIM)

    def _thumbnail(self, name: str) -> np.ndarray | None:
        import cv2

        context = self.workspace.context
        if context is None:
            return None
        key = (name, self.frame)
        if key not in self._thumbnails:
            if len(self._thumbnails) > 200:
                self._thumbnails.clear()
            try:
                footage = context.footage.raw
                image = footage.raw_image(name, footage.frames[min(self.frame, len(footage.frames) - 1)])
                scale = 160 / max(image.shape[:2])
                self._thumbnails[key] = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            except StudioError:
                self._thumbnails[key] = None  # the Capture view shows the error
        return self._thumbnails[key]

    def _table(self, size: Size) -> np.ndarray:
        assert self._rig is not None
        canvas = Canvas(*size, GROUND)
        normal, em = round(0.95 * self.em), self.em
        step = line_height(normal)
        y = em
        report = self._report
        source = (report.source if report is not None else None) or "an unknown source"
        facts = [f"{len(self._rig)} cameras", f"from {source}"]
        if isinstance(report, CalibrationReport):
            figures = report.reprojection
            facts.append(f"reprojection error: mean {figures.mean:.2f} px, p95 {figures.p95:.2f} px")
            facts.append(report.quality)
        canvas.text(em, y, ", ".join(filter(None, facts)), normal, TEXT, width=size[0] - 2 * em)
        y += 1.5 * step
        columns = [
            ("camera", 0.0),
            ("error px", 0.36),
            ("p95 px", 0.5),
            ("points", 0.64),
            ("coverage", 0.8),
            ("focal px", 1.0),
        ]
        wide = size[0] - 2 * em
        places = []
        for title, at in columns:
            canvas.text(em + at * wide, y, title, normal, DIM, align="left" if at == 0 else "right")
        y += step
        for camera in self._rig:
            found = self._figures(camera.name)
            words = [
                camera.name,
                "from file" if found is None else f"{found.mean:.2f}",
                "" if found is None else f"{found.p95:.2f}",
                "" if found is None else str(found.observations),
                "" if found is None else f"{100 * found.coverage:.0f}%",
                f"{camera.fx:.0f}",
            ]
            places.append((camera.name, rectangle(0, y, size[0], step)))
            if camera.name == self.camera:
                canvas.rect(0.2 * em, y, size[0] - 0.4 * em, step, RAISED)
            canvas.dot(0.5 * em, y + 0.6 * normal, 0.25 * em, self._color(camera.name))
            for (_, at), word in zip(columns, words, strict=True):
                canvas.text(em + at * wide, y, word, normal, TEXT, align="left" if at == 0 else "right")
            y += step
        self.places = places
        for name, reason in report.unregistered.items() if isinstance(report, CalibrationReport) else ():
            canvas.text(em, y, f"{name}: not registered: {reason}", normal, BAD, width=wide)
            y += step
        return canvas.pixels

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        """See `StageView`."""
        if self.mode == "cameras":  # the report is a table
            super().drag(dx, dy, turn, height)


def _overview(rig: Rig) -> OrbitCamera:
    """A view of all cameras from above."""
    centers = np.array([camera.center for camera in rig])
    ahead = np.array([camera.forward for camera in rig])
    # the point nearest to all viewing rays
    crossing = np.eye(3)[None] - ahead[:, :, None] * ahead[:, None, :]
    target = np.linalg.lstsq(crossing.sum(0), (crossing @ centers[..., None]).sum(0)[:, 0], rcond=None)[0]
    orbit = OrbitCamera.around(np.vstack([centers, target[None]]), rig.up)
    radius = float(np.linalg.norm(centers - target, axis=1).max())
    return OrbitCamera(target=target, up=rig.up, distance=max(orbit.distance, 2.6 * radius), yaw=0.6, pitch=0.55)


def _stamp(take: Take) -> tuple[float, ...]:
    return tuple(
        path.stat().st_mtime if path.is_file() else 0.0
        for path in (take.rig, take.calibration_report, take.calibration_points)
    )
