"""Capture: all cameras at the current frame with masks, and problems in the footage."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, shortened, wrapped
from v3studio.gui.drawing.compare import boxes
from v3studio.gui.drawing.palette import ACCENT, BAD, DIM, GOOD, GROUND, HELD_OUT, RAISED, TEXT
from v3studio.gui.models.held_out import held_out_first
from v3studio.gui.models.loop import LOOP, Signal
from v3studio.gui.models.playback.image_zoom import Magnifier
from v3studio.gui.models.stages import Inputs
from v3studio.gui.models.take.inspector import Block
from v3studio.gui.models.take.remedies import mask_of
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.pages.capture.garbage_drawing import GarbageDrawing, draw_garbage
from v3studio.gui.pages.capture.mask_verdicts import judged, why_not_judged
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_view import Size, StageView, rectangle, sentence
from v3studio.pipelines.inspection import with_camera_file
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.capture.images import read_image
from v3studio.studio.card import Sample, draw, measure
from v3studio.studio.counts import counted
from v3studio.studio.errors import Cancelled, Message, StudioError
from v3studio.studio.footage import Footage, check_footage, open_footage
from v3studio.studio.footage.checks import ColorDrift
from v3studio.studio.masks.agreement.source import AgreedMaskSource
from v3studio.studio.masks.corrections import REACH, MaskClick
from v3studio.studio.memory_cache import image_cache
from v3studio.studio.meshing.agreement import MaskVerdict

DRAWS = {
    ViewMode.GARBAGE: "click corners, the first again to close; right click takes back or deletes; Escape: all cameras",
    ViewMode.CORRECT: f"click the performer, right click what is not, a dot to take it back; for {REACH} frames before "
    "and after, and for other cameras",
}
"""Modes in which clicks on a camera that is shown alone draw, with a hint."""

TINT = np.array(ACCENT, np.float32)

WIDE, WIDEST = 480, 2048  # most columns of a thumbnail, and of the image of one camera
KEPT_BYTES = 128 * 1024 * 1024  # most bytes of thumbnails that are kept

DECODED_BYTES = 64 * 1024 * 1024
"""Most bytes of decoded images that are kept: a thumbnail needs its image twice, and nothing else does."""


class CaptureView(StageView):
    """Thumbnails of all cameras, or one of them (`camera`; `image_at`: it, and where its image is), with masks or
    without; and with garbage masks, which are drawn on one camera. `footage_check` checks all of it."""

    modes = (ViewMode.MASKS, ViewMode.EVIDENCE, ViewMode.GARBAGE, ViewMode.CORRECT, ViewMode.CARD)

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._reduced: _Reduced | None = None
        self._reduced_of: object = None
        self.footage_check = FootageCheck(workspace)
        self.garbage = GarbageDrawing(workspace)
        self.image_at: tuple[str, Magnifier] | None = None
        self._at = ""  # how far the image is drawn
        self.corrected: Signal[[MaskClick]] = Signal()  # add a click, or take it back if there is the same
        self._frame = 0  # on screen, by its number
        self.wanted: Signal[[str, int]] = Signal()  # a problem was clicked: its camera and the number of its frame
        self._judge: LatestWorker[tuple[_Reduced, int], tuple[MaskVerdict, ...]] = LatestWorker(
            lambda asked: judged(asked[0].footage, asked[1]), "v3studio masks", self._judged
        )
        self._judging: tuple[_Reduced, int] | None = None  # asked for last
        self.verdicts: dict[int, tuple[MaskVerdict, ...]] = {}  # by the number of the frame
        self._lines: list[tuple[float, float, Problem]] = []  # problems in the image: first and last row

    @property
    def doing(self) -> str:
        what = "reading the footage" if self.mode == ViewMode.AS_FILMED else "finding masks"
        return f"{what}: {self._at}" if self._at else what

    @property
    def blocks(self) -> Sequence[Block]:
        """The files that were found, how they are read, and what is shown instead of masks."""
        footage = [] if self._reduced is None else [Block("Footage", [], self._reduced.footage.description)]
        own = "Each camera's own, before they agree: not the masks that training uses."
        return [Block("Evidence", [], own), *footage] if self.mode == ViewMode.EVIDENCE else footage

    def state(self) -> Hashable:
        """The capture settings, the frame, the mode, the result of the check."""
        config = self.workspace.config
        capture = config.capture if config is not None else self.workspace.without_settings
        if capture != self.footage_check.of:
            self.footage_check.forget()  # it was about other settings
        garbage = (self.garbage.stamp, self.garbage.corners)
        check = (self.footage_check.words, tuple(self.footage_check.problems), len(self.verdicts))
        card = modified(self._card_file) if self._card_file is not None else 0
        return (capture, card, garbage, self._clicks, self.camera, self.frame, self.mode, *check, self.em)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        opened = self._open()
        if opened is None:
            return sentence(size, self.workspace.without_settings, self.em)
        footage = opened.footage
        problems = [*map(Problem.of, (*footage.problems, *footage.warnings)), *self.footage_check.problems]
        wide = size[0] - 2 * self.em
        lines = [(line, problem) for problem in problems for line in wrapped(problem.words, self._small, wide)]
        room = min(len(lines), 8)
        bottom = (room + 1.2) * line_height(self._small) if lines or self.footage_check.words else 0
        canvas = Canvas(*size, GROUND)
        frame = footage.frames[min(self.frame, len(footage.frames) - 1)]
        if self.mode == ViewMode.CARD:
            self._draw_card(canvas, size[1] - bottom)
        else:
            self._thumbnails(canvas, opened, frame, size[1] - bottom)
        y = size[1] - bottom
        words = self.footage_check.words or (f"Problems in the footage: {len(problems)}" if problems else "")
        canvas.text(self.em, y, words, self._small, BAD if problems else DIM)
        shown = []
        for number, (line, problem) in enumerate(lines[:room], start=1):
            top = y + number * line_height(self._small)
            canvas.text(self.em, top, line, self._small, BAD)
            shown.append((top, top + line_height(self._small), problem))
        self._lines = shown
        return canvas.pixels

    def _draw_card(self, canvas: Canvas, height: float) -> None:
        self.places, self.image_at = [], None
        picture = self.footage_check.card
        if picture is None and self._card_file is not None:
            with suppress(StudioError):
                picture = read_image(self._card_file)
        if picture is not None:
            canvas.fit_image(0, 0, canvas.width, height, picture)
        else:
            words = "Not measured yet: Initialize measures it first, and Check at any time."
            canvas.text(canvas.width / 2, height / 2, words, self._small, DIM, align="middle", width=canvas.width)

    @property
    def _card_file(self) -> Path | None:
        return self.workspace.context.take.card_picture if self.workspace.context is not None else None

    @property
    def _clicks(self) -> tuple[MaskClick, ...]:
        """The clicks that correct masks; none if they cannot be read."""
        with suppress(StudioError):
            return self.workspace.context.edits.masks if self.workspace.context is not None else ()
        return ()

    @property
    def _small(self) -> int:
        return round(0.85 * self.em)

    def _open(self) -> _Reduced | None:
        context = self.workspace.context
        if context is None:
            return None
        take, config = context.take, context.config
        of = (take.root, config.capture, config.run.paths, self.garbage.stamp, self._clicks, modified(take.rig))
        if self._reduced is None or self._reduced_of != of:
            self._reduced = None
            self.verdicts = {}
            self._reduced, self._reduced_of = _Reduced(*_footage(context, self._clicks)), of
        return self._reduced

    def forget(self) -> None:
        self._reduced = None
        self.footage_check.forget()

    def _thumbnails(self, canvas: Canvas, opened: _Reduced, frame: int, height: float) -> None:
        footage = opened.footage
        alone = self.camera in footage.camera_names
        names = [self.camera] if alone else held_out_first(footage.camera_names, footage.held_out_cameras)
        verdicts = {verdict.camera: verdict for verdict in self._verdicts_of(opened, frame) if verdict.wrong}
        if not alone:  # the worst first
            names = [*verdicts, *(name for name in names if name not in verdicts)]
        draws = alone and self.mode in DRAWS
        places: list[tuple[str, np.ndarray]] = []
        image_at = self.image_at = None
        drawn = self.garbage.polygons() if self.mode == ViewMode.GARBAGE else {}
        wide, high = footage.raw_size(names[0])
        below = self._small + 8  # of the names
        cells = boxes((canvas.width, round(height)), len(names), wide / high, below)
        for number, (name, box) in enumerate(zip(names, cells, strict=True), start=1):
            together = opened.votes and number == 1  # then those of all cameras are found
            self._at = "all cameras together" if together else f"camera {number} of {len(names)}"
            x, y, width, room = box.x, box.y, box.width, box.height - below
            held_out = name in footage.held_out_cameras
            if not draws:  # then clicks are corners
                places.append((name, rectangle(x, y, width, box.height)))
            try:
                picture = self._thumbnail(opened, name, frame, WIDEST if alone else WIDE)
                left, top, wide, high = canvas.fit_image(x, y, width, room, picture)
                if self.mode in DRAWS:
                    at = Magnifier(footage.raw_size(name), (left, top, wide, high))
                    draw_garbage(canvas, at, drawn.get(name), self.garbage.corners if alone else ())
                    for click in self._clicks_on(name, frame):
                        x_at, y_at = at.shown(np.array([click.at]))[0]
                        canvas.dot(x_at, y_at, 5, GOOD if click.performer else BAD)
                    image_at = (name, at) if alone else None
                    self._frame = frame
                if held_out or name in verdicts:
                    for inset in range(1 + 2 * (name in verdicts)):
                        edge = (left + inset, top + inset, wide - 2 * inset, high - 2 * inset)
                        canvas.frame(*edge, BAD if name in verdicts else HELD_OUT)
            except StudioError as error:
                canvas.rect(x, y, width, room, RAISED)
                most = max(int(room // line_height(self._small)) - 1, 1)
                lines = shortened(str(error), self._small, width - 12, most, "...")
                canvas.lines(x + 6, y + 6, lines, self._small, BAD)
            label = f"{name}, held out" if held_out else name
            label += f": {verdicts[name].words}" if name in verdicts else ""
            if self.mode == ViewMode.EVIDENCE:
                label += opened.own_share(name, frame)
            label += f": {DRAWS[self.mode]}" if draws else "; click for all cameras" if alone else ""
            shade = BAD if name in verdicts else TEXT
            canvas.text(x + width / 2, y + room + 2, label, self._small, shade, align="middle", width=width)
        self.places, self.image_at = places, image_at

    def _verdicts_of(self, opened: _Reduced, frame: int) -> Sequence[MaskVerdict]:
        """The verdicts on the masks of a frame, if they are shown; once they are found, the image is drawn again."""
        if self.mode != ViewMode.MASKS or not opened.calibrated:
            return ()
        if frame not in self.verdicts and self._judging != (opened, frame):
            self._judging = opened, frame
            LOOP.post(lambda: self._judge.ask((opened, frame)))
        return self.verdicts.get(frame, ())

    def _judged(self, done: Done[tuple[_Reduced, int], tuple[MaskVerdict, ...]]) -> None:
        (opened, frame), self._judging = done.request, None
        if opened is self._reduced:
            self.verdicts[frame] = done.result or ()  # an error is in the image of its camera

    def _thumbnail(self, opened: _Reduced, name: str, frame: int, widest: int) -> np.ndarray:
        small = opened.image(name, frame, widest)
        if self.mode == ViewMode.AS_FILMED:
            return small
        if self.mode == ViewMode.EVIDENCE:
            evidence = opened.evidence(name, frame)
            return np.repeat((255 * evidence).astype(np.uint8)[..., None], 3, axis=2)
        mask = opened.mask(name, frame, widest)
        if self.mode in DRAWS:  # bright, since one looks for what is not the performer
            return outlined(small, mask)
        alpha = mask[..., None] / np.float32(255)
        return outlined(small * (0.35 + 0.65 * alpha), 255 * alpha[..., 0])

    def click(self, x: float, y: float) -> None:
        """Show the camera and the frame of a problem, or add a corner to the garbage mask, if one is drawn."""
        for top, below, problem in self._lines:
            if top <= y < below and problem.camera:
                self.wanted.emit(problem.camera, problem.frame)
        if (drawn := self._drawn_at(x, y)) is not None:
            camera, pixel, size, scale = drawn
            if self.mode == ViewMode.GARBAGE:
                self.garbage.click(camera, pixel, size, 0.6 * self.em / scale)
            else:
                self._correct(camera, pixel, True, scale)

    def right_click(self, x: float, y: float) -> None:
        """Take back a corner, or delete the garbage mask under the pointer; or say what is not the performer."""
        if (drawn := self._drawn_at(x, y)) is not None:
            camera, pixel, size, scale = drawn
            if self.mode == ViewMode.GARBAGE:
                self.garbage.right_click(camera, pixel, size)
            else:
                self._correct(camera, pixel, False, scale)

    def _drawn_at(self, x: float, y: float) -> tuple[str, tuple[float, float], tuple[int, int], float] | None:
        """The camera that is drawn on, the pixel at a place of the view, size and scale; None: nothing is drawn on."""
        camera, at = self.image_at or ("", None)
        if at is None or self.mode not in DRAWS or camera != self.camera:
            return None
        if self.mode == ViewMode.CORRECT and not at.holds(x, y):
            return None
        return camera, at.pixel(x, y), (at.width, at.height), at.scale

    def _clicks_on(self, camera: str, frame: int) -> list[MaskClick]:
        shown = self.mode == ViewMode.CORRECT
        return [click for click in self._clicks if shown and (click.camera, click.frame) == (camera, frame)]

    def _correct(self, camera: str, pixel: tuple[float, float], performer: bool, scale: float) -> None:
        """Add a click to those of the frame on screen, or take back the one that was hit."""
        reach = 0.4 * self.em / scale
        near = [click for click in self._clicks_on(camera, self._frame) if math.dist(click.at, pixel) < reach]
        click = MaskClick(camera=camera, frame=self._frame, at=pixel, performer=performer)
        self.corrected.emit(near[0] if near else click)

    def check(self) -> None:
        """Check the footage, see `FootageCheck`, on a separate thread."""
        context = self.workspace.context
        if context is not None:
            self.footage_check.start(context)


class _Reduced:
    """The images and masks of a footage, at most some pixels wide; the newest ones are kept. Must not be modified."""

    def __init__(self, footage: Footage, calibrated: bool) -> None:
        self.footage, self.calibrated = footage, calibrated
        source = footage.mask_source
        self.votes = isinstance(source, AgreedMaskSource) and source.votes  # whether the cameras vote
        self._kept = image_cache(KEPT_BYTES)

    def image(self, camera: str, frame: int, widest: int) -> np.ndarray:
        """(h, w, 3) uint8 RGB. Raises StudioError as `Footage.raw_image`."""
        return self._small(("image", camera, frame, widest), widest, lambda: self.footage.raw_image(camera, frame))

    def mask(self, camera: str, frame: int, widest: int) -> np.ndarray:
        """(h, w) uint8, 255 = foreground. Raises StudioError as `Footage.raw_mask`."""
        return self._small(("mask", camera, frame, widest), widest, lambda: self.footage.raw_mask(camera, frame))

    def evidence(self, camera: str, frame: int) -> np.ndarray:
        """(h, w) float32 in 0..1, what the camera alone takes for the performer; without a vote, its mask."""
        source = self.footage.mask_source
        if not self.votes or not isinstance(source, AgreedMaskSource):
            return self.mask(camera, frame, WIDE) / np.float32(255)
        key = ("evidence", camera, frame)
        return self._kept.get_or_make(key, lambda _: (1 / (1 + np.exp(-source.evidence(camera, frame))),))[0]

    def own_share(self, camera: str, frame: int) -> str:
        """An addition to the camera's name: IoU of its own mask with the agreed one; "" without a vote."""
        if not self.votes:
            return ""
        own = self.evidence(camera, frame) > 0.5
        agreed = cv2.resize(self.mask(camera, frame, WIDE), own.shape[::-1], interpolation=cv2.INTER_AREA) > 127
        return f": {(own & agreed).sum() / max((own | agreed).sum(), 1):.0%} as agreed"

    def _small(self, key: Hashable, widest: int, read: Callable[[], np.ndarray]) -> np.ndarray:
        def made(_: Hashable) -> tuple[np.ndarray]:
            whole = read()
            scale = min(1.0, widest / whole.shape[1])
            return (cv2.resize(whole, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA),)

        return self._kept.get_or_make(key, made)[0]


