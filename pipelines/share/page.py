"""The player's page for one stream: its text, link preview, intro, and where its files are."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from math import isfinite
from pathlib import Path

from v3studio.pipelines.share.player_files import REST_PREFIX
from v3studio.pipelines.takes.results.videos import decoded_video, open_reader, stream_numbers
from v3studio.pipelines.version import program_version
from v3studio.studio.bounded_files import parse_json
from v3studio.studio.errors import StudioError, naming, plain_text
from v3studio.studio.formats.camera_path import FORMAT, VERSION, CameraPath
from v3studio.studio.stream.metadata import TEXTS

PREVIEW_SIZE = (1200, 630)
"""Width and height in pixels of the image of a link preview: of this shape, nothing is cut off."""

GENERATOR = "V3 Studio share 1"
"""Marks pages that `v3studio share` has written, with the version of what they consist of."""

PAGE_NAME = "index.html"

INTRO_SECONDS = 8.0  # duration of an intro through the cameras of a rig file, which has no times
MAX_INTRO_KEYS = 1000  # as many as the player reads

_SCRIPT = '<script type="module" src="v3-player.js"></script>'
_TITLE = "<title>V3 Player</title>"
_HEAD = "<!-- v3:head -->"
_HASHED = re.compile(r"files/[0-9a-f]{32}\.[a-z0-9]{1,8}")
_PLAYER = re.compile(r"<!-- v3:player -->.*?<!-- /v3:player -->", re.DOTALL)


@dataclass(frozen=True)
class PageText:
    """Text of a shared page, plain text without markup.

    Attributes:
        title: None for the stream's own, else the take's name.
        credits: whom to name, for example "Jane Doe, Studio X"; None for the stream's own, "" for none.
        license: of the footage, for example "CC BY 4.0"; None for the stream's own, "" for none.
        address: where the page will be, for example "https://example.org/walk/". Link previews need it: their
            images are only found by absolute addresses. None if it is not known.
        description: what the stream shows, for screen readers and link previews; None for the stream's own, "" for
            none.
        intro: a camera path from `read_intro`, with which the page begins; None for none.
        view: with which the page begins, from `read_view`; None for the stream's own.
        marks: notes that the page shows, from `read_public_marks`; None for none.
    """

    title: str | None = None
    credits: str | None = None
    license: str | None = None
    address: str | None = None
    description: str | None = None
    intro: str | None = None
    view: str | None = None
    marks: str | None = None

    def plain(self) -> PageText:
        """A copy whose texts are plain (`plain_text`), with "?" for lone surrogates, which UTF-8 cannot hold, but JSON
        escapes and file names can."""
        given = {name: value for name in TEXTS if (value := getattr(self, name)) is not None}
        texts = {name: plain_text(value.encode("utf-8", "replace").decode()) for name, value in given.items()}
        return replace(self, **texts)


def player_page(
    built: str,
    script: str,
    stream: str,
    text: PageText,
    poster: str | None = None,
    head: Sequence[str] = (),
    link: str | None = None,
    first: Sequence[str] = (),
    seconds: float | None = None,
) -> str:
    """The built page, filled in.

    Args:
        stream: address of the stream's manifest relative to the page, or "#id" of the element that holds its files.
        text: title, credits, license, description and intro; they are escaped here.
        poster: address of the image to show until the first frame is rendered.
        link: address relative to the page that links to it begin with; None for its own.
        first: files of the stream with which playback begins (`first_files`).
        seconds: duration, which is shown beside the title on the poster.
    """
    text = text.plain()
    attribute_values = {"src": stream, "poster": poster, "data-title": text.title, "data-credits": text.credits}
    attribute_values |= {"data-license": text.license, "data-description": text.description, "data-link": link}
    attribute_values["view"] = text.view
    for attribute, held in (("intro", text.intro), ("data-marks", text.marks)):
        if held is not None:
            name = f"v3-{attribute.removeprefix('data-')}"
            attribute_values[attribute] = f"#{name}"
            script = f'<script type="application/json" id="{name}">{_in_json(held)}</script>\n{script}'
    attributes = [f'{name}="{escape(value)}"' for name, value in attribute_values.items() if value]
    inside = ""
    if not stream.startswith("#"):
        head = [_early_files(stream, first), *head]
        inside = _first_seen(text.title, poster, seconds)
    element = f"<v3-player {' '.join(attributes)} page autoplay loop controls>{inside}</v3-player>"
    return _filled(built, element, script, text.title or "V3 Player", head)


def cast_page(built: str, script: str, title: str, credits: str, poster: str | None, head: Sequence[str]) -> str:
    """The built page, filled in for a cast, whose document is beside it. `script`: element that loads its script."""
    element = f'<v3-cast data-credits="{escape(credits)}" page controls>{_first_seen(title, poster)}</v3-cast>'
    return _filled(built, element, script, title, head)


def _first_seen(title: str | None, poster: str | None, seconds: float | None = None) -> str:
    """Return what is seen before the script has arrived."""
    whole = max(1, round(seconds or 0))
    duration = "" if seconds is None else f" <small>{whole // 60}:{whole % 60:02d}</small>"
    caption = f"<h1>{escape(title or '')}{duration}</h1>" if title or duration else ""
    return f'<img src="{escape(poster)}" alt="" fetchpriority="high">{caption}' if poster else ""


def _filled(built: str, element: str, script: str, title: str, head: Sequence[str]) -> str:
    """The built page with another element, script, title and more elements in its head. StudioError:
    `share.unknown_player`."""
    if any(built.count(part) != 1 for part in (_SCRIPT, _TITLE, _HEAD)) or len(_PLAYER.findall(built)) != 1:
        problem = "the built player is from another version of the program"
        raise StudioError("share.unknown_player", problem, fix="Run `make web`.")
    page = built.replace(_TITLE, f"<title>{escape(title)}</title>")
    page = page.replace(_HEAD, "\n".join([f'<meta name="generator" content="{GENERATOR} {program_version()}">', *head]))
    page = _PLAYER.sub(lambda _: element, page)
    return page.replace(_SCRIPT, script)


def script_elements(names: Iterable[str], folder: str = "") -> str:
    """Elements that load the scripts among the files of a folder, whose address is relative to the page."""
    own = [name for name in names if name.endswith(".js") and not name.startswith(REST_PREFIX)]
    return "\n".join(f'<script type="module" src="{folder}{name}"></script>' for name in own)


def preview_tags(text: PageText, image: str | None = None) -> list[str]:
    """Open Graph tags for link previews, HTML; text is escaped here. `image`: address relative to the page of one of
    `PREVIEW_SIZE`; None for no image."""
    base = None if text.address is None else text.address.rstrip("/") + "/"
    title = text.title or ""
    what = text.description or "Volumetric video"
    description = " · ".join(part for part in (what, text.credits, text.license) if part)
    tags = [
        f'<meta name="description" content="{escape(description)}">',
        _property("og:type", "website"),
        _property("og:title", title),
        _property("og:description", description),
    ]
    if base is not None:
        tags += [_property("og:url", base), f'<link rel="canonical" href="{escape(base)}">']
    if image is not None:
        width, height = map(str, PREVIEW_SIZE)
        tags += [
            _property("og:image", (base or "") + image),
            _property("og:image:width", width),
            _property("og:image:height", height),
            _property("og:image:alt", title),
            '<meta name="twitter:card" content="summary_large_image">',
        ]
    return tags


def first_files(manifest: bytes) -> list[str]:
    """Paths of the files with which a player begins: the first group in the rendition of the lowest bandwidth.

    A damaged manifest, which the player reports, has none.
    """
    try:
        content = parse_json(manifest)
        renditions = content["groups"][0]["renditions"]
        rates = {rendition["id"]: rendition["bandwidth"] for rendition in content["renditions"]}
        lowest = min(renditions, key=lambda rendition: rates[rendition["id"]])
        paths = [lowest[name]["path"] for name in ("side", "video")]
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        return []
    return paths if all(isinstance(path, str) and _HASHED.fullmatch(path) for path in paths) else []


def read_intro(path: Path, source: str) -> str:
    """The text that a page holds of a camera path, a file that `path_keys` reads for the stream `source`: times,
    easings, sizes and poses, without names, frames and distortion."""
    from v3studio.pipelines.takes.authored.camera_paths import path_keys

    with open_reader(source) as reader:
        video = replace(decoded_video(reader), numbers=stream_numbers(source, reader).known)
        try:
            keys = path_keys(video, path, seconds=INTRO_SECONDS)
        except StudioError as error:
            if error.code != "camera_path.which_camera":
                raise
            fix = "Give a file with one camera."
            raise StudioError(error.code, error.problem, file=path, fix=fix) from None
    if len(keys) > MAX_INTRO_KEYS:
        problem = f"the camera path has {len(keys)} keys; an intro has at most {MAX_INTRO_KEYS}"
        fix = "Remove some of the keys."
        raise StudioError(
            "camera_path.too_many_keys", problem, file=path, value=len(keys), fix=fix, expected=MAX_INTRO_KEYS
        )
    first = keys[0].camera
    with naming(path):
        CameraPath(keys, first.width, first.height)  # raises what is wrong with the times and the sizes
    entries = []
    for key in keys:
        camera = key.camera.undistorted()
        entries.append(
            {
                "time": round(key.time - keys[0].time, 4),
                "easing": key.easing,
                "camera": {
                    "width": camera.width,
                    "height": camera.height,
                    "K": camera.K.round(3).tolist(),
                    "world_to_camera": camera.world_to_camera.round(6).tolist(),
                },
            }
        )
    return json.dumps({"format": FORMAT, "version": VERSION, "keys": entries}, separators=(",", ":"))


def read_public_marks(source: str) -> str:
    """The text that a page holds of a take's marks: frames of the stream, notes and views, without names. `source`: the
    take's folder. StudioError: not a take, its marks are damaged, or none has a note and a view (`share.no_marks`)."""
    from v3studio.pipelines.review.take_review import TakeReview
    from v3studio.pipelines.takes.take import Take

    take = Take.open(Path(source).expanduser())
    marks = [mark for mark in TakeReview(take).marks() if mark.note and mark.view is not None]
    if not marks:
        fix = "Mark frames in the window, or in a browser: `v3studio serve --review`."
        raise StudioError("share.no_marks", "no mark has a note and a view", file=take.marks, fix=fix)
    view = {"camera", "fov", "wipe", "whole"}
    notes = [mark.model_dump(mode="json", exclude={"author": True, "view": view}) for mark in marks]
    return json.dumps(notes, separators=(",", ":"))


