"""NewTake: creates a take from a folder of footage."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.config import Config, dump_config, load_config
from v3studio.pipelines.config.presets import PRESETS, preset_here, with_values
from v3studio.pipelines.inspection import Inspection, inspect, with_camera_file
from v3studio.pipelines.takes.authored.drawn_masks import for_another_take
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.results.camera_uses import USES, camera_uses, settings_of_uses
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import write_text
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import open_footage
from v3studio.studio.progress import ProgressFn
from v3studio.studio.storage import is_address

if TYPE_CHECKING:
    from v3studio.studio.card import Measured

MOST_FPS = 10_000  # limit of `capture.fps`
CALIBRATE = "none: calibrate from the footage"  # A choice of camera file besides those that were found


@dataclass(frozen=True)
class Found:
    """The footage of a new take, as far as it is known."""

    words: str
    # frames per second that the files or the settings give; None if neither does, so that it may be typed
    fps: float | None = None
    inspection: Inspection = field(default_factory=Inspection)  # what was found; empty if the footage cannot be opened
    images: tuple[str, ...] = ()  # patterns of the footage to choose from; empty if there is only one
    uses: Mapping[str, str] = field(default_factory=dict)  # what the settings use each camera for, of `USES`


@dataclass
class NewTake:
    """A new take as specified in the dialog; text as typed."""

    footage: str = ""  # footage folder or its address in object storage; may be empty if the settings name it
    settings: str = ""  # YAML file with settings; empty for the preset for this machine
    take: str = ""  # folder of the new take; empty for `proposed_take`
    fps: str = ""  # frames per second, where the footage gives none; empty for that of the settings
    images: str = ""  # pattern of the footage; here and below "" is what the settings say
    rig: str = ""  # calibration file
    masks: str = ""  # masks, plates: patterns of mask files and clean plates
    plates: str = ""
    audio: str = ""  # sound file
    preset: str = ""  # one of `PRESETS`; "" without settings is that for this machine
    frames: str = ""  # "60 to 83"; empty for those of the settings
    uses: Mapping[str, str] | None = None  # what each camera is used for; None: as the settings say

    def unchosen(self) -> dict[str, str]:
        """Words that lists show for "", nothing chosen, by attribute."""
        given = "as in the settings" if self.settings.strip() else ""
        own = dict.fromkeys(("images", "rig", "masks", "plates"), "found automatically")
        return {**own, "audio": given or "none", "preset": given or preset_here()}

    def config(self) -> Config:
        """The initial settings of the take; StudioError: `take.no_footage`, `take.bad_rate`, `take.bad_frames`,
        `footage.no_folder`, no camera is left to train on, or settings that cannot be read."""
        settings: dict[str, Any] = {}
        rate, span = self._rate(), self.span()
        if rate is not None:
            settings["capture.fps"] = rate
        if span is not None:
            settings["capture.frames"] = f"{span[0]}:{span[1] + 1}"
        config = self._chosen()
        if self.uses is not None:
            settings |= settings_of_uses(self.uses, config.capture)
        return with_values(config, settings) if settings else config

    def span(self) -> tuple[int, int] | None:
        """First and last frame, as typed; None for those of the settings. Raises StudioError (`take.bad_frames`)."""
        typed = self.frames.strip()
        span = typed_span(typed)
        if typed and span is None:
            fix = "Type the first and the last one, such as 60 to 83."
            raise StudioError("take.bad_frames", f"'{typed}' is not a range of frames", value=typed, fix=fix)
        return span

    def _rate(self) -> float | None:
        """Frames per second, as typed."""
        typed = self.fps.strip()
        if not typed:
            return None
        try:
            rate = float(typed)
        except ValueError:
            rate = 0.0
        if not 0 < rate < MOST_FPS:
            fix = f"Type frames per second above 0 and below {MOST_FPS}, such as 25."
            raise StudioError("take.bad_rate", f"'{typed}' is not a frame rate", value=typed, fix=fix)
        return rate

    def _chosen(self) -> Config:
        """The settings without frame rate, frames, and uses of cameras."""
        if not self.footage.strip() and not self.settings.strip():
            raise StudioError("take.no_footage", "no footage selected", fix="Choose the footage folder.")
        overrides: list[tuple[str, object]] = []
        if self.footage.strip():
            overrides.append(("capture.root", _footage_folder(self.footage.strip())))
        names = {"images": "images", "rig": "rig", "masks": "mask_files", "plates": "clean_plates", "audio": "audio"}
        for attribute, name in names.items():
            if value := getattr(self, attribute):
                overrides.append((f"capture.{name}", None if value == CALIBRATE else value))
        if self.plates and not self.masks:  # else the masks are used
            overrides.append(("capture.masks", ("clean_plate", "model")))
        path = Path(self.settings.strip()).expanduser() if self.settings.strip() else None
        preset = self.preset or (preset_here() if path is None else "")
        return for_another_take(load_config(path, [*overrides, *PRESETS.get(preset, {}).items()]), path)

    def found(self, progress: ProgressFn | None = None) -> Found:
        """Look at the footage: what it has, or why it cannot be read; `progress` as for `inspect`."""
        try:
            config = replace(self, uses=None, frames="").config()  # what there is to choose from
            inspection = inspect(config.capture, progress)
            uses = camera_uses(config.capture)
        except StudioError as error:
            images = tuple(error.value) if error.code == "footage.ambiguous_layout" else ()
            return Found(str(error), images=images)
        problems = inspection.problems
        more = f"{counted(len(problems), 'problem')}: {problems[0]}\n" if problems else ""
        given = (None if self.fps.strip() else config.capture.fps) or inspection.filmed_fps  # as `open_footage`
        uses |= {name: "not used" for name in inspection.cameras if name not in inspection.used}
        return Found(more + "\n".join(inspection.lines), given, inspection, uses=uses)

    def measured(self, progress: ProgressFn) -> Measured | None:
        """The card of the footage, without masks that would have to be computed; None for footage that would have to be
        copied. Raises StudioError: it cannot be read."""
        from v3studio.studio.card import measure

        capture = replace(self, uses=None, frames="").config().capture
        if is_address(capture.root):
            return None
        with closing(open_footage(capture, None, strict=False)) as opened, closing(with_camera_file(opened)) as footage:
            return measure(footage, progress, computed=False)

    def proposed_take(self) -> str:
        """Path of a new folder next to the footage, or in the home folder if none can be made there; in the working
        directory if the footage is in object storage."""
        try:
            root = self._chosen().capture.root
        except StudioError:
            return ""
        parent = Path.cwd() if is_address(root) else root.parent
        if not os.access(parent, os.W_OK):
            parent = Path.home()
        for number in range(1, 1000):
            path = parent / f"{root.name}-take{'' if number == 1 else f'-{number}'}"
            if not path.exists():
                return str(path)
        return ""

    def create(self) -> Path:
        """Create the take's folder and its settings; return the folder."""
        config = self.config()
        open_footage(config.capture, None, strict=False).close()
        where = self.take.strip() or self.proposed_take()
        if not where:
            raise StudioError("take.no_folder", "no take folder selected", fix="Choose a folder for the take.")
        if is_address(where):
            fix = "Choose one; several machines can share it (docs/guides/cluster.md)."
            raise StudioError("take.no_folder", "a new take needs a folder on this machine", fix=fix)
        root = Path(where).expanduser().absolute()
        if (root / "take.json").exists():
            raise StudioError("take.exists", "already a take", file=root, fix="Open it, or choose another folder.")
        with disk_errors(root):
            take = Take.create(root)
            write_text(take.config, dump_config(config))
        return take.root