def _footage(context: Inputs, clicks: Sequence[MaskClick]) -> tuple[Footage, bool]:
    """The footage with its problems, which are shown, and few decoded images; and whether it has the take's cameras,
    which may no longer fit it."""
    run, rig = context.config.run, context.take.rig

    def opened(cameras: Rig | None) -> Footage:
        return open_footage(
            context.capture, cameras, strict=False, most_cached=DECODED_BYTES,
            cache_folder=context.take.footage_cache, device=run.device, threads=run.thread_count, mask_clicks=clicks,
        )  # fmt: skip

    if rig.is_file():
        with suppress(StudioError):
            return opened(read_rig(rig)), True
    return opened(None), False


def outlined(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A copy of an image (H, W, 3) with the edge of a mask (H, W), 0 to 255."""
    shown = image.astype(np.uint8)
    inside = (mask > 127).astype(np.uint8)
    shown[cv2.morphologyEx(inside, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0] = TINT
    return shown


@dataclass(frozen=True)
class Problem:
    """A problem in the footage; its camera and the number of its frame, if it is about one."""

    words: str
    camera: str = ""
    frame: int = -1

    @classmethod
    def of(cls, message: Message) -> Problem:
        camera, frame = mask_of(message.fields)
        return cls(str(message), camera if frame >= 0 else "", frame)


class FootageCheck:
    """Checks all images of the footage, and compares the masks of each frame, on a thread. `words`: progress or
    outcome; "" before the first check."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self.words = workspace, ""
        self.card: np.ndarray | None = None  # its image, (H, W, 3) uint8 RGB, once it is measured
        self.problems: Sequence[Problem] = ()
        self.of: object = None  # the settings of the footage that is or was checked
        self._worker: LatestWorker[Inputs, bool] = LatestWorker(self._run, "v3studio check", self._ended)

    def start(self, context: Inputs) -> None:
        """Start, unless it is running."""
        if self._worker.idle:
            self.words, self.problems, self.card, self.of = "checking the footage", (), None, context.config.capture
            self._worker.ask(context)

    def forget(self) -> None:
        """Forget the outcome, unless the check is running."""
        if self._worker.idle:
            self.words, self.problems, self.card, self.of = "", (), None, None

    def _ended(self, done: Done[Inputs, bool]) -> None:
        """Forget the footage that was checked, and note why that failed."""
        if done.error is not None:
            self.words, self.problems = "check failed", (Problem(str(done.error)),)
        elif not self.problems and done.result:
            self._workspace.masks_judged = done.request.config.capture
            self._workspace.changed.emit()

    def _go_on(self, *_: object, **figures: object) -> None:
        if self._worker.closed:
            raise Cancelled

    def _run(self, context: Inputs) -> bool:
        """Returns whether the masks were compared."""

        def progress(done: int, total: int, **figures: object) -> None:
            self._go_on()
            self.words = f"checking the footage, {done} of {total} images"

        footage, calibrated = _footage(context, context.edits.masks)
        if not calibrated:
            with suppress(StudioError):  # the list of footage says what is wrong with the camera file
                footage = with_camera_file(footage)
        drift, sample = ColorDrift(), Sample(footage)
        found = [*map(Problem.of, (*check_footage(footage, progress, drift=drift, see=sample.see), *drift.messages()))]
        why, verdicts = why_not_judged(footage, calibrated), list[MaskVerdict]()
        for number, frame in enumerate(footage.frames * (not why)):
            self._go_on()
            self.words = f"comparing the masks, {number + 1} of {len(footage.frames)} frames"
            verdicts += [verdict for verdict in judged(footage, frame) if verdict.wrong]
        for at in sorted(verdicts, key=lambda verdict: -verdict.lacks - verdict.more):
            found.append(Problem(f"{at.camera}, frame {at.frame}: {at.words}", at.camera, at.frame))
        grades = ""
        if not found:
            self.words = "measuring time, cameras, masks and color"
            measured = measure(footage, self._go_on, sample)
            card, self.card = measured.card, draw(measured)
            found = [Problem(check.line) for check in card.checks if check.grade in ("wrong", "doubtful")]
            grades = card.grades
        self.problems = found
        words = f"{counted(len(found), 'problem')} found" if found else "all images checked, no problems found"
        words += f" ({grades})" if grades else ""
        self.words = f"{words}. {why}" if why else words
        return not why
