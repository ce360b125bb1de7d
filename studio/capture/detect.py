"""Detection of a capture's folder layout, for patterns set to "auto"."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from studio.bounded_text import parse_json
from studio.capture.patterns import VIDEO_EXTENSIONS, Match, find_files, walk
from studio.errors import StudioError

MASK_FOLDERS = ("masks", "mask", "mattes", "matte", "alpha", "alphas")
PLATE_FOLDERS = ("clean_plates", "clean_plate", "bg", "background", "backgrounds", "plates")
_NOT_FOOTAGE = frozenset(
    (*MASK_FOLDERS, *PLATE_FOLDERS, "intrinsics", "intrinsic", "depth", "depths", "normals", "sparse", "meshes", "mesh")
)
# In order of preference: camera recordings before data derived from them.
_LAYOUTS = (
    "videos/{camera}.*",
    "video/{camera}.*",
    "rgbs/{camera}/{camera}_rgb{frame}.*",  # ActorsHQ
    "image_white/{frame}/{camera}.*",  # HiFi4G
    "image_white_undistortion/{frame}/{camera}.*",
    "image/{frame}/img_{camera}.*",  # ReRF, videos split into frames
    "image/{camera}.*",  # ReRF
    "images/{camera}/{frame}.*",
    "images/{camera}/*_{frame}.*",
    "{frame}/images/{camera}.*",
    "images/{camera}.*",
    "images/{camera}_{frame}.*",
    "rgba/{camera}/{frame}.*",
    "rgb/{camera}/{frame}.*",
    "frames/{camera}/{frame}.*",
    "frames/{frame}/{camera}.*",
    "{frame}/{camera}.*",
    "{camera}/{frame}.*",
    "{camera}/images/{frame}.*",
    "{camera}.*",
)


def detect_images(root: Path) -> tuple[str, list[Match]]:
    """Find the footage below `root`.

    Returns:
        A pattern and the files that match it.

    Raises:
        StudioError: `footage.not_found`, or `footage.ambiguous_layout` if several folders contain videos.
    """
    for layout in _LAYOUTS:
        matches = find_files(root, layout)
        matches = [match for match in matches if match.camera.lower() not in _NOT_FOOTAGE]
        if layout == "{camera}.*":  # files directly in the folder: videos only, since images there are rarely footage
            matches = [match for match in matches if match.path.suffix.lower() in VIDEO_EXTENSIONS]
        if layout == "images/{camera}.*" and _numbered(matches):
            continue
        if layout == "image/{camera}.*":  # images there belong to another layout
            matches = [match for match in matches if match.path.suffix.lower() in VIDEO_EXTENSIONS]
        if layout == "{frame}/{camera}.*" and not _folders_are_frames(root, matches):
            continue
        if matches:
            return _with_extension(layout, matches), matches
    folders: dict[str, int] = {}
    for relative in walk(root, 4):
        path = Path(relative)
        parts = {part.lower() for part in path.parts[:-1]}
        if path.suffix.lower() in VIDEO_EXTENSIONS and not parts & _NOT_FOOTAGE:
            folders[path.parent.as_posix()] = folders.get(path.parent.as_posix(), 0) + 1
    several = sorted((folder for folder, count in folders.items() if count > 1))
    if len(several) == 1:
        layout = f"{several[0]}/{{camera}}.*"
        matches = find_files(root, layout)
        return _with_extension(layout, matches), matches
    if several:
        raise StudioError(
            "footage.ambiguous_layout",
            f"found videos in {' and '.join(several)}",
            file=root,
            value=several,
            fix=f"Choose the footage with capture.images, for example '{several[0]}/{{camera}}.*'.",
            setting="capture.images",
        )
    raise StudioError(
        "footage.not_found",
        "no footage found",
        file=root,
        fix="Put videos in videos/ or images in images/CAMERA/FRAME.png, or set capture.images, for example "
        "'rushes/{camera}.mp4'.",
        setting="capture.images",
    )


def _folders_are_frames(root: Path, matches: Sequence[Match]) -> bool:
    """Whether NUMBER/NUMBER.png means frame/camera, as in HiFi4G with its transforms.json next to the folders, rather
    than camera/frame."""
    frames = {match.frame for match in matches}
    cameras = {match.camera for match in matches}
    if all(camera.isdigit() for camera in cameras):
        try:
            entries = parse_json((root / "transforms.json").read_bytes())["frames"]
            named = {Path(entry["file_path"]).stem for entry in entries}
        except (OSError, ValueError, KeyError, TypeError):
            return False
        return bool(named) and named <= cameras
    return len(matches) == len(frames) * len(cameras) and len(cameras) > 1


def _numbered(matches: Sequence[Match]) -> bool:
    """Whether the names look like cam01_000000, cam01_000001, ..., with all frames of all cameras in one folder."""
    stems: dict[str, int] = {}
    for match in matches:
        head, _, tail = match.camera.rpartition("_")
        if not head or not tail.isdigit() or len(tail) < 3:
            return False
        stems[head] = stems.get(head, 0) + 1
    return len(stems) > 1 and min(stems.values()) > 1


def _with_extension(layout: str, matches: Sequence[Match]) -> str:
    """The layout, with `.*` replaced by the extension if all files have the same one."""
    extensions = {match.path.suffix for match in matches}
    return layout[:-2] + extensions.pop() if len(extensions) == 1 and layout.endswith(".*") else layout


def detect_beside(root: Path, folders: Sequence[str], cameras: Sequence[str]) -> tuple[str, list[Match]] | None:
    """Find masks or clean plates in the first of `folders` below `root` that contains files named after the cameras.

    Args:
        root: the capture's folder.
        folders: names to look for, such as `MASK_FOLDERS`.
        cameras: names of the footage's cameras.

    Returns:
        A pattern and the files of `cameras` that match it; None if there are none.
    """
    wanted = set(cameras)
    for folder in folders:
        if not (root / folder).is_dir():
            continue
        for below in (
            "{camera}/{frame}.*",
            "{camera}/{camera}_mask{frame}.*",  # ActorsHQ
            "{frame}/img_{camera}.*",  # ReRF
            "{frame}/{camera}.*",
            "{camera}.*",
            "{camera}_{frame}.*",
        ):
            layout = f"{folder}/{below}"
            matches = [match for match in find_files(root, layout) if match.camera in wanted]
            if matches:
                return _with_extension(layout, matches), matches
    matches = []
    for folder in folders:
        layout = f"{{frame}}/{folder}/{{camera}}.*"
        matches = [match for match in find_files(root, layout) if match.camera in wanted]
        if matches:
            return _with_extension(layout, matches), matches
    return None
