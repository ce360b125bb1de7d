"""Detection of a capture's folder layout, for patterns set to "auto"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from studio.bounded_files import parse_json, read_bounded
from studio.capture.patterns import IMAGE_EXTENSIONS, VIDEO_EXTENSIONS, Match, find_files, walk
from studio.errors import StudioError

MASK_FOLDERS = ("masks", "mask", "mattes", "matte", "alpha", "alphas", "pha", "mask_cihp", "mask-schp", "mask_schp")
PLATE_FOLDERS = ("clean_plates", "clean_plate", "bg", "background", "backgrounds", "plates")
_PLATE_FILES = ("background", "bg", "clean_plate", "plate", "empty")  # in a folder per camera
_NOT_FOOTAGE = frozenset(
    (*MASK_FOLDERS, *PLATE_FOLDERS, "intrinsics", "intrinsic", "depth", "depths", "normals", "sparse", "meshes", "mesh")
)
# In order of preference: camera recordings before data derived from them.
_LAYOUTS = (
    "videos/{camera}.*",
    "video/{camera}.*",
    "{camera}/video.*",
    "{camera}/{camera}.*",
    "rgbs/{camera}/{camera}_rgb{frame}.*",  # ActorsHQ
    "image_white/{frame}/{camera}.*",  # HiFi4G
    "image_white_undistortion/{frame}/{camera}.*",
    "image/{frame}/img_{camera}.*",  # ReRF, videos split into frames
    "img/{frame}/img_{camera}.*",  # NHR
    "image/{camera}.*",  # ReRF
    "images/{camera}/{frame}.*",
    "images/{camera}/*_{frame}.*",
    "images/{frame}/image_c_{camera}_f_{frame}.*",  # PKU-DyMVHumans, data_NeuS2
    "{frame}/images/image_c_{camera}_f_{frame}.*",  # PKU-DyMVHumans, data_COLMAP and data_ngp
    "{frame}/images/{camera}.*",
    "colmap_{frame}/images/{camera}.*",
    "images/{camera}.*",
    "images/{camera}_{frame}.*",
    "per_view/{camera}/images/{frame}.*",  # PKU-DyMVHumans
    "rgba/{camera}/{frame}.*",
    "rgb/{camera}/{frame}.*",
    "frames/{camera}/{frame}.*",
    "frames/{frame}/{camera}.*",
    "{frame}/{camera}.*",
    "frame{frame}/{camera}.*",
    "frame_{frame}/{camera}.*",
    "{camera}/{frame}.*",
    "{camera}/{camera}_{frame}_*.*",  # ZJU-MoCap, the first subjects
    "{camera}/{camera}_{frame}.*",
    "{camera}/images/{frame}.*",
    "{camera}.*",
)
_VIDEOS_ONLY = frozenset({"{camera}/video.*", "{camera}/{camera}.*", "image/{camera}.*", "{camera}.*"})
_DEPTH = 4  # folders below the capture's


def detect_images(root: Path) -> tuple[str, list[Match]]:
    """Find the footage below `root`: in a usual layout, where transforms.json says, or in the only folder with videos
    or with images.

    Returns:
        A pattern and the files that match it.

    Raises:
        StudioError: `footage.not_found`, `footage.ambiguous_layout` if several folders contain videos, or
            `footage.container` if there are only containers that cannot be read.
    """
    listing = cache(lambda: list(walk(root, _DEPTH)))
    found = _usual_layout(root, "", listing)
    if found is None:
        videos = _folders_with(listing(), VIDEO_EXTENSIONS)
        found = _only_folder(root, videos) or _one_level_down(root, listing)
        if found is None and videos:
            raise _ambiguous(root, videos)
    found = found or _only_folder(root, _folders_with(listing(), IMAGE_EXTENSIONS))
    if found is not None:
        return found
    container = next((relative for relative in listing() if relative.endswith(".smc")), None)
    if container is not None:
        raise StudioError(
            "footage.container",
            "SMC containers of DNA-Rendering cannot be read directly",
            file=root / container,
            fix="Unpack it with the data set's SMCReader: images to images/CAMERA/FRAME.jpg, masks to "
            "masks/CAMERA/FRAME.png, cameras to intri.yml and extri.yml.",
        )
    raise StudioError(
        "footage.not_found",
        "no footage found",
        file=root,
        fix="Put videos in videos/ or images in images/CAMERA/FRAME.png, or set capture.images, for example "
        "'rushes/{camera}.mp4'.",
        setting="capture.images",
    )


def _usual_layout(root: Path, prefix: str, listing: Callable[[], Sequence[str]]) -> tuple[str, list[Match]] | None:
    base = root / prefix if prefix else root
    part = cache(lambda: [path.removeprefix(prefix) for path in listing() if path.startswith(prefix)])
    for layout in _LAYOUTS:
        if layout == "{camera}/{frame}.*":
            named = _named_by_cameras(base)
            if named is not None:
                return prefix + named[0], named[1]
        matches = find_files(base, layout, listing=part)
        matches = [match for match in matches if match.camera.lower() not in _NOT_FOOTAGE]
        # next to other files, or with such names, images are rarely footage
        if layout in _VIDEOS_ONLY:
            matches = [match for match in matches if match.path.suffix.lower() in VIDEO_EXTENSIONS]
        if layout == "images/{camera}.*" and _numbered(matches):
            continue
        if layout == "{frame}/{camera}.*" and not _folders_are_frames(base, matches):
            continue
        if matches:
            return prefix + _with_extension(layout, matches), matches
    return None


def _one_level_down(root: Path, listing: Callable[[], Sequence[str]]) -> tuple[str, list[Match]] | None:
    """A usual layout in the only folder of `root` that has one."""
    found = None
    for folder in _folders(root):
        inner = _usual_layout(root, f"{folder}/", listing)
        if inner is not None and found is not None:
            raise _ambiguous(root, [found[0], inner[0]])
        found = inner or found
    return found


def _folders(root: Path) -> list[str]:
    return sorted(
        entry.name for entry in root.iterdir() if entry.is_dir() and entry.name.lower() not in _NOT_FOOTAGE
        and not entry.name.startswith(".")
    )  # fmt: skip


def _named_by_cameras(root: Path) -> tuple[str, list[Match]] | None:
    """Images in a folder of any name that are named as in transforms.json, which is in `root` or next to it."""
    for camera_file in (root / "transforms.json", root.parent / "transforms.json"):
        named = named_in(camera_file)
        if len(named) < 2:
            continue
        folders = [""] if camera_file.parent != root else [f"{folder}/" for folder in _folders(root)]
        for folder in folders:
            for below in ("{camera}.*", "{frame}/{camera}.*"):
                matches = [match for match in find_files(root, folder + below) if match.camera in named]
                if named <= {match.camera for match in matches}:
                    return _with_extension(folder + below, matches), matches
    return None


def named_in(path: Path) -> set[str]:
    """Names without extension of the images in a transforms.json; empty if there is none."""
    try:
        entries = parse_json(read_bounded(path))["frames"]
        return {Path(entry["file_path"]).stem for entry in entries}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def _only_folder(root: Path, folders: Sequence[str]) -> tuple[str, list[Match]] | None:
    if len(folders) != 1:
        return None
    layout = f"{folders[0]}/{{camera}}.*"
    matches = find_files(root, layout)
    return _with_extension(layout, matches), matches


def _folders_with(listing: Sequence[str], extensions: frozenset[str]) -> list[str]:
    """The folders with several files of a kind."""
    folders: dict[str, int] = {}
    for relative in listing:
        path = Path(relative)
        parts = {part.lower() for part in path.parts[:-1]}
        if path.suffix.lower() in extensions and not parts & _NOT_FOOTAGE:
            folders[path.parent.as_posix()] = folders.get(path.parent.as_posix(), 0) + 1
    return sorted(folder for folder, count in folders.items() if count > 1 and folder != ".")


def _ambiguous(root: Path, several: list[str]) -> StudioError:
    pattern = several[0] if "{camera}" in several[0] else f"{several[0]}/{{camera}}.*"
    return StudioError(
        "footage.ambiguous_layout",
        f"found footage in {' and '.join(several)}",
        file=root,
        value=several,
        fix=f"Choose the footage with capture.images, for example '{pattern}'.",
        setting="capture.images",
    )


def _folders_are_frames(root: Path, matches: Sequence[Match]) -> bool:
    """Whether NUMBER/NUMBER.png means frame/camera, as in HiFi4G with its transforms.json next to the folders, rather
    than camera/frame."""
    frames = {match.frame for match in matches}
    cameras = {match.camera for match in matches}
    if all(camera.isdigit() for camera in cameras):
        named = named_in(root / "transforms.json")
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
    """Find masks or clean plates of the cameras.

    Args:
        root: the capture's folder.
        folders: `MASK_FOLDERS` or `PLATE_FOLDERS`: names of folders to look for, below `root`, the folders of the
            frames or those of the cameras.
        cameras: names of the footage's cameras.

    Returns:
        A pattern and the files of `cameras` that match it; None if there are none.
    """
    wanted = set(cameras)
    listing = cache(lambda: list(walk(root, _DEPTH)))
    patterns = [
        f"{folder}/{below}"
        for folder in folders
        if (root / folder).is_dir()
        for below in (
            "{camera}/{frame}.*",
            "{camera}/{camera}_mask{frame}.*",  # ActorsHQ
            "{camera}/{camera}_{frame}_*.*",  # ZJU-MoCap, the first subjects
            "{camera}/{camera}_{frame}.*",
            "{frame}/img_{camera}.*",  # ReRF
            "{frame}/{camera}.*",
            "{camera}.*",
            "{camera}_{frame}.*",
        )
    ]
    for folder in folders:
        patterns += [
            f"{{frame}}/{folder}/{{camera}}.*",
            f"{{frame}}/{folder}/image_c_{{camera}}_f_{{frame}}.*",  # PKU-DyMVHumans, data_COLMAP
            f"{{camera}}/{folder}/{{frame}}.*",
            f"{{camera}}/{folder}/pha/{{frame}}.*",  # AvatarReX
            f"per_view/{{camera}}/{folder}/{{frame}}.*",  # PKU-DyMVHumans
            f"img/{{frame}}/{folder}/img_{{camera}}.*",  # NHR
        ]
    if folders is PLATE_FOLDERS:
        patterns += [f"{{camera}}/{name}.*" for name in _PLATE_FILES]
    for pattern in patterns:
        matches = [match for match in find_files(root, pattern, listing=listing) if match.camera in wanted]
        if matches:
            return _with_extension(pattern, matches), matches
    return None
