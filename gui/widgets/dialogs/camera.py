"""A dialog with all cameras: which of them are used, and which are held out."""

from collections.abc import Callable, Mapping

from open3d.visualization import gui

from v3studio.gui.models.held_out import held_out_first
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.form import refusal
from v3studio.gui.widgets.picture import lowered

ROWS, COLUMNS = 17, 2  # of a page of cameras


def ask_cameras(
    dialogs: Dialogs, uses: Mapping[str, str], save: Callable[[Mapping[str, str]], str], error: str = "", page: int = 0
) -> None:
    """Ask for the use of every camera. `save`: called with the new uses; returns why they are refused, else ""."""
    em = dialogs.em
    chosen = dict(uses)
    boxes: dict[str, tuple[gui.Checkbox, gui.Checkbox]] = {}

    def ticked(camera: str, use: str) -> None:
        chosen[camera] = use
        used, held_out = boxes[camera]
        used.checked, held_out.checked = use != "not used", use == "held out"

    names = held_out_first(uses, [name for name, use in uses.items() if use == "held out"])
    pages = -(-len(names) // (ROWS * COLUMNS))
    here = names[page * ROWS * COLUMNS :][: ROWS * COLUMNS]
    count = -(-len(here) // ROWS)
    # columns, since a grid of the toolkit asks for almost twice its height and breaks titles
    heads = ("camera", "use", "hold\u00a0out")
    columns = [gui.Vert(round(0.25 * em)) for _ in range(len(heads) * count)]
    for column, head in zip(columns, heads * count, strict=True):
        column.add_child(dialogs.label(head))
    for row in range(min(ROWS, len(here))):
        for block, name in enumerate(here[row::ROWS]):
            used, held_out = gui.Checkbox(""), gui.Checkbox("")
            used.tooltip = "Use this camera at all"
            held_out.tooltip = "Do not train on this camera; evaluate with it"
            used.checked, held_out.checked = uses[name] != "not used", uses[name] == "held out"
            used.set_on_checked(lambda on, name=name: ticked(name, "training" if on else "not used"))
            held_out.set_on_checked(lambda on, name=name: ticked(name, "held out" if on else "training"))
            boxes[name] = (used, held_out)
            dialogs.made |= {f"use {name}": used, f"hold out {name}": held_out}
            cells = [lowered(dialogs.label(name, dim=False)), used, held_out]
            for column, widget in zip(columns[len(heads) * block :], cells, strict=False):
                column.add_child(widget)
    table = gui.Horiz(round(0.5 * em))
    for column in columns:
        table.add_child(column)
    table.add_stretch()
    words = "Training uses the cameras that are not held out; held-out cameras measure quality."
    parts = [refusal(error) if error else dialogs.label(words), table]

    def done() -> None:
        refused = save(chosen)
        if refused:
            ask_cameras(dialogs, chosen, save, refused, page)
        else:
            dialogs.close()

    def turn() -> None:
        ask_cameras(dialogs, chosen, save, page=(page + 1) % pages)

    answers = [("save", "Save", done), ("close", "Cancel", dialogs.close)]
    if pages > 1:
        answers.insert(1, ("page", f"Next page ({page + 1} of {pages})", turn))
    dialogs.show("cameras", "Cameras", parts, answers, 90, done)
