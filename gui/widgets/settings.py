"""The settings of a stage under headings: presets, search, what differs from the preset, and a field for each."""

import textwrap
from collections.abc import Callable
from dataclasses import dataclass

from open3d.visualization import gui

from v3studio.gui.drawing.palette import ACCENT, DIM, FAIR, PANEL
from v3studio.gui.models.take.estimates import Estimates
from v3studio.gui.models.take.setting_words import FILES, FOLDERS, TEMPLATES
from v3studio.gui.models.take.settings import FieldKind, SettingField, fields_of, matching
from v3studio.gui.widgets.picture import NOTHING, color, holds, lowered, make_label, text_room
from v3studio.gui.widgets.setting_editors import Editor, make_editor, small_button
from v3studio.pipelines.config import Config
from v3studio.pipelines.config.presets import PRESETS, differing, preset_of

PRESET_STAGES = ("initialize", "train")  # stages that presets set

WIDEST_BESIDE = 6.5
"""Widest choice in a list beside its label, em; one with wider ones is below it, as paths and lists of values are."""

MOST_LABEL = 8.0  # widest label beside a field, em

ABOVE_HEADING, BELOW_HEADING = 0.6, 0.3
"""How much farther a heading is from the fields above it, and nearer to those below, than a field would be, em."""

PRESET = "Preset: a schedule of training with a size of the stream, for Initialize and Train"
FILTER = "Show settings whose name, heading or documentation contains all of these words"


@dataclass(frozen=True)
class SettingActions:
    """The requests of the panel. `estimate`: measures the presets."""

    set_value: Callable[[SettingField, str], None]
    reset: Callable[[list[str]], None]
    choose: Callable[[str], None]
    pick: Callable[[SettingField], None]
    estimate: Callable[[], None]
    changed: Callable[[], None]