def uses_words(uses: Mapping[str, str]) -> str:
    """The number of cameras by their use."""
    counts = {use: list(uses.values()).count(use) for use in USES}
    train = counts.pop("training")
    return ", ".join(
        [f"{counted(train, 'camera')} for training", *(f"{count} {use}" for use, count in counts.items() if count)]
    )


def typed_span(typed: str) -> tuple[int, int] | None:
    """The first and last frame of a typed range: "60 to 83", "60-83" or "60"; None for other text."""
    parts = re.fullmatch(r"(\d{1,8})(?:\s*(?:to|-)\s*(\d{1,8}))?", typed)
    first, last = (int(parts[1]), int(parts[2] or parts[1])) if parts else (1, 0)
    return (first, last) if first <= last else None


def _footage_folder(typed: str) -> str:
    if is_address(typed):
        return typed
    folder = Path(typed).expanduser().absolute()
    if not folder.is_dir():
        raise StudioError("footage.no_folder", "no such folder", file=folder, fix="Choose the footage folder.")
    return str(folder)


def sample_settings() -> Path | None:
    """Settings of the sample capture, which comes with the source; None if it is neither where this program is nor in
    the working directory."""
    for folder in (Path(__file__).parents[1], Path.cwd()):
        settings = folder / "sample_configs" / "demo.yaml"
        if settings.is_file() and (folder / "sample_captures" / "dance16").is_dir():
            return settings
    return None


def make_sample_take() -> tuple[Path, bool]:
    """Create the take, unless it is there. Returns its folder, and whether it is new."""
    take = Path.home() / "v3studio-takes" / "sample-take"
    if (take / "take.json").is_file():
        return take, False
    settings = sample_settings()
    if settings is None:
        problem = "the sample capture is not there: only the source of V3 Studio has it"
        fix = "Start the window from a copy of the source, or use your own footage."
        raise StudioError("take.no_sample", problem, fix=fix)
    return NewTake(settings=str(settings), take=str(take)).create(), True
