"""Calibrate: camera frustums with images and sparse points, colored by reprojection error; the report as a table."""

from collections.abc import Hashable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, text_width
from v3studio.gui.drawing.labels import draw_labels
from v3studio.gui.drawing.palette import BAD, DIM, FAIR, GOOD, GROUND, HELD_OUT, LINE, RAISED, RGB, SECOND, TEXT, State
from v3studio.gui.models.held_out import held_out_cameras, held_out_first
from v3studio.gui.models.scene.contents import Cloud, Lines, SceneCamera, SceneContents, cloud, frustum_length
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.scene.reader import MOST_THUMBNAILS, SmallImages, small_image
from v3studio.gui.models.scene.render import draw_contents, frusta_places
from v3studio.gui.models.take.inspector import Block
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.pages.calibrate.measured_cameras import MeasuredCameras, Verdict
from v3studio.gui.pages.calibrate.rig_coverage import RigCoverage
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.report_table import CAMERA, Sorting, cells_text
from v3studio.gui.pages.stage_view import OrbitView, Size, rectangle, shown_at
from v3studio.pipelines.takes.results.point_files import read_sparse_points, read_surface
from v3studio.pipelines.takes.results.stage_files import CamerasFromFile
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CalibrationReport, CameraReport
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.own_frame import in_own_frame

GRADES: dict[str, RGB] = {"good": GOOD, "usable": FAIR, "wrong": BAD}
TRAINING: tuple[str, RGB] = ("training cameras", SECOND)
NOT_TRAINED_ON: tuple[str, RGB] = ("held out: not trained on, quality is measured with them", HELD_OUT)
NONE_HELD_OUT = "no camera is held out: Capture > Cameras"

COLUMNS = ("error px", "points", "coverage", "focal px", "matches fit", "mask error", "refined by")
PLACES = dict(zip(COLUMNS, (0.31, 0.4, 0.51, 0.6, 0.74, 0.87, 1.0), strict=True))
"""Titles of the report's columns besides the cameras' names, and where columns end, shares of the width."""


