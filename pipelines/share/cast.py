"""The document of a cast: a small JSON file that says where several streams and static splats are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from v3studio.studio.bounded_files import TextError, parse_json
from v3studio.studio.errors import StudioError, first_violation
from v3studio.studio.settings import Color, Unit
from v3studio.studio.stream.manifest import MANIFEST_NAME

MAX_ITEMS = 100

SPLATS = (".ply", ".splat", ".spz", ".sog")

Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Triple = tuple[Number, Number, Number]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Item(_Part):
    """A stream or static splats: exactly one of them."""

    stream: str | None = None  # folder of a take or a stream, a .v3s file, or a URL; paths are relative to the document
    splats: str | None = None  # A .ply, .splat, .spz or .sog file

    position: Triple = (0.0, 0.0, 0.0)
    """The place of the origin in meters; y is up, and the ground is at 0. A stream's lowest point is put there."""

    turn: Triple = (0.0, 0.0, 0.0)  # degrees about x, y and z
    scale: float = Field(default=1.0, gt=0, le=1e6)

    start: float = Field(default=0.0, ge=0, le=1e6)
    """Seconds until a stream begins; until then it shows its first frame."""

    @model_validator(mode="after")
    def _is_one(self) -> Item:
        if (self.stream is None) == (self.splats is None):
            raise ValueError("must have either stream or splats")
        if self.splats is not None and not self.splats.lower().endswith(SPLATS):
            raise ValueError(f"must end in {' or '.join(SPLATS)}, found {self.splats}")
        return self


class View(_Part):
    """The first view; `fov` is vertical, in degrees."""

    position: Triple = (0.0, 1.5, 4.5)
    target: Triple = (0.0, 0.8, 0.0)
    fov: float = Field(default=40.0, ge=5, le=120)


class GroundPlane(_Part):
    """A disk at y = 0 with the performers' soft contact shadows, whose darkest parts have the opacity `shadow`."""

    color: Color = (0.5, 0.5, 0.5)
    radius: float = Field(default=5.0, gt=0, le=1e6)
    shadow: Unit = 0.5


class Cast(_Part):
    """The document. Colors are sRGB, 0 to 1."""

    format: Literal["v3studio-cast"]
    version: Literal[1]
    title: str = Field(default="V3 Studio", max_length=300)
    background: Color = (0.0, 0.0, 0.0)
    camera: View = View()
    ground: GroundPlane | None = GroundPlane()
    items: tuple[Item, ...] = Field(min_length=1, max_length=MAX_ITEMS)


def is_cast(source: str) -> bool:
    """Return whether a user names a document, and not the manifest of a stream or of a take."""
    path = Path(source)
    return path.suffix.lower() == ".json" and path.name not in (MANIFEST_NAME, "take.json")


def read_cast(path: Path) -> Cast:
    """Read the document."""
    fix = 'docs/guides/web.md, "A cast", describes the document.'
    try:
        return Cast.model_validate(parse_json(path.read_bytes(), unique=True))
    except FileNotFoundError:
        raise StudioError("share.bad_cast", "no such file", file=path, fix="Check the path.") from None
    except (TextError, OSError) as error:
        raise StudioError("share.bad_cast", f"cannot be read: {error}", file=path, fix=fix) from None
    except ValidationError as error:
        where, problem = first_violation(error, "the document")
        raise StudioError("share.bad_cast", problem, file=path, fix=fix, key=where) from None


def beside(named: str, source: Path) -> str:
    """The path or URL that an item of a document names."""
    return named if "://" in named else str(source.parent / Path(named).expanduser())
