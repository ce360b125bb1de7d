"""The stages as shown in the window, and their status in a take."""

from dataclasses import dataclass, field

from v3studio.gui.drawing.palette import FAIR, RGB, STATE_COLORS, State
from v3studio.gui.models.stages import STAGES, Inputs, camera_file
from v3studio.pipelines.events import Notice
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.runs.staleness import StageStatus
from v3studio.studio.errors import Message, StudioError

TITLES = {"capture": "Capture"}
TITLES |= {"review" if stage.name == "evaluate" else stage.name: stage.title for stage in STAGES}
"""The stages as shown in the window, in order."""


TO_RUN = (
    "bakes.not_baked", "mesh.unreadable", "take.damaged", "take.no_cameras", "take.no_report", "take.no_stream",
    "take.not_initialized", "take.not_trained", "training.no_first_points",
)  # fmt: skip
"""Errors that the stage in their field `stage` fixes, by code: results are missing, or damaged."""


def stage_name(stage: str) -> str:
    """A stage as the window names it, by its name on the command line: "Train"."""
    return next((known.title for known in STAGES if known.name == stage), stage[:1].upper() + stage[1:])


def message_text(error: StudioError | Notice) -> str:
    """An error or the event of one as the window says it: what to run is a page, not a command."""
    text, stage = str(error) if isinstance(error, StudioError) else error.message, error.fields.get("stage")
    if not isinstance(stage, str) or error.code not in TO_RUN:
        return text
    again = " again" * (error.code in ("take.damaged", "mesh.unreadable"))
    return f"{text.removesuffix(error.fix).rstrip()} Run {stage_name(stage)}{again}."


def pipeline_name(key: str) -> str:
    """A stage's name on the command line."""
    return "evaluate" if key == "review" else key


@dataclass(frozen=True)
class StageRow:
    """A line of the stage list: the state, `WAITING` for what comes later in the current run; the reason, as a
    sentence, or ""; and the name of the setting that fixes the problem, or ""."""

    key: str
    state: State
    words: str
    detail: str = ""
    setting: str = ""
    fraction: float | None = None
    doubts: tuple[str, ...] = ()  # it is done, but these sentences say what may be wrong with the result

    @property
    def title(self) -> str:
        return TITLES[self.key]

    @property
    def color(self) -> RGB:
        return FAIR if self.doubts else STATE_COLORS[self.state]


@dataclass(frozen=True)
class Assessment:
    """Status of a take's stages and footage: why it cannot be opened, if so; frame numbers in its files, if it can;
    name of the calibration file, "" if the cameras are calibrated from the footage."""

    stages: dict[str, StageStatus] = field(default_factory=dict)
    footage: str = ""
    footage_error: Message | None = None
    footage_warnings: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()
    fps: float = 30.0
    group_starts: tuple[int, ...] = (0,)
    camera_file: str = ""


def assess(context: Inputs) -> Assessment:
    """Assess a take. Reads files: call on a worker thread."""
    try:
        footage = context.raw_footage
    except StudioError as error:
        return Assessment(status(context.take, context.config), footage_error=error.message)
    cameras, frames = len(footage.camera_names), len(footage.frames)
    words = f"{cameras} camera{'s' * (cameras != 1)}, {frames} frame{'s' * (frames != 1)}"
    starts = tuple(group.first for group in context.groups)
    numbers = tuple(int(frame) for frame in footage.frames)
    stages = status(context.take, context.config)
    try:
        file = camera_file(context.capture)
        name = file.name if file is not None else ""
    except StudioError:  # Calibrate reports it
        name = context.config.capture.rig or ""
    warnings = tuple(map(str, (*footage.problems, *footage.warnings)))
    return Assessment(stages, words, None, warnings, numbers, float(footage.fps), starts, name)
