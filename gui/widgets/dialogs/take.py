"""The dialog for a new take: footage, settings, folder, and what there is in the footage."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from open3d.visualization import gui

from v3studio.gui.drawing.canvas import Canvas, wrapped
from v3studio.gui.drawing.footage_sheet import FootageSheet
from v3studio.gui.drawing.palette import BAD, DIALOG, DIM
from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.widgets.dialogs.base import Dialogs, exactly
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.dialogs.form import Form
from v3studio.gui.widgets.picture import ImagePanel, color, lowered, put
from v3studio.gui.widgets.settings import PRESET
from v3studio.pipelines.config.presets import PRESETS
from v3studio.pipelines.new_take import CALIBRATE, Found, NewTake, uses_words
from v3studio.pipelines.takes.results.camera_uses import USES
from v3studio.studio.card import Measured, draw
from v3studio.studio.errors import Cancelled, StudioError

NAME = "new take"
FOUND_LINES = 6  # lines of the summary
TEXT_SIZE = 0.88  # of a font of `gui.drawing` that is as wide as that of the toolkit, em
SIZE = 58, 11, 27.7  # width and height of the image, and height of the rest of the dialog, em

HINT = "Click a camera to hold it out; again: not to use it. Drag across the frames to use some of them."

CHOOSE = Found("Choose the footage folder.")


class NewTakeDialog:
    """Asks for a new take. The footage is examined on a thread. `create`: called by "Create take"; the dialog stays."""

    def __init__(self, dialogs: Dialogs, create: Callable[[NewTake], None], changed: Callable[[], object]) -> None:
        self._dialogs, self._create, self._changed = dialogs, create, changed
        self._new, self._found = NewTake(), Found("")
        self._worker: LatestWorker[NewTake, Found] = LatestWorker(self._examine, "v3studio new take", self._examined)
        self._asked: NewTake | None = None
        self._judge: LatestWorker[NewTake, Measured | None] = LatestWorker(self._measure, "v3studio card", self._judged)
        self._card: tuple[str, np.ndarray] | None = None  # grades, and the image, once they are measured
        self._shows_card = False
        self._images: dict[tuple[int, ...], gui.UIImage] = {}  # of all openings
        self._words = ""
        self._anchor: int | None = None  # where a drag across the frames began

    def show(self, new: NewTake, error: str = "") -> None:
        """Show the dialog. `new`: modified while it is open. `error`: why creating it failed."""
        dialogs, em = self._dialogs, self._dialogs.em
        if new is not self._new:
            self._found, self._asked, self._card = Found(""), None, None
        self._new, self._anchor = new, None
        self._size = dialogs.fitting(*SIZE)
        form = Form(dialogs, new, gap=0.35)
        self._error = error
        for attribute, label, title, wanted in (
            ("footage", "Footage", "Footage folder", "folder"),
            ("settings", "Settings (optional)", "Settings file (YAML)", "file"),
            ("take", "Take", "Take folder", "folder"),
        ):
            edit = self._field(attribute)
            form.browsed(attribute, label, edit, attribute, self._browse(attribute, title, wanted))
        self._lists = {attribute: gui.Combobox() for attribute in new.unchosen()}
        for attribute, box in self._lists.items():
            box.set_on_selection_changed(lambda text, _number, attribute=attribute: self._chosen(attribute, text))
        fields = self._fields = {name: self._field(name) for name in ("fps", "frames")}
        fields["frames"].tooltip = "First and last frame, such as 60 to 83"
        lists = self._lists
        lists["preset"].tooltip = PRESET
        self._row(form, ("Footage files", lists["images"]), ("Camera file", lists["rig"]), ("Sound", lists["audio"]))
        self._row(form, ("Mask files", lists["masks"]), ("Clean plates", lists["plates"]), ("Preset", lists["preset"]))
        self._row(form, ("Frame rate (fps)", fields["fps"]), ("Frames", fields["frames"]))
        fields["take"] = form.widgets["take"]
        self._picture = ImagePanel(self._on_mouse, self._images)
        self._text = dialogs.label("")
        dialogs.made |= {"refused": self._text} if error else {}
        buttons = dialogs.row(
            ("suggested", "Hold out every eighth camera", lambda: self._use("suggested", "held out")),
            ("unmasked", "Exclude cameras without masks", lambda: self._use("unmasked", "not used")),
            ("every_frame", "All frames", lambda: self._set_frames("")),
            ("card", "Card", self._show_card),
        )
        grid = gui.Vert(0, gui.Margins(0, 0, 0, -2 * em))  # a grid asks for more height than it takes
        grid.add_child(form.grid)
        parts = [grid, self._picture.widget, buttons, self._text]
        self._update()  # before it is shown, as the dialog does not resize
        answers = [("create", "Create take", lambda: self._create(self._new)), ("close", "Cancel", self._close)]
        dialogs.show(NAME, "New take from footage", parts, answers, 110)
        dialogs.widgets |= form.widgets | self._fields | self._lists | {"sheet": self._picture.widget}
        dialogs.pictures, dialogs.parts["sheet"] = [self._picture], lambda: self._sheet.places
        dialogs.focus(form.widgets["footage"])
        if not error:
            self._look()

    def _row(self, form: Form, first: tuple[str, gui.Widget], *others: tuple[str, gui.Widget]) -> None:
        """A row with labeled fields, in columns of the same width in all rows."""
        em = self._dialogs.em
        row = gui.Horiz(round(0.6 * em))
        for (label, field), room in zip((first, *others), (0.0, 6.5, 4.0), strict=False):
            if room:  # the first label is that of the row, which would break others at spaces
                row.add_child(lowered(self._dialogs.label(label.replace(" ", "\u00a0")), room=room * em))
            column = gui.Vert()
            column.preferred_width = 10 * em  # of "as in the settings": a list keeps its width with wider items
            column.add_child(field)
            row.add_child(column)
        form.add(first[0], first[0], row)

    def _field(self, attribute: str) -> gui.TextEdit:
        edit = gui.TextEdit()
        edit.text_value = getattr(self._new, attribute)
        edit.set_on_text_changed(partial(self._type, attribute))
        edit.set_on_value_changed(lambda _text: self._look())
        return edit

    def _type(self, attribute: str, text: str) -> None:
        setattr(self._new, attribute, text)
        if self._found is CHOOSE and text.strip():  # what is typed has a file name at each letter
            self._found = Found("Enter examines it.")
            self._update()

    def _browse(self, attribute: str, title: str, wanted: str) -> Callable[[], None]:
        new = self._new

        def done(path: str) -> None:
            setattr(new, attribute, path)
            self.show(new)

        def browse() -> None:
            typed = getattr(new, attribute).strip() or new.footage.strip()
            start = Path(typed) if typed else self._dialogs.usual_folder()
            endings = (".yaml", ".yml") if wanted == "file" else ()
            ask_path(self._dialogs, title, start, wanted, done, lambda: self.show(new), endings)

        return browse

    def _chosen(self, attribute: str, text: str) -> None:
        chosen = "" if text == self._new.unchosen()[attribute] else text
        if chosen != getattr(self._new, attribute):
            setattr(self._new, attribute, chosen)
            self._look()

    # Examining

    def _look(self) -> None:
        """Examine the footage, unless it is what was examined last."""
        self._error = ""  # it was about what was typed before
        self._dialogs.widgets.pop("refused", None)
        wanted = replace(self._new, take="", frames="", preset="", uses=None)
        if self._asked is not None and (self._asked.footage, self._asked.settings) != (wanted.footage, wanted.settings):
            self._new.uses = None
            for attribute in self._lists:
                setattr(self._new, attribute, "")
                setattr(wanted, attribute, "")
        if wanted != self._asked:
            self._asked, self._card, self._shows_card = wanted, None, False
            if not wanted.footage.strip() and not wanted.settings.strip():
                self._found = CHOOSE
            else:
                self._found, self._words = Found(""), "Examining the footage ..."
                self._worker.ask(wanted)
        self._update()

    def _examine(self, wanted: NewTake) -> Found:
        def progress(done: int, total: int, **_figures: object) -> None:
            if self._asked is not wanted or self._worker.closed:
                raise Cancelled
            LOOP.post(lambda: self._tell(wanted, done, total))

        return wanted.found(progress)

    def _tell(self, wanted: NewTake, done: int, total: int) -> None:
        if self._asked is wanted and self._dialogs.name == NAME:
            self._words = f"Examining the footage: {done / max(total, 1):.0%}"
            self._update()

    def _examined(self, done: Done[NewTake, Found]) -> None:
        if done.request is not self._asked:
            return
        self._found, self._words = done.result or Found(f"The footage cannot be examined: {done.error!r}"), ""
        if self._found.inspection.cameras and not self._found.inspection.problems:
            self._judge.ask(done.request)
        if self._dialogs.name == NAME:
            self._update()

    def _measure(self, wanted: NewTake) -> Measured | None:
        def progress(*_: object, **_figures: object) -> None:
            if self._asked is not wanted or self._judge.closed:
                raise Cancelled

        return wanted.measured(progress)

    def _judged(self, done: Done[NewTake, Measured | None]) -> None:
        if done.request is self._asked and done.result is not None:  # the list of files says why it cannot be read
            self._card = f"Card: {done.result.card.grades}.", draw(done.result)
            if self._dialogs.name == NAME:
                self._update()

    def _show_card(self) -> None:
        self._shows_card = not self._shows_card
        self._update()

    def _update(self) -> None:
        """Show what is known."""
        new, facts, dialogs = self._new, self._found, self._dialogs
        inspection, widgets = facts.inspection, dialogs.widgets | dialogs.made
        words = self._error or facts.words
        if facts.uses and not self._error:
            card = f"{self._card[0]}\n" if self._card is not None else ""
            words = f"{uses_words(new.uses or facts.uses)}. {HINT}\n{card}{words_beside(facts)}"
        size, wide = round(TEXT_SIZE * dialogs.em), self._size[0]
        lines = [line for part in words.splitlines() for line in wrapped(part, size, wide)]
        self._text.text_color = color(BAD if self._error else DIM)
        self._text.text = exactly(lines, FOUND_LINES)  # the dialog must keep its size
        rate = self._fields["fps"]
        rate.enabled = facts.fps is None
        if facts.fps is not None:
            new.fps = ""
        put(rate, text_value=new.fps if facts.fps is None else f"{facts.fps:g}")  # it may be edited
        rate.placeholder_text = "30, if nothing is typed" if new.footage or new.settings else ""
        rate.tooltip = "From the files or the settings" if facts.fps is not None else "The files do not say it"
        ends = dict.fromkeys((*inspection.frames[:1], *inspection.frames[-1:]))
        self._fields["frames"].placeholder_text = " to ".join(map(str, ends))
        if not new.take:
            self._fields["take"].placeholder_text = new.proposed_take() or "a new folder"
        there = {
            "images": facts.images, "rig": (*inspection.rigs, CALIBRATE), "masks": inspection.masks,
            "plates": inspection.plates, "audio": inspection.sounds, "preset": PRESETS,
        }  # fmt: skip
        for attribute, usual in new.unchosen().items():
            kept = getattr(new, attribute) or usual
            _set_items(self._lists[attribute], list(dict.fromkeys((usual, *there[attribute], kept))), kept)
        uses = new.uses or facts.uses
        dialogs.lines = [f"{name}: {use}" for name, use in uses.items()]
        widgets["suggested"].enabled = bool(inspection.suggested) and "held out" not in uses.values()
        widgets["unmasked"].enabled = any(uses[name] == "training" for name in inspection.unmasked)
        widgets["every_frame"].enabled = new.frames != ""
        widgets["card"].enabled = self._card is not None
        if self._card is not None and self._shows_card:
            canvas = Canvas(*self._size, DIALOG)
            canvas.fit_image(0, 0, *self._size, self._card[1])
            self._picture.show(canvas.pixels)
        else:
            self._picture.show(self._sheet.draw())
        dialogs.lay_out()
        self._changed()

    @property
    def _sheet(self) -> FootageSheet:
        inspection, frames = self._found.inspection, self._found.inspection.frames
        try:
            span = self._new.span()
        except StudioError:
            span = None
        words = self._words or ("" if inspection.cameras else " ")
        uses = self._new.uses or self._found.uses
        span = span or ((frames[0], frames[-1]) if frames else (0, 0))
        return FootageSheet(self._size, self._dialogs.em, inspection, uses, span, words)

    # Choosing in the image

    def _use(self, which: str, use: str) -> None:
        cameras, uses = getattr(self._found.inspection, which), self._new.uses or self._found.uses
        self._new.uses = {**uses, **{name: use for name in cameras if uses[name] == "training"}}
        self._update()

    def _set_frames(self, text: str) -> None:
        self._new.frames = self._fields["frames"].text_value = text
        self._update()

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        if self._shows_card:
            return False
        kind, sheet = gui.MouseEvent.Type, self._sheet
        frame = sheet.frame_at(x, y)
        if event.type == kind.BUTTON_DOWN:
            camera = sheet.camera_at(x, y)
            self._anchor = frame
            if camera:
                uses = self._new.uses or self._found.uses
                self._new.uses = {**uses, camera: USES[(USES.index(uses[camera]) + 1) % len(USES)]}
                self._update()
        elif event.type == kind.DRAG and self._anchor is not None and frame is not None and frame != self._anchor:
            self._set_frames(f"{min(self._anchor, frame)} to {max(self._anchor, frame)}")
        return event.type in (kind.BUTTON_DOWN, kind.BUTTON_UP, kind.DRAG)

    def _close(self) -> None:
        self._asked = None
        self._dialogs.close()


def words_beside(facts: Found) -> str:
    """The facts about footage besides the choices, which the image and the fields show and may change."""
    return " ".join(line for line in facts.words.splitlines() if line not in facts.inspection.choices)


def _set_items(box: gui.Combobox, items: Sequence[str], chosen: str) -> None:
    if [box.get_item(index) for index in range(box.number_of_items)] != list(items):
        box.clear_items()
        for item in items:
            box.add_item(item)
    if box.selected_text != chosen:
        box.selected_text = chosen
