"""Finds what a folder has to serve: streams, and takes to review."""

import shlex
from collections.abc import Callable
from pathlib import Path

from v3studio.pipelines.config import load_config
from v3studio.pipelines.reports.terminal import say
from v3studio.pipelines.review.take_review import TakeReview
from v3studio.pipelines.takes.results.videos import stream_place
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Cancelled, StudioError
from v3studio.studio.stream.manifest import MANIFEST_NAME

_LOOK_SECONDS = 1.0  # between two looks for a stream that is yet to be published


def find_streams(folder: str) -> dict[str, Path]:
    """Folders of streams by their path on the server: "/" for a single one, else "/<name>" per subfolder. Subfolders
    that are links out of the folder are left out, with a warning."""
    place = stream_place(folder)
    if isinstance(place, str):
        fix = "Open it with `v3studio play`, or specify a folder."
        raise StudioError("serve.not_a_folder", "is a URL; only folders can be served", file=folder, fix=fix)
    if place.is_file():
        fix = (
            "If it is a stream, `v3studio play` plays it, and `v3studio share` writes a folder with it that can be "
            "served."
        )
        raise StudioError("serve.not_a_folder", "is a file; only folders can be served", file=folder, fix=fix)
    if (place / MANIFEST_NAME).is_file():
        return {"/": place}
    streams = {}
    for path in sorted(place.iterdir()):
        stream = path / "stream" if (path / "take.json").is_file() else path
        if not path.name.startswith(".") and (stream / MANIFEST_NAME).is_file():
            shown = str(path).encode("utf-8", "backslashreplace").decode()
            if not shown.endswith(path.name):
                say(f"warning: {shown}: not served, since its name is not UTF-8. Rename it.", error=True)
                continue
            if not stream.resolve().is_relative_to(place.resolve()):
                say(
                    f"warning: {path}: not served, since it is a link out of this folder. Move what it links to here.",
                    error=True,
                )
                continue
            streams[f"/{path.name}"] = stream
    if not streams:
        fix = "Run `v3studio bake`, or specify another folder."
        raise StudioError("serve.no_stream", f"no stream in this folder (no {MANIFEST_NAME})", file=folder, fix=fix)
    return streams


def find_reviews(streams: dict[str, Path]) -> dict[str, TakeReview]:
    """Reviews of the streams that are in takes, by the paths of `find_streams`."""
    reviews = {
        path: TakeReview(Take.open(folder.parent))
        for path, folder in streams.items()
        if folder.name == "stream" and (folder.parent / "take.json").is_file()
    }
    if not reviews:
        problem = "only takes can be reviewed; a stream alone has neither quality figures nor footage"
        fix = "Specify the folder of a take, or leave out --review."
        raise StudioError(
            "serve.nothing_to_review", problem, file=next(iter(streams.values())), fix=fix, option="--review"
        )
    return reviews


def wait_for_first_group(folder: str, stopped: Callable[[float], bool]) -> None:
    """Return when a take that is baked live (`run.live`) has a stream; at once for anything else.

    `stopped` waits for as many seconds as it is given and returns whether to stop, which raises `Cancelled`.
    StudioError (`serve.no_run`) when no run is in progress that could make the stream.
    """
    root = Path(folder).expanduser()
    if not (root / "take.json").is_file():
        return
    take = Take.open(root)
    if take.has_stream or not take.config.is_file() or not load_config(take.config).run.live:
        return
    say(f"{folder}: waiting for the first group to be trained and baked", error=True)
    while take.running() is not None:
        if take.has_stream:
            return
        if stopped(_LOOK_SECONDS):
            raise Cancelled
    if not take.has_stream:  # the run may have ended just after it made one
        problem = "there is no stream yet, and no run is in progress"
        place = shlex.quote(folder)
        fix = f"`v3studio status {place}` shows what failed; `v3studio run {place} --live` continues."
        raise StudioError("serve.no_run", problem, file=folder, fix=fix)
