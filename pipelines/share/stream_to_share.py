"""An opened stream to share or publish: the text and the poster of its page, and the files beside it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from v3studio.pipelines.share.page import (
    PAGE_NAME,
    PREVIEW_SIZE,
    PageText,
    first_files,
    player_page,
    preview_tags,
    script_elements,
)
from v3studio.pipelines.share.player_files import PlayerFiles, hashed_name
from v3studio.pipelines.takes.results.videos import decoded_video, stream_place
from v3studio.studio.formats.camera_path import turntable
from v3studio.studio.stream.metadata import TEXTS, with_plain_texts

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera
    from v3studio.studio.stream import StreamReader

POSTER_WIDTH = 1200  # largest width in pixels

_QUALITY = 82  # of JPEG
_POSTER_SIZE = (1200, 900)  # where the stream suggests no camera


@dataclass(frozen=True)
class StreamToShare:
    """An opened stream, in its best rendition. `name`: of take or stream, the title of last resort."""

    reader: StreamReader
    name: str

    @property
    def total_bytes(self) -> int:
        """Bytes of all files and the manifest."""
        return len(self.reader.manifest_bytes) + sum(file.bytes for file in self.reader.files)

    def text(self, given: PageText) -> PageText:
        """`given`, completed by what the stream says of itself, and the name for a missing title."""
        metadata = with_plain_texts(self.reader.manifest.metadata)
        own = {key: value for key in TEXTS if isinstance(value := metadata.get(key), str)}
        texts = {name: own.get(name) if getattr(given, name) is None else getattr(given, name) for name in TEXTS}
        texts["title"] = given.title or own.get("title") or self.name
        return replace(given, **texts).plain()

    def poster(self) -> bytes:
        """The player's first view, JPEG."""
        return self._image(self._first_view())

    def preview(self) -> bytes:
        """The first view for link previews, JPEG: all of it, and more on its sides or above and below."""
        return self._image(preview_view(self._first_view()))

    def _first_view(self) -> Camera:
        """The view from the suggested camera at eye level, or the front."""
        from v3studio.studio.stream.suggested_view import eye_level_view

        video = decoded_video(self.reader)
        camera = video.view or turntable(video, *_POSTER_SIZE)(0.0)
        if video.view is not None and video.up is not None:
            box = self.reader.manifest.bounding_box
            camera = eye_level_view(camera, box.min, box.max, video.up)
        return camera.undistorted()

    def _image(self, camera: Camera) -> bytes:
        """The first frame over the background."""
        from v3studio.pipelines.reports.images import encode, render

        video = decoded_video(self.reader)
        return encode(
            render(video.read(0).before(video.behind()), camera, video.background, width=POSTER_WIDTH), ".jpg", _QUALITY
        )

    def page_files(self, text: PageText, player: PlayerFiles, manifest: str) -> dict[str, bytes]:
        """The files that play the stream from a web server, by name: the images first, the page last. All but the page
        are named by their content; addresses, also that of the `manifest`, are relative to the page."""
        poster, preview = self.poster(), self.preview()
        poster_name, preview_name = hashed_name("poster.jpg", poster), hashed_name("preview.jpg", preview)
        hashed = player.hashed()
        first = first_files(self.reader.manifest_bytes)
        tags = preview_tags(text, preview_name)
        seconds = self.reader.manifest.duration
        scripts = script_elements(hashed)
        page = player_page(player.page, scripts, manifest, text, poster_name, tags, first=first, seconds=seconds)
        return {poster_name: poster, preview_name: preview, **hashed, PAGE_NAME: page.encode()}


def preview_view(view: Camera) -> Camera:
    """The camera of a link preview: all of a view, and more on its sides or above and below."""
    width, height = PREVIEW_SIZE
    whole = view.scaled(min(width / view.width, height / view.height))
    return whole.cropped((whole.width - width) // 2, (whole.height - height) // 2, width, height)


@contextmanager
def stream_to_share(text: str) -> Iterator[StreamToShare]:
    """Open what a user names: the folder of a take or of a stream, or a URL. StudioError: no such folder
    (`stream.not_found`), a take without a stream (`take.no_stream`), no or a bad manifest."""
    from v3studio.studio.stream import StreamReader

    place = stream_place(text)
    with StreamReader.open(place) as reader:
        yield StreamToShare(reader, _name(place))


def name_of(folder: Path) -> str:
    """Name of a stream's folder, or of its file without the extension; of a take's stream, the take's."""
    folder = folder.absolute()
    if folder.is_file():
        return folder.stem
    in_take = folder.name == "stream" and (folder.parent / "take.json").is_file()
    return folder.parent.name if in_take else folder.name


def _name(place: Path | str) -> str:
    if isinstance(place, Path):
        return name_of(place)
    address = urlsplit(place)
    parts = [unquote(part) for part in address.path.split("/") if part]
    return (parts[-1] if parts else "") or address.netloc