class SettingsList:
    """The settings of a stage. `edited`: the last press was on the fields, so that letters are meant for them.
    `camera_file`: name of the calibration file that is used; "" if there is none."""

    def __init__(self, stage: str, em: float, actions: SettingActions, estimates: Estimates) -> None:
        self._em, self._actions, self._estimates = em, actions, estimates
        self._fields = fields_of(stage)
        self._has_presets = stage in PRESET_STAGES
        self._rows: dict[str, tuple[SettingField, Editor, gui.Label, gui.Checkbox]] = {}
        self._words: tuple[str, bool, str] | None = None
        self._stage, self.camera_file = stage, ""
        self._typed = ""
        self._differing: list[str] = []
        self.edited = False
        self.widget = gui.Widget()
        self.widget.background_color = color(PANEL)
        self.preset = gui.Combobox()
        self.preset.tooltip = PRESET
        for name in PRESETS:
            self.preset.add_item(name)
        self.preset.set_on_selection_changed(lambda _, number: actions.choose(list(PRESETS)[number]))
        words = "Measure how long the presets take for this footage on this machine: about a minute, on all cores"
        self.estimate = small_button("Estimate", words, actions.estimate, actions.changed)
        self.summary = gui.Label(" " * 60)
        self.reset_all = small_button("Reset", "", lambda: actions.reset(list(self._differing)), actions.changed)
        self.filter = gui.TextEdit()
        self.filter.placeholder_text = "search settings"
        self.filter.tooltip = FILTER
        self.filter.set_on_text_changed(self._type)
        self.all = gui.Checkbox("all")
        self.all.tooltip = "Also show settings that few people need"
        self.all.set_on_checked(lambda _: actions.changed())
        self._scroll = gui.ScrollableVert(0, gui.Margins(0.6 * em, 0.2 * em, 1.2 * em, 0.4 * em))
        self._scroll.background_color = NOTHING
        self._content = gui.WidgetProxy()
        self._scroll.add_child(self._content)
        heads = (self.preset, self.estimate) if self._has_presets else ()
        for widget in (*heads, self.summary, self.reset_all, self.filter, self.all, self._scroll):
            self.widget.add_child(widget)
        self.refilter()

    @property
    def editors(self) -> dict[str, tuple[SettingField, gui.Widget]]:
        """The fields on screen, by name of the setting."""
        return {name: (field, editor.widget) for name, (field, editor, _, _) in self._rows.items()}

    @property
    def widgets(self) -> dict[str, gui.Widget]:
        """The widgets besides the fields that can be pressed, by name."""
        heads = {"preset": self.preset, "estimate": self.estimate} if self._has_presets else {}
        widgets = {**heads, "all settings": self.all, "reset settings": self.reset_all}
        for name, (_, editor, _, reset) in self._rows.items():
            widgets |= {f"{key} {name}": button for key, button in {**editor.buttons, "reset": reset}.items()}
        return widgets

    @property
    def lists(self) -> list[gui.Widget]:
        """The widgets on which a click may open a list: all rows if any has one, as their scrolling is not known."""
        rows = any(isinstance(row[1].widget, gui.Combobox) for row in self._rows.values())
        heads = [self.preset] if self._has_presets else []
        return [*heads, *([self._scroll] if rows else [])] if self.widget.visible else []

    def press(self, x: int, y: int) -> None:
        """The left button is pressed at a position in the window, pixels. The toolkit shows the tooltip of a field that
        is being edited wherever the pointer is, so such a field has none; nor have those above and below it, as it is
        not known how far they are scrolled. Their labels keep theirs."""
        self.filter.tooltip = "" if holds(self.filter, x, y) else FILTER
        edited = self.widget.visible and holds(self._scroll, x, y)
        self.edited = edited or (self.widget.visible and holds(self.filter, x, y))
        for _, editor, label, _ in self._rows.values():
            if isinstance(editor.widget, gui.TextEdit):
                editor.widget.tooltip = "" if edited else label.tooltip

    def find(self, name: str) -> None:
        """Filter for one setting; call `refilter` afterwards."""
        self.filter.text_value = self._typed = name

    def _type(self, text: str) -> None:
        self._typed = text
        self._actions.changed()

    def place(self, x: float, y: float, width: float, height: float, context: gui.LayoutContext) -> None:
        """Set the panel's rectangle in window pixels."""
        em = self._em
        left, top, wide = int(x), int(y), int(width)
        bottom = int(y + height)  # whole pixels: a child one pixel too high adds a scroll bar
        self.widget.frame = gui.Rect(left, top, wide, bottom - top)
        line, gap, edge = int(1.4 * em), int(0.3 * em), int(0.6 * em)
        inner = wide - 2 * edge

        def row(main: gui.Widget, side: gui.Widget) -> None:
            nonlocal top
            small = side.calc_preferred_size(context, gui.Widget.Constraints()).width
            main.frame = gui.Rect(left + edge, top, inner - small - gap, line)
            side.frame = gui.Rect(left + edge + inner - small, top, small, line)
            top += line + gap

        top += gap
        if self._has_presets:
            row(self.preset, self.estimate)
        self.summary.visible = bool(self.summary.text.strip())
        if self.summary.visible:
            row(self.summary, self.reset_all)
        row(self.filter, self.all)
        self._scroll.frame = gui.Rect(left, top, wide, max(bottom - top, 1))

    def refilter(self) -> bool:
        """Apply the filter; return whether the list has changed, which requires `show` and a new layout. Deferred to
        the next tick, because the toolkit reports typing while it draws the window."""
        words = (self._typed, self.all.checked, self.camera_file)
        if self._words == words:
            return False
        self._words = words
        self._rows.clear()
        rows = gui.Vert(round(0.25 * self._em))
        heading = ""
        fields = matching(self._fields, self._typed)
        if not self._typed.strip() and not self.all.checked:
            hidden = self._stage == "calibrate" and self.camera_file
            fields = [field for field in fields if field.basic and not hidden]
        beside = [text_room(field.label, self._em) for field in fields if not _below(field, self._em)]
        room = max(beside, default=0.0)
        for field in fields:
            if field.heading != heading:
                heading = field.heading
                title = make_label("\n".join(textwrap.wrap(heading, 32)), ACCENT)
                # nearer to its own fields than to those above
                above = round(ABOVE_HEADING * self._em) if self._rows else 0
                near = gui.Vert(0, gui.Margins(0, above, 0, -round(BELOW_HEADING * self._em)))
                near.add_child(title)
                rows.add_child(near)
            self._add(rows, field, round(room + 0.5 * self._em))
        if not fields:
            given = f"Cameras from {self.camera_file}.\nTo calibrate instead, set the\ncamera file in Capture to none."
            given = given if self.camera_file and not self._typed.strip() else "No matching settings."
            rows.add_child(gui.Label(given))
        self._content.set_widget(rows)
        return True

    def _add(self, rows: gui.Vert, field: SettingField, room: int) -> None:
        """A row: label in a column of `room` pixels, or above the field; field; tick that resets it."""
        em = self._em
        label = gui.Label(field.label.replace(" ", "\u00a0"))
        lines = textwrap.wrap(field.documentation, 70)  # the toolkit shows one line otherwise
        label.tooltip = "\n".join([*lines, f"Messages call it {field.name}."])
        head = lowered(label)
        editor = make_editor(field, self._actions.set_value, self._actions.pick)
        if not self.edited or not isinstance(editor.widget, gui.TextEdit):
            editor.widget.tooltip = label.tooltip
        reset = gui.Checkbox("")  # as high as the other fields
        reset.set_on_checked(lambda _: self._actions.reset([field.name]))
        reset.visible = False
        row = gui.Horiz(round(0.25 * em))
        if _below(field, em):
            rows.add_child(head)
        else:
            head.preferred_width = room
            row.add_child(head)
        for widget in (editor.widget, *editor.buttons.values()):
            row.add_child(widget)
        if not editor.grows:
            row.add_stretch()
        column = gui.Vert()  # keeps its width when the tick is hidden, so that the fields are in line
        column.preferred_width = round(1.5 * em)
        column.add_child(reset)
        row.add_child(column)
        rows.add_child(row)
        self._rows[field.name] = (field, editor, label, reset)

    def show(self, config: Config) -> None:
        """Show the values of the settings, and what differs from the preset."""
        preset = preset_of(config)
        usual = differing(config, preset)
        names = {field.name for field in self._fields}
        self._differing = [name for name in usual if name in names]
        for name, (field, editor, label, reset) in self._rows.items():
            editor.show(field.shown(config))
            label.text_color = color(FAIR if name in usual else DIM)
            reset.visible = reset.checked = name in usual
            reset.tooltip = f"Changed: untick to set it as in the preset {preset}"
        count = len(self._differing)
        usual_words = preset if self._has_presets else "the default" + "s" * (count > 1)
        if count:
            self.summary.text = f"{count} changed from {usual_words}"
        else:
            self.summary.text = "for Initialize and Train" if self._has_presets else ""
        self.summary.text_color = color(FAIR if count else DIM)
        self.reset_all.visible = count > 0
        self.reset_all.tooltip = f"Set them as in the preset {preset}"
        self.preset.selected_index = list(PRESETS).index(preset)

    def show_estimates(self) -> None:
        """Show what is known about the presets."""
        chosen = self.preset.selected_index
        for number, name in enumerate(PRESETS):
            self.preset.change_item(number, self._estimates.words(name))
        self.preset.selected_index = chosen


def _below(field: SettingField, em: float) -> bool:
    """Whether a field is below its label, as one of them needs more room."""
    if text_room(field.label, em) > MOST_LABEL * em:
        return True
    if field.kind == FieldKind.CHOICE:
        return max(text_room(choice, em) for choice in field.choices) > WIDEST_BESIDE * em
    return field.name in FOLDERS | FILES | TEMPLATES or bool(field.kind_of_list)
