"""Writes the page of a cast: its streams and static splats, the script that shows them, and its images."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from v3studio.pipelines.share.cast import beside, read_cast
from v3studio.pipelines.share.cast_frames import placement, standing
from v3studio.pipelines.share.cast_images import cast_images
from v3studio.pipelines.share.page import PAGE_NAME, PageText, cast_page, preview_tags, script_elements
from v3studio.pipelines.share.player_files import CAST_SCRIPT, hashed_name, read_player
from v3studio.pipelines.share.shared_folder import shared_folder
from v3studio.pipelines.share.stream_to_share import StreamToShare, stream_to_share
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.results.videos import FALLBACK_FPS
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats
from v3studio.studio.json_types import JsonObject
from v3studio.studio.progress import ProgressFn
from v3studio.studio.similarity import Similarity
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from v3studio.studio.stream.manifest import MANIFEST_NAME

CAST_NAME = "cast.json"

_STILL_QP = 4  # of static splats, of which there is one frame only


def write_cast(source: Path, out: Path, text: PageText, progress: ProgressFn) -> tuple[str, dict[str, int]]:
    """Write the page of a cast into a folder; returns its title, and the bytes of each file. Without `text`, title,
    credits and license are the document's and the streams'.

    StudioError: `share.bad_cast` (also for a text that the page has no place for), `share.no_player`, no stream where
    an item names one, or a disk that is full.
    """
    cast = read_cast(source)
    player = read_player()
    unused = [name for name in ("intro", "view", "marks") if getattr(text, name) is not None]
    if unused:
        fix = f"Leave out {' and '.join('--' + name for name in unused)}."
        raise StudioError("share.bad_cast", f"the page of a cast has no {unused[0]}", file=source, fix=fix)
    text = replace(text, title=text.title or cast.title).plain()
    title = text.title or ""
    placed: dict[str, tuple[str, Similarity]] = {}
    streams: list[PageText] = []
    items: list[JsonObject] = []
    with disk_errors(out), shared_folder(out, title) as folder:
        for number, item in enumerate(cast.items):
            progress(number, len(cast.items))
            named = beside(item.stream or item.splats or "", source)
            if named not in placed:
                place = str(len(placed))
                with stream_to_share(named) if item.stream is not None else _still(Path(named), source) as stream:
                    folder.write_stream(place, stream.reader)
                    streams.append(stream.text(PageText()))
                    stands = standing(stream.reader) if item.stream is not None else Similarity()
                placed[named] = f"{place}/{MANIFEST_NAME}", stands
            address, stands = placed[named]
            values = {"stream": address, "start": item.start, "shadow": item.stream is not None}
            items.append({**values, "standing": _matrix(stands), "place": _matrix(placement(item))})
        shown = cast.model_dump(mode="json", include={"background", "camera", "ground"}) | {"items": items}
        name = hashed_name(CAST_SCRIPT, player.cast)
        folder.write(name, player.cast)
        folder.write(CAST_NAME, json.dumps(shown, indent=1).encode())
        images = cast_images(source)
        poster, preview = hashed_name("poster.jpg", images[0]), hashed_name("preview.jpg", images[1])
        folder.write(poster, images[0])
        folder.write(preview, images[1])
        credits = _credits(text, streams)
        tags = preview_tags(replace(text, credits=credits, license=None), preview)
        filled = cast_page(player.page, script_elements([name]), title, credits, poster, tags)
        folder.write(PAGE_NAME, filled.encode())
        progress(len(cast.items), len(cast.items))
    return title, folder.written


def _matrix(place: Similarity) -> list[float]:
    """Three rows of four numbers."""
    return [float(value) for value in np.c_[place.scale * place.rotation, place.translation].ravel()]


@contextmanager
def _still(path: Path, source: Path) -> Iterator[StreamToShare]:
    """Static splats as a stream of one frame."""
    if not path.is_file():
        raise StudioError("share.bad_cast", "no such file", file=path, fix=f"Correct the path in {source}.")
    settings = BakeSettings(quality=_STILL_QP)
    with TemporaryDirectory() as folder:
        write_manifest(folder, [bake_group([read_splats(path)], folder, 0, 0, settings)], FALLBACK_FPS, settings)
        with StreamReader.open(Path(folder)) as reader:
            yield StreamToShare(reader, path.stem)


def _credits(text: PageText, streams: Sequence[PageText]) -> str:
    """Credits and license in one line: those given, or else each of the streams' once."""
    lines = [[stream.credits or "", stream.license or ""] for stream in streams]
    given = [[text.credits or "", text.license or ""]] if text.credits or text.license else lines
    return "; ".join(dict.fromkeys(", ".join(part for part in line if part) for line in given if any(line)))
