"""StageView: the viewport's image of a stage, drawn on a worker thread from a snapshot of the state."""

from collections.abc import Hashable, Sequence
from typing import ClassVar, cast

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, shortened
from v3studio.gui.drawing.palette import DIM, GROUND, TEXT
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.stage_rows import TO_RUN, message_text
from v3studio.gui.models.take.inspector import Block
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import LatestWorker
from v3studio.gui.pages.choices import ViewMode
from v3studio.pipelines.takes.results.summaries import summary_words
from v3studio.studio.errors import StudioError

PICK_MARGIN = 3.0  # pixels by which a click may miss a camera: frustums far away are small

Size = tuple[int, int]
_Request = tuple[Size, str, Hashable, bool]


class StageView:
    """Base of stage views, which define what the image depends on (`state`) and draw it (`draw`, on a thread). It shows
    the figures of the last run of `stage`, a key of `TITLES`, for stages without a view of their own."""

    modes: ClassVar[tuple[ViewMode, ...]] = ()  # images to choose from; the first is the default
    # whether it is drawn at the resolution of the viewport once it rests, though it orbits
    sharp: ClassVar[bool] = False

    def __init__(self, workspace: Workspace, stage: str = "") -> None:
        self.workspace, self._stage = workspace, stage
        self.mode = self.modes[0] if self.modes else ViewMode.AS_FILMED
        self.em = 16.0
        self.frame = 0
        # name of a camera and outline of its image or frustum, (N, 2) pixels; those in front last
        self.places: list[tuple[str, np.ndarray]] = []
        self.camera = ""  # the marked camera; "" for none
        self._worker: LatestWorker[_Request, np.ndarray] = LatestWorker(self._work, f"v3studio {type(self).__name__}")
        self._asked: _Request | None = None

    @property
    def doing(self) -> str:
        """Return what is being done while an image is awaited."""
        return "rendering"

    @property
    def orbits(self) -> bool:
        """Whether drags orbit; such an image may be drawn smaller than the viewport, to stay fast."""
        return False

    def state(self) -> Hashable:
        """Everything that the image depends on except its size; compared for equality."""
        status = self.workspace.assessment.stages.get(self._stage)
        return (summary_words(self._stage, status.summary) if status and status.summary else "not run yet", self.em)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        """(height, width, 3) uint8. Called on the view's thread. Raises StudioError: shown instead of the image."""
        words, em = cast(tuple[str, float], state)
        return sentence(size, words, em)

    @property
    def blocks(self) -> Sequence[Block]:
        """Figures for the inspector, as far as they are known; none by default."""
        return ()

    def poll(self, size: Size) -> np.ndarray | None:
        """Return a new image if there is one, and request one if anything has changed. Never blocks."""
        request = (size, self.mode, self.state(), self.workspace.busy)
        if request != self._asked:
            self._asked = request
            self._worker.ask(request)
        done = self._worker.take()
        if done is None or done.request[1] != self.mode:  # of a mode that was left meanwhile
            return None
        if done.result is not None:
            return done.result
        error = done.error
        if not isinstance(error, StudioError):
            words = f"{type(error).__name__}: {error}"
        elif self.workspace.busy and error.code in TO_RUN:
            words = error.problem  # the run may be about to make it
        else:
            words = message_text(error)
        return sentence(size, words, self.em)

    def show_again(self) -> None:
        """Request the image again at the next poll, because the viewport has shown something else."""
        self._asked = None
        self._worker.take()  # drawn before: out of date

    @property
    def settled(self) -> bool:
        """Whether the newest image shows what was last requested."""
        return self._worker.idle

    def _work(self, request: _Request) -> np.ndarray:
        size, _, state, _ = request
        return self.draw(size, state)

    # Gestures; ignored by default

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        """Handle a drag in pixels; `turn`: orbit (left button), else pan."""

    def grabs(self, x: float, y: float) -> bool:
        """Whether a press at a pixel of the image grabs something, or begins to draw."""
        return False

    def pull(self, x: float, y: float) -> None:
        """Drag to a pixel."""

    def release(self) -> None:
        """End a drag."""

    def wheel(self, x: float, y: float, notches: float) -> None:
        """Handle the wheel at a pixel of the image."""

    def click(self, x: float, y: float) -> None:
        """Handle a click at a pixel of the image."""

    def right_click(self, x: float, y: float) -> None:
        """Handle a right click at a pixel of the image where no camera is shown."""

    def reset(self) -> None:
        """Return to the initial view."""

    @property
    def status(self) -> str:
        """The status line."""
        return ""

    @property
    def table_text(self) -> str:
        """The table that is shown, lines of cells with tabs between them; "" without a table."""
        return ""

    def forget(self) -> None:
        """Free the previous take's large buffers."""


class OrbitView(StageView):
    """A stage view of a 3D scene: drags orbit and pan, the wheel zooms. `home`: the initial view, which `draw` sets."""

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.orbit: OrbitCamera | None = None
        self.home: OrbitCamera | None = None

    @property
    def orbits(self) -> bool:
        return True

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        orbit = self.orbit or self.home
        if orbit is not None and self.orbits:
            self.orbit = orbit.orbit(dx, dy) if turn else orbit.pan(dx, dy, height)

    def wheel(self, x: float, y: float, notches: float) -> None:
        orbit = self.orbit or self.home
        if orbit is not None:
            self.orbit = orbit.zoom(notches)

    def reset(self) -> None:
        """Return to the initial view."""
        self.orbit = None

    def forget(self) -> None:
        """Forget the view, which belongs to the previous take, too."""
        self.orbit = None


def shown_at(places: Sequence[tuple[str, np.ndarray]], x: float, y: float) -> str:
    """The name of the place at a pixel, the last if there are several; "" if there is none."""
    for name, corners in reversed(places):
        hull = cv2.convexHull(corners.astype(np.float32))
        if cv2.pointPolygonTest(hull, (float(x), float(y)), True) >= -PICK_MARGIN:
            return name
    return ""


def rectangle(x: float, y: float, width: float, height: float) -> np.ndarray:
    """(4, 2) corners."""
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def waiting(pixels: np.ndarray, words: str, em: float) -> np.ndarray:
    """A dimmed copy of the image on screen, for as long as it is not what was chosen, with a word why."""
    canvas = Canvas.of((0.3 * pixels + 0.7 * np.array(GROUND)).astype(np.uint8))
    if words:
        canvas.text(canvas.width / 2, canvas.height / 2 - 0.6 * em, words, round(em), TEXT, align="middle")
    return canvas.pixels


def sentence(size: Size, words: str, em: float) -> np.ndarray:
    """Draw an image with centered text."""
    canvas = Canvas(*size, GROUND)
    text_size = round(em)
    step = line_height(text_size)
    room = max(int(size[1] // step) - 1, 1)
    lines = shortened(words[:1].upper() + words[1:], text_size, 0.8 * size[0], room, "...")
    canvas.lines(size[0] / 2, (size[1] - step * len(lines)) / 2, lines, text_size, DIM, align="middle")
    return canvas.pixels