def read_view(text: str) -> str:
    """A view as in links to the player, checked: azimuth, elevation; or with the distance; or with the target too."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3, 6) or not all(map(isfinite, numbers)) or (len(numbers) > 2 and numbers[2] <= 0):
        fix = "Specify azimuth and elevation in degrees: --view=30,10. A link from the player's Share has them."
        raise StudioError("share.view", f"'{text}' is not a view", value=text, fix=fix)
    return ",".join(f"{value:g}" for value in numbers)


def _early_files(stream: str, first: Sequence[str]) -> str:
    """Element that fetches the manifest while the player's script is loading, and tells the script the files with which
    playback begins. Preload links would not revalidate the manifest, and are not for workers. Links to another time
    begin with other files."""
    folder = stream[: stream.rfind("/") + 1]
    address = _in_json(json.dumps(stream))
    addresses = _in_json(json.dumps({path: folder + path for path in first}))
    return f"""<script>
window.v3Early = {{
  address: {address},
  response: fetch({address}, {{ cache: "no-cache" }}).catch(() => null),
  files: new URLSearchParams(location.search).has("t") ? {{}} : {addresses},
}};
</script>"""


def _in_json(text: str) -> str:
    """JSON in which nothing ends the script element around it."""
    return text.replace("<", "\\u003c")


def _property(name: str, value: str) -> str:
    return f'<meta property="{name}" content="{escape(value)}">'
