"""The menu Mark and its keys."""

import math
from functools import partial

import numpy as np

from v3studio.gui.drawing.compare import Mode
from v3studio.gui.models.history import Change
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.pipelines.takes.authored.marks import Mark, MarkView

NO_MARKS = "No frame is marked. Press M to mark the frame on screen."


class MarkActions:
    """Marks frames, and goes to those that are marked."""

    def __init__(
        self, player: PlayerPresenter, marks: Marks, workspace: Workspace, dialogs: Dialogs, notices: Notices
    ) -> None:
        self._player, self.marks, self._workspace = player, marks, workspace
        self._dialogs, self._notices = dialogs, notices

    def ask(self) -> None:
        """Ask for a note on the frame on screen, and mark it."""
        transport = self._player.transport
        if self._player.opened is None:
            return
        transport.pause()
        frame = transport.number(transport.frame)
        known = self.marks.marks.get(frame)
        where = "" if self.marks.kept else ". Marks on a stream are lost when it is closed."
        mark = ("save", "Mark", lambda note: self._change(frame, note, known))
        remove = ("remove", "Remove mark", lambda _: self._change(frame, None, known))
        answers, note = ((mark,), "") if known is None else ((mark, remove), known.note)
        self._dialogs.line("mark", f"Mark frame {frame}", f"Note (optional){where}", note, *answers)

    def _change(self, frame: int, note: str | None, known: Mark | None) -> None:
        """Mark a frame, or remove its mark (None); noted for undo."""
        marks = self.marks
        with self._notices.reporting("marks"):  # such as somebody else's change, which is not to be undone here
            if note is None:
                marks.put(frame, None, known)
            elif not marks.set(frame, note, known, view_of(self._player)):
                return
            now = marks.marks.get(frame)
            undo, redo = partial(marks.put, frame, known, now), partial(marks.put, frame, now, known)
            self._workspace.history.add(Change(f"the mark of frame {frame}", undo, redo))

    def go_to_next(self, direction: int) -> None:
        """Go to the next (1) or previous (-1) mark, and to its view."""
        transport = self._player.transport
        frame = self.marks.next_after(transport.number(transport.frame), direction)
        if frame is not None:
            self._go_to(frame)

    def show(self) -> None:
        """Show the list of marks; choosing one goes to its frame and view."""
        lines = {f"frame {frame}: {note or '(no note)'}": frame for frame, note in sorted(self.marks.notes.items())}
        self._dialogs.choose("marks", "Marks", list(lines), lambda line: self._go_to(lines[line]), nothing=NO_MARKS)

    def _go_to(self, frame: int) -> None:
        """Go to a mark's frame, and to its view if it has one."""
        player, mark = self._player, self.marks.marks.get(frame)
        index = player.transport.numbers.index(frame)
        if index is None:
            self._notices.show(f"The take does not have frame {frame}.", topic="marks")
            return
        player.transport.pause()
        player.transport.seek(index)
        if mark is not None and mark.view is not None:
            show_view(player, mark.view)


def view_of(player: PlayerPresenter) -> MarkView:
    """The view and the comparison on screen."""
    orbit = player.orbit
    eye, target = ((float(x), float(y), float(z)) for x, y, z in (orbit.eye, orbit.target))
    return MarkView(
        eye=eye,
        target=target,
        fov=math.degrees(orbit.fov),
        camera=player.camera,
        wipe=player.wipe if player.camera and player.mode == Mode.WIPE else None,
        whole=player.image_zoom == ImageZoom(),
    )


def show_view(player: PlayerPresenter, view: MarkView) -> None:
    """Show the view of a mark, with a wipe if it was made in one; another comparison on screen stays. Without the
    take's cameras, this is the view from the same place."""
    if view.camera not in player.camera_names:
        player.look_through("")
        up = player.orbit.up
        player.orbit = OrbitCamera.from_to(np.array(view.eye), np.array(view.target), up, math.radians(view.fov))
        return
    player.look_through(view.camera)
    if view.wipe is None:
        if player.mode in (Mode.WIPE, Mode.SCENE):
            player.choose_mode(Mode.SINGLE)
    elif player.choose_mode(Mode.WIPE):
        player.wipe = view.wipe
    if view.whole == (player.image_zoom != ImageZoom()):
        player.zoom_to_performer()
