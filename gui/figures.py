"""Keeps what the timeline shows up to date: the evaluation, marks and the views of the camera path."""

from v3studio.gui.drawing.palette import State
from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.evaluation import Evaluation
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.timeline_plots import PLOTTED, plots_of
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.timeline import TimelinePanel
from v3studio.pipelines.takes.results.evaluation import measured_earlier_bake


class QualityFigures:
    """Reads the evaluation of the open take, and has the timeline plot it."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, views: StageViews, timeline: TimelinePanel
    ) -> None:
        self._player, self._workspace, self._views, self._timeline = player, workspace, views, timeline
        self.evaluation = Evaluation()
        self._seen: object = None

    @property
    def camera(self) -> str:
        """The camera whose figures are shown; "" for the mean, as over an edit, which has a view of its own."""
        return self._player.camera if self._views.shows_player else ""

    def update(self) -> None:
        """Read the evaluation again if it has changed. Call before the window is drawn."""
        take, player = self._workspace.take, self._player
        frames = player.transport.frame_count
        stamp: object = None
        if take is not None:
            stamp = (take.root, modified(take.evaluation), modified(take.record("bake")))
        bake = self._workspace.assessment.stages.get("bake")
        changed = bake is not None and bake.state != State.DONE  # partial, too: some groups are of earlier edits
        camera, other, audio = self.camera, player.other, player.audio
        waveform = audio.waveform if audio is not None else None  # None until it is known, too
        alone = player.shown_other
        seen = (stamp, changed, frames, camera, other, alone, audio, waveform is None)
        if self._seen == seen:
            return
        self._seen = seen
        stale = take is not None and (changed or measured_earlier_bake(take))
        evaluation = self.evaluation = Evaluation() if take is None else Evaluation.read(take.evaluation, stale)
        others = {name: other.series(name, camera) for name in PLOTTED} if other is not None else None
        series = {name: evaluation.series(name, frames, camera) for name in PLOTTED}
        against = other.label if other is not None else ""
        if alone is not None and others is not None:  # what is on screen comes first
            evaluation = self.evaluation = alone.evaluation
            series, others, against = others, series, "the take's own bake"
        whose = evaluation.whose(camera), evaluation.whose(camera, briefly=True)
        plots = plots_of(series, whose[0], others, whose[1], ", earlier bake" * evaluation.stale)
        self._timeline.plots = (*plots, *((waveform,) if waveform is not None else ()))
        self._timeline.explanation = evaluation.explanation
        if against:
            self._timeline.explanation += f"\nYellow, and in parentheses: {against}."


def mark_timeline(
    timeline: TimelinePanel, player: PlayerPresenter, marks: Marks, path: PathEditor, shows_path: bool
) -> None:
    """Give the timeline the marks, and the views of the camera path if its panel is on screen."""
    numbers = path.numbers = player.transport.numbers
    timeline.path_keys = [-1 if frame is None else frame for frame in path.frames] if shows_path else []
    marked = {at: mark.view for frame, mark in sorted(marks.marks.items()) if (at := numbers.index(frame)) is not None}
    timeline.marks = tuple(marked)
    player.places = {at: view.place for at, view in marked.items() if view is not None and view.place}