class CalibrateView(OrbitView):
    """The cameras as frusta, how well they cover the performer, and the report."""

    modes = (ViewMode.CAMERAS, ViewMode.COVERAGE, ViewMode.REPORT, ViewMode.BY_HAND)  # the last is `PointsView`'s
    sharp = True
    _rig: Rig  # as read last

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._read_of: Hashable = None
        self._measured = MeasuredCameras()
        self._points: list[Cloud] = []
        self._thumbnails: SmallImages = MemoryCache(MOST_THUMBNAILS)
        self._coverage: RigCoverage | None = None
        self._coverage_of: Hashable = None
        self._sorting = Sorting()
        self._titles: list[tuple[str, np.ndarray]] = []
        self._text = ""
        self._first_row = self._last_first_row = 0
        self._shown_camera = ""

    @property
    def orbits(self) -> bool:
        """Whether drags orbit: the report is a table."""
        return self.mode != ViewMode.REPORT

    @property
    def blocks(self) -> Sequence[Block]:
        """Return how well the cameras cover the performer, and what the reader of their file assumed."""
        covered, checked = self._coverage, self._measured.checked
        report = checked.report
        blocks = [Block("Are they right?", [], "\n".join(checked.sentences))] if report is not None else []
        blocks += [covered.block] if covered is not None else []
        if isinstance(report, CamerasFromFile) and report.notes:
            blocks.append(Block("Camera file", [], "\n".join(report.notes)))
        return blocks

    def state(self) -> Hashable:
        """The calibration files, the view, and the frame whose images are on the frustums."""
        take = self.workspace.take
        stamp = _stamp(take) if take is not None else None
        if stamp != self._read_of:
            self.orbit = None  # other cameras need another view
        view = self.orbit.key if self.orbit is not None else None
        frame = self.frame if self.mode == ViewMode.CAMERAS else 0
        return (stamp, self._covered_by(), self.mode, self.camera, view, frame, self.em, self._sorting, self._first_row)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        take = self.workspace.take
        if take is None or not take.rig.is_file():
            # or the inspector would show those of the last take
            self._coverage = self._coverage_of = self._read_of = None
            self._measured = MeasuredCameras()
            raise StudioError("take.no_cameras", "no cameras yet", stage="calibrate")
        self._read(take)
        self._cover(take)
        return self._table(size) if self.mode == ViewMode.REPORT else self._scene(size)

    def _read(self, take: Take) -> None:
        stamp = _stamp(take)
        if stamp == self._read_of:
            return
        self._rig = in_own_frame(read_rig(take.rig))
        self._measured = MeasuredCameras.read(take, self._rig)
        self._points = []
        if take.calibration_points.is_file():
            self._points.append(cloud(*read_sparse_points(take.calibration_points, take.rig)))
        self._thumbnails.clear()
        self.home = _overview(self._rig)
        self._read_of = stamp

    def _covered_by(self) -> Hashable:
        """Everything besides the rig that the coverage depends on."""
        take, config = self.workspace.take, self.workspace.config
        if take is None or config is None:
            return None
        return (config.capture, config.run.paths, modified(_surface(take)), self._initialized)

    @property
    def _initialized(self) -> bool:
        """Whether the surface is of these cameras."""
        status = self.workspace.assessment.stages.get("initialize")
        return status is not None and status.state == State.DONE

    def _cover(self, take: Take) -> None:
        of = (self._read_of, self._covered_by())
        if of == self._coverage_of:
            return
        assert self.home is not None
        context = self.workspace.context
        names: Sequence[str] = self._rig.names
        with suppress(StudioError):  # footage that is gone; the Capture view shows the error
            names = context.raw_footage.train_cameras if context is not None else names
        self._coverage, self._coverage_of = None, of
        with suppress(StudioError):  # damaged points of the first group; Initialize shows the error
            surface = read_surface(_surface(take)) if self._initialized and _surface(take).is_file() else None
            self._coverage = RigCoverage.of(self._rig, names, self.home.target, surface)

    @property
    def _cameras(self) -> list[Camera]:
        """The cameras in the order of the report."""
        return [self._rig[name] for name in held_out_first(self._rig.names, held_out_cameras(self.workspace.context))]

    def _figures(self, name: str) -> CameraReport | None:
        """The report on a camera; None if the cameras are from a file."""
        report = self._measured.checked.report
        return report.cameras.get(name) if isinstance(report, CalibrationReport) else None

    def _scene(self, size: Size) -> np.ndarray:
        assert self.home is not None
        view = (self.orbit or self.home).camera(*size)
        covered = self._coverage if self.mode == ViewMode.COVERAGE else None
        context = self.workspace.context
        held_out = held_out_cameras(context)
        cameras = []
        for camera in self._rig:
            color = self._measured.verdict(camera.name).value[1] if covered is None else SECOND
            if camera.name in held_out:
                color = HELD_OUT
            if camera.name == self.camera:
                color = TEXT
            image = None
            if covered is None and context is not None:
                image = small_image(self._thumbnails, context, camera.name, self.frame)
            cameras.append(SceneCamera(camera, color, image))
        length = frustum_length(self._rig, self.home.target)
        if covered is not None:
            contents = SceneContents(cameras, length, covered.seen_from(view.center, round(0.2 * self.em)))
        else:
            contents = SceneContents(cameras, length, self._points, lines=[_floor(self.home)])
        canvas = draw_contents(contents, view)
        self.places = frusta_places(contents, view)
        small = round(0.85 * self.em)
        # the chosen one first, then those in front: where there is no room for all names, these have theirs
        nearest = self.places[::-1]
        named = sorted(nearest, key=lambda place: place[0] != self.camera)
        figures = {name: self._figures(name) if covered is None else None for name, _ in named}
        words = [name if report is None else f"{name}  {report.mean:.2f} px" for name, report in figures.items()]
        draw_labels(canvas, words, [corners for _, corners in named], small)
        self._legend(canvas, small, covered, bool(held_out))
        return canvas.pixels

    def _legend(self, canvas: Canvas, small: int, covered: RigCoverage | None, held_out: bool) -> None:
        if covered is not None:
            entries = [*covered.legend, TRAINING]
        else:
            verdicts = {self._measured.verdict(camera.name) for camera in self._rig}
            entries = [verdict.value for verdict in Verdict if verdict in verdicts]
        entries.append(NOT_TRAINED_ON if held_out else (NONE_HELD_OUT, GROUND))  # no dot, as it has no color
        for number, (words, color) in enumerate(entries):
            y = self.em * 0.7 + number * line_height(small)
            # frusta may be behind it
            canvas.rect(0.6 * self.em, y, 1.5 * self.em + text_width(words, small), line_height(small), GROUND)
            canvas.dot(self.em, y + 0.6 * small, 0.3 * small, color)
            canvas.text(1.7 * self.em, y, words, small, DIM)

    def _table(self, size: Size) -> np.ndarray:
        canvas = Canvas(*size, GROUND)
        normal, em = round(0.95 * self.em), self.em
        step = line_height(normal)
        y = em
        checked = self._measured.checked
        report, verdict = checked.report, checked.verdict
        source = (report.source if report is not None else None) or "an unknown source"
        source = "a file" if isinstance(report, CamerasFromFile) else source
        facts = [counted(len(self._rig), "camera"), f"from {source}"]
        columns = self._columns()
        held_out = held_out_cameras(self.workspace.context)
        if isinstance(report, CalibrationReport):
            figures = report.reprojection
            facts.append(f"reprojection error: mean {figures.mean:.2f} px, p95 {figures.p95:.2f} px")
        canvas.text(em, y, ", ".join(facts), normal, TEXT, width=size[0] - 2 * em)
        y += step
        color = DIM if verdict is None else GRADES[verdict.grade]
        for sentence in checked.sentences:
            canvas.text(em, y, sentence, normal, color, width=size[0] - 2 * em)
            y += step
            color = DIM
        y += 0.5 * step
        wide = size[0] - 2 * em
        places = []
        ends = {CAMERA: 1.7 * em + text_width(CAMERA, normal)}
        ends |= {title: em + PLACES[title] * wide for title in columns}
        self._titles = self._heading(canvas, ends, y, normal)
        y += step
        cameras, names = self._cameras, [camera.name for camera in self._cameras]
        order = self._sorting.order(names, columns)
        rows = ([names[row], *(words[row] for words in columns.values())] for row in order)
        self._text = cells_text([[CAMERA, *columns], *rows])
        room = max(3, int((size[1] - y) / step) - 1)
        self._last_first_row = max(0, len(order) - room)
        if self.camera != self._shown_camera:  # chosen elsewhere: its row is shown
            self._shown_camera = self.camera
            place = next((place for place, row in enumerate(order) if cameras[row].name == self.camera), 0)
            if not self._first_row <= place < self._first_row + room:
                self._first_row = place - room // 2
        first = self._first_row = min(max(self._first_row, 0), self._last_first_row)
        for row in order[first : first + room]:
            camera = cameras[row]
            places.append((camera.name, rectangle(0, y, size[0], step)))
            if camera.name == self.camera:
                canvas.rect(0.2 * em, y, size[0] - 0.4 * em, step, RAISED)
            canvas.dot(em, y + 0.6 * normal, 0.22 * em, self._measured.verdict(camera.name).value[1])
            label = f"{camera.name}, held out" if camera.name in held_out else camera.name
            canvas.text(1.7 * em, y, label, normal, TEXT, width=PLACES[COLUMNS[0]] * wide - 5 * em)
            for title, words in columns.items():
                canvas.text(em + PLACES[title] * wide, y, words[row], normal, TEXT, align="right")
            y += step
        self.places = places
        if self._last_first_row:
            shown = f"{first + 1} to {min(first + room, len(order))} of {len(order)}; the wheel shows the others"
            canvas.text(1.7 * em, y, shown, normal, DIM)
        return canvas.pixels

    def _heading(self, canvas: Canvas, ends: dict[str, float], y: float, size: int) -> list[tuple[str, np.ndarray]]:
        """Draw the titles, given where each ends, and what the rows are sorted by; the places to click."""
        places = []
        for title, end in ends.items():
            chosen = title == self._sorting.column
            width = canvas.text(end, y, title, size, TEXT if chosen else DIM, align="right")
            places.append((title, rectangle(end - width - 0.4 * self.em, y, width + 0.8 * self.em, line_height(size))))
            if chosen:
                x = end + 0.2 * self.em if title == CAMERA else end - width - self.em
                canvas.icon(x, y + 0.3 * self.em, f"row {'down' if self._sorting.descending else 'up'}", 0.8 * self.em)
        return places

    def click(self, x: float, y: float) -> None:
        """Sort the report by the title at a pixel."""
        title = shown_at(self._titles, x, y) if self.mode == ViewMode.REPORT else ""
        if title:
            self._sorting = self._sorting.clicked(title)

    @property
    def table_text(self) -> str:
        return self._text if self.mode == ViewMode.REPORT else ""

    @property
    def status(self) -> str:
        return "Click a title to sort. Ctrl+C copies the table." if self.mode == ViewMode.REPORT and self._text else ""

    def _columns(self) -> dict[str, list[str]]:
        """The columns of the report by title, without empty ones."""
        rows = []
        for camera in self._cameras:
            report = self._figures(camera.name)
            known = ["", "", ""]
            if report is not None:
                known = [f"{report.mean:.2f}", str(report.observations), f"{100 * report.coverage:.0f}%"]
            rows.append([*known, f"{camera.fx:.0f}", *self._checks(camera.name)])
        columns = dict(zip(COLUMNS, map(list, zip(*rows, strict=True)), strict=True))
        return {title: words for title, words in columns.items() if any(words)}

    def _checks(self, name: str) -> list[str]:
        """The last three columns of a camera."""
        verdict, refinement = self._measured.checked.verdict, self._measured.checked.refinement
        checked = verdict.cameras.get(name) if verdict is not None else None
        change = refinement.cameras.get(name) if refinement is not None else None
        mask_error = self._measured.mask_errors.get(name)
        return [
            "" if checked is None or checked.fits is None else f"{checked.fits:.0%} of {checked.matches}",
            "" if mask_error is None else f"{mask_error:.0%}",
            "" if change is None else f"{change.degrees:.2f}\N{DEGREE SIGN}, {change.distance:.3g}",
        ]

    def wheel(self, x: float, y: float, notches: float) -> None:
        """Zoom; in the report, show other rows."""
        if self.mode != ViewMode.REPORT:
            super().wheel(x, y, notches)
        else:
            self._first_row = min(max(self._first_row - round(3 * notches), 0), self._last_first_row)


def _floor(home: OrbitCamera) -> Lines:
    """A ring around the target, so that rotation is visible."""
    turns = np.linspace(0, 2 * np.pi, 25)[:, None]
    ring = home.target + 0.25 * home.distance * (np.column_stack([np.cos(turns), np.sin(turns)]) @ home.basis())
    return Lines.of(np.stack([ring[:-1], ring[1:]], axis=1), LINE)


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


def _stamp(take: Take) -> Hashable:
    checks = (take.rig_verdict, take.camera_refinement, take.record("initialize"))
    return (take.root, *map(modified, (take.rig, take.calibration_report, take.calibration_points, *checks)))


def _surface(take: Take) -> Path:
    """Points on the performer in the first frame."""
    return take.initialize_group(0) / "points.ply"
