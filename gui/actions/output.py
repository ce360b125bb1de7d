"""Actions that write files: screenshots, exports, the report."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from v3studio.gui.drawing.palette import BAD, DIM, State
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.exports import (
    ALL_FRAMES,
    FORMATS,
    LEAST_SECONDS,
    MOVIE_BACKGROUNDS,
    MOVIE_SIZES,
    MOVIES,
    SIZED,
    WHOLE,
    ExportRequest,
    Exports,
)
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.form import Form
from v3studio.gui.widgets.picture import color
from v3studio.pipelines.export import DEFAULT_OF
from v3studio.pipelines.reports.evaluation import update_marks
from v3studio.pipelines.reports.images import write_image
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import EXPORTS
from v3studio.studio.formats.usd import usd

OPTIONS = "Seconds and background apply to movies, size to movies and plates."
NO_USD = "USD needs usd-core, which is missing: pip install 'usd-core>=26.3'"


class OutputActions:
    """Writes screenshots, exports and the report, after asking where that is needed."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, views: StageViews, exports: Exports, dialogs: Dialogs,
        notices: Notices,
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._views, self._exports = player, workspace, views, exports
        self._dialogs, self._notices = dialogs, notices
        self._kind = next(iter(FORMATS))

    def screenshot(self) -> None:
        """Save the image as shown."""
        player, notices = self._player, self._notices
        picture, opened = player.picture, player.opened
        if picture is None:
            notices.show("No image to save yet.")
            return
        number = player.transport.number(picture.request.frame)
        name = f"{picture.request.mode.replace(' ', '_')}_{picture.request.what}_{number:06d}.png"
        folder = opened.take.root.parent if opened is not None and opened.take is not None else Path.home()

        def save(text: str) -> None:
            path = Path(text.strip()).expanduser().absolute()
            if path.suffix.lower() != ".png":
                path = path.with_name(path.name + ".png")
            problem = ""
            try:
                write_image(path, picture.image)
            except OSError as error:
                problem = f"{path}: cannot be written ({error.strerror}). Choose another folder."
            if notices.outcome("screenshot", problem):
                notices.show(f"Written: {path}", path=path)

        words = "PNG file of the viewport's image:"
        self._dialogs.line("screenshot", "Save screenshot", words, str(folder / name), ("save", "Save", save))

    def export(self, kind: str = "") -> None:
        """Ask for the options, then export. `kind`: to begin with; by default the one that was exported last."""
        opened, transport = self._player.opened, self._player.transport
        if opened is None or not opened.sources:
            self._notices.show("Nothing to export yet.")
            return
        first = "trained" if self._stale else DEFAULT_OF  # if it exists
        sources = sorted(opened.sources, key=lambda name: name != first) if opened.take is not None else []
        folder = opened.path.parent if isinstance(opened.path, Path) else Path.home()
        request = ExportRequest(kind or self._kind, str(opened.path), opened.title, folder)
        other = self._player.shown_other
        if other is not None:  # what is on screen
            place, of = other.exported
            request.source, request.title, sources = str(place), f"{opened.title}-{other.label}", [of] if of else []
        request.of = sources[0] if sources else ""
        length = transport.frame_count / transport.fps
        request.seconds = f"{max(length, LEAST_SECONDS):g}"
        request.ranges = self._ranges()
        self._choose_frames(request)
        self._ask_export(request, sources)

    def _choose_frames(self, request: ExportRequest) -> None:
        """Choose the frames that are usual for the format: the span, the frame under review as a file, else all."""
        every, present, *span = request.ranges
        reviewed = self._views.stage == "review" and not self._player.transport.playing
        if span:
            request.frames = span[0]
        else:
            request.frames = present if reviewed and EXPORTS[request.kind].holds == "frame" else every

    @property
    def _stale(self) -> bool:
        """Whether the take has changed since its stream was baked."""
        workspace = self._workspace
        return workspace.take is not None and workspace.row("bake").state in (State.STALE, State.PARTIAL)

    def _ranges(self) -> dict[str, range | None]:
        """Frames that can be exported: all, the one on screen, the selected span."""
        transport = self._player.transport
        frame, span = transport.number(transport.frame), transport.span
        ranges: dict[str, range | None] = {ALL_FRAMES: None, f"frame {frame}": range(frame, frame + 1)}
        if span is not None:
            ranges[transport.range_words(*span).lower()] = range(*map(transport.number, (span[0], span[1] + 1)))
        return ranges

    def _ask_export(self, request: ExportRequest, sources: Sequence[str], error: str = "") -> None:
        """Ask for format, frames, source, a movie's options and the path. `error`: why the export was refused."""
        dialogs = self._dialogs
        form = Form(dialogs, request)
        options = dialogs.label(OPTIONS)

        def changed() -> None:
            lacks = request.kind == "usd" and find_spec("pxr") is None
            options.text, options.text_color = (NO_USD, color(BAD)) if lacks else (OPTIONS, color(DIM))
            form.widgets["line"].text_value = request.target
            form.widgets["frames"].enabled = request.kind not in WHOLE
            form.widgets["seconds"].enabled = request.kind == "turntable"
            form.widgets["size"].enabled = request.kind in SIZED
            form.widgets["background"].enabled = request.kind in MOVIES

        def start() -> None:
            try:
                if request.kind == "usd":
                    usd()  # refuses to begin without its package
                self._exports.start(request)
            except (StudioError, OSError) as refused:
                self._ask_export(request, sources, str(refused))
            else:
                self._kind = request.kind
                dialogs.close()

        def other_format() -> None:
            self._choose_frames(request)
            form.widgets["frames"].selected_text = request.frames
            changed()

        form.choice("format", "Format", [label for label, _ in FORMATS.values()], other_format)
        form.choice("frames", "Frames", list(request.ranges), changed)
        if sources:
            form.choice("of", "Splats", sources, changed)
        form.line("seconds", "Seconds")
        form.choice("size", "Size", MOVIE_SIZES)
        form.choice("background", "Background", list(MOVIE_BACKGROUNDS))
        form.output(lambda: self._ask_export(request, sources))
        changed()
        other = self._player.shown_other
        source = "Exports the splats decoded from the stream."
        if other is not None:
            source = f"Exports {other.label}, which is on screen."
        elif sources:
            stale = ", without the latest changes" if self._stale else ""
            source = f"decoded: as played from the stream{stale}.\ntrained: before baking, with all edits."
        parts = [form.grid, dialogs.label(source), options, dialogs.label("Existing files are not overwritten.")]
        form.show("export", "Export", parts, ("save", "Export", start), 90, error, "line")

    def report(self) -> None:
        """Write the take's report, or update its marks."""
        workspace, notices = self._workspace, self._notices
        context, take = workspace.context, workspace.take
        if take is None:
            notices.show("A report can only be written for a take, not for a stream.")
        elif context is None or not take.report.is_file() or workspace.row("review").state != State.DONE:
            workspace.start("review")
            self._views.select("review")
        else:
            with notices.reporting("report"):
                changed = update_marks(take, context.groups)
                words = "Updated the marks in the report" if changed else "The report is up to date"
                notices.show(f"{words}: {take.report}", path=take.report)
