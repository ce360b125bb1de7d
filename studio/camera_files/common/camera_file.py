"""A camera file that is to be recognized: its content in whichever form it has."""

from functools import cached_property
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

from v3studio.studio.camera_files.common import read_json_value, read_text
from v3studio.studio.camera_files.common.opencv_storage import read_storage
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject


class CameraFile:
    """A file, a folder or a pattern with `{camera}`. Content is read when it is first asked for; StudioError if that
    fails (camera_file.*)."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def _text(self) -> str:
        return read_text(self.path)

    @cached_property
    def kind(self) -> Literal["csv", "json", "xml", "yaml", ""]:
        """The kind by the extension, or else by the first characters; "" for folders and other files."""
        suffix = self.path.suffix.lower()
        if self.path.is_dir():
            return ""
        if suffix == ".json":
            return "json"
        if suffix == ".csv":
            return "csv"
        if self._text.startswith("%YAML"):  # OpenCV writes "%YAML:1.0" or, since version 5, "%YAML 1.2"
            return "yaml"
        start = self._text.lstrip()[:1]
        return "xml" if start == "<" else "json" if start in "{[" else ""

    @cached_property
    def json(self) -> Any:
        """The value of a JSON file; None of other files."""
        return read_json_value(self.path) if self.kind == "json" else None

    @property
    def json_object(self) -> JsonObject:
        """The value of a JSON file if it is an object; empty if it is not."""
        return self.json if isinstance(self.json, dict) else {}

    @cached_property
    def columns(self) -> frozenset[str]:
        """The heads in the first line of a CSV file; empty for other files."""
        if self.kind != "csv":
            return frozenset()
        return frozenset(head.strip() for head in self._text.lstrip().splitlines()[0].split(","))

    @cached_property
    def xml(self) -> ElementTree.Element | None:
        """The root of an XML file; None of other files."""
        if self.kind != "xml":
            return None
        try:
            return ElementTree.fromstring(self._text.encode())
        except ElementTree.ParseError as error:
            line, column = error.position
            problem = f"invalid XML at line {line}, column {column + 1}"
            fix = "The file may be truncated: export the cameras again."
            raise StudioError("camera_file.syntax", problem, fix=fix, line=line, column=column + 1) from None

    @cached_property
    def storage(self) -> JsonObject:
        """The values of a YAML file of OpenCV; empty for other files."""
        return read_storage(self.path) if self.kind == "yaml" else {}
