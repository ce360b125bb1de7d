"""The table of writers, one per format of `v3studio export`."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from v3studio.pipelines.export.rendered import PathMovie, Plates, Turntable
from v3studio.pipelines.export.source import Source
from v3studio.pipelines.export.splats import SplatFiles, StreamFile, Usd, VideoGs
from v3studio.pipelines.export.writer import Writer, wrong_option
from v3studio.studio.formats import EXPORTS

WRITERS: dict[str, type[Writer]] = {
    **{name: SplatFiles for name, form in EXPORTS.items() if form.holds == "frame"},
    "videogs": VideoGs,
    "usd": Usd,
    "v3": StreamFile,
    "turntable": Turntable,
    "camera-path": PathMovie,
    "exr": Plates,
}

_COMMON = {field.name for field in fields(Writer)}
_OF_WRITERS = {field.name for kind in WRITERS.values() for field in fields(kind)} - _COMMON
OPTIONS = tuple(sorted(_OF_WRITERS | {name for form in EXPORTS.values() for name in form.arguments}))
"""Names of the options that some format takes."""


def writer_of(name: str, source: Source, out: Path, overwrite: bool, options: Mapping[str, Any]) -> Writer:
    """The writer of the format `name` with the options that were given, by their names as fields. StudioError
    (`command.invalid_option`): one that the format does not take, or needs."""
    form, kind = EXPORTS[name], WRITERS[name]
    known = {field.name: field for field in fields(kind) if field.name not in _COMMON}
    for option, value in options.items():
        if option not in known and option not in form.arguments:
            words = _words(option)
            raise wrong_option(words, f"--format {name} does not take {words}", f"Remove {words}.", value)
    for option, field in known.items():
        if field.default is MISSING and option not in options:
            words = _words(option)
            raise wrong_option(words, f"--format {name} needs {words}", f"Add {words}.")
    of_writer = {option: value for option, value in options.items() if option in known}
    of_format = {form.arguments[option].keyword: value for option, value in options.items() if option not in known}
    return kind(format=form, source=source, out=out, overwrite=overwrite, options=of_format, **of_writer)


def _words(option: str) -> str:
    return f"--{option.replace('_', '-')}"
