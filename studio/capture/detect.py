"""Detection of a capture's folder layout, for patterns set to "auto"."""

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path, PurePosixPath

from v3studio.studio.bounded_files import parse_json, read_bounded
from v3studio.studio.capture.inference import Layout, groups_of, infer_layouts, looks_like_camera, shared_start
from v3studio.studio.capture.patterns import (
    IMAGE_EXTENSIONS,
    VIDEO_EXTENSIONS,
    Match,
    find_files,
    refuse_other_kinds,
    walk,
)
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError

_MASK_WORD = "(?:[a-z]?masks?|mattes?|alphas?|pha|segs?|segm|segmentations?|silhouettes?|sil)"
MASK_FOLDERS = re.compile(rf"(?:.*[^a-z])?{_MASK_WORD}(?:[^a-z].*)?", re.I)
"""Names of folders with masks, such as masks, mask_cihp, seg or fg-mask; not "masked"."""
PLATE_FOLDERS = re.compile("clean_?plates?|bg|backgrounds?|plates", re.I)
_PLATE_FILES = ("background", "bg", "clean_plate", "plate", "empty")  # in a folder per camera
_OTHER_FOLDERS = re.compile(
    "intrinsics?|depths?|depth_?maps?|disparity|flow|normals?|sparse|stereo|distorted|mesh(es)?|previews?|thumb(nail)?s?"
    "|proxy|proxies|sub|calib(ration)?|checkerboards?|chessboards?|boards?|colorchecker|keypoints?|__macosx",
    re.I,
)
_MASK_FILE = re.compile(rf"(.+)[-_.]{_MASK_WORD}|{_MASK_WORD}[-_.](.+)", re.I)
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
    "images/{frame}/image_c_{camera}_f_{frame}.*",  # PKU-DyMVHumans, data_NeuS2
    "{frame}/images/image_c_{camera}_f_{frame}.*",  # PKU-DyMVHumans, data_COLMAP and data_ngp
    "{frame}/images/{camera}.*",
    "images/{camera}.*",
    "rgb/{camera}/{frame}.*",
    "{frame}/{camera}.*",
    "{camera}/{frame}.*",
    "{camera}/{camera}_{frame}_*.*",  # ZJU-MoCap, the first subjects
    "{camera}.*",
)
_VIDEOS_ONLY = frozenset({"{camera}/video.*", "{camera}/{camera}.*", "image/{camera}.*", "{camera}.*"})
_DEPTH = 4  # folders below the capture's
_MOST_SUGGESTED = 4
_PARTS = ", whose files are parts of one recording"


def detect_images(root: Path) -> tuple[str, list[Match]]:
    """The pattern of the footage below `root` and the files that match it: in a usual layout, where transforms.json
    says, or in the only folder with videos or with images. StudioError: `footage.not_found`, `footage.ambiguous_layout`
    if several folders contain videos, or `footage.container` if there are only containers that cannot be read."""
    listing = cache(lambda: list(walk(root, _DEPTH)))
    layout = _usual_layout(root, "", listing) or _one_level_down(root, listing)
    if layout is not None:
        return _as_chapters(root, layout) or _as_grid(root, layout)
    films = _of_kind(listing(), VIDEO_EXTENSIONS)
    layouts = _video_layouts(films) if films else _grids(_of_kind(listing(), IMAGE_EXTENSIONS))
    if len(layouts) == 1:
        return _matching(root, layouts[0])
    if layouts:
        raise _ambiguous(root, layouts)
    layout = _only_folder(root, listing())
    if layout is not None:
        return _as_grid(root, layout)
    container = next((relative for relative in listing() if relative.endswith(".smc")), None)
    if container is not None:
        problem = "SMC containers of DNA-Rendering cannot be read directly"
        fix = (
            "Unpack it with the data set's SMCReader: images to images/CAMERA/FRAME.jpg, masks to "
            "masks/CAMERA/FRAME.png, cameras to intri.yml and extri.yml."
        )
        raise StudioError("footage.container", problem, file=root / container, fix=fix)
    refuse_other_kinds(root, listing())
    fix = "Put videos in videos/ or images in images/CAMERA/FRAME.png."
    raise StudioError("footage.not_found", "no footage found", file=root, fix=fix, setting="capture.images")


def _usual_layout(root: Path, prefix: str, listing: Callable[[], Sequence[str]]) -> tuple[str, list[Match]] | None:
    base = root / prefix if prefix else root
    part = cache(lambda: [path.removeprefix(prefix) for path in listing() if path.startswith(prefix)])
    for layout in _LAYOUTS:
        if layout == "{camera}/{frame}.*":
            named = _named_by_cameras(base)
            if named is not None:
                return prefix + named[0], named[1]
        try:
            matches = find_files(base, layout, listing=part)
        except StudioError as error:
            if error.file is None or error.fields.get("other", Path()).suffix != Path(error.file).suffix:
                raise
            continue  # names with dots, which the layout takes for extensions
        matches = _without_masks(match for match in matches if not _is_other(match.camera))
        # next to other files, or with such names, images are rarely footage
        if layout in _VIDEOS_ONLY:
            matches = [match for match in matches if match.path.suffix.lower() in VIDEO_EXTENSIONS]
        if layout == "{frame}/{camera}.*" and not _folders_are_frames(base, matches):
            continue
        if matches:
            return prefix + _with_extension(layout, matches), matches
    return None


def _one_level_down(root: Path, listing: Callable[[], Sequence[str]]) -> tuple[str, list[Match]] | None:
    """A usual layout in the only folder of `root` that has one."""
    layout = None
    for folder in _folders(root):
        inner = _usual_layout(root, f"{folder}/", listing)
        if inner is not None and layout is not None:
            return None
        layout = inner or layout
    return layout


def _folders(root: Path) -> list[str]:
    return sorted(
        entry.name for entry in root.iterdir() if entry.is_dir() and not _is_other(entry.name)
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
        return {Path(entry["file_path"]).stem for entry in parse_json(read_bounded(path))["frames"]}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def _masks_named_in(path: Path) -> tuple[list[str], set[str]]:
    """Patterns of files and names of folders that the `mask_path` of the entries of a transforms.json have."""
    try:
        entries = parse_json(read_bounded(path))["frames"]
        pairs = [(PurePosixPath(entry["file_path"]), PurePosixPath(entry["mask_path"])) for entry in entries]
    except (OSError, ValueError, KeyError, TypeError):
        return [], set()
    patterns = {str(mask).replace(image.stem, "{camera}") for image, mask in pairs}
    folders = {mask.parts[0] for _, mask in pairs if len(mask.parts) > 1}
    return list(patterns) if len(patterns) == 1 else [], folders


def _only_folder(root: Path, listing: Sequence[str]) -> tuple[str, list[Match]] | None:
    """The images in the only folder that has several."""
    counts = Counter(Path(path).parent.as_posix() for path in _of_kind(listing, IMAGE_EXTENSIONS))
    several = [folder for folder, count in counts.items() if count > 1]
    folders = [folder for folder in several if folder != "."] or several
    if len(folders) != 1:
        return None
    layout = "{camera}.*" if folders[0] == "." else f"{folders[0]}/{{camera}}.*"
    matches = find_files(root, layout)
    return _with_extension(layout, matches), matches


def _is_other(folder: str) -> bool:
    """Return whether files in a folder of this name are not footage."""
    return any(names.fullmatch(folder) for names in (MASK_FOLDERS, PLATE_FOLDERS, _OTHER_FOLDERS))


def _is_mask(path: str, stems: Collection[str]) -> bool:
    """Return whether a file is the mask of one beside it, such as 0001_mask.png of 0001.jpg."""
    match = _MASK_FILE.fullmatch(Path(path).stem)
    return match is not None and (match[1] or match[2]) in stems


def _without_masks(matches: Iterable[Match]) -> list[Match]:
    kept = list(matches)
    stems = {match.path.stem for match in kept}
    return [match for match in kept if not _is_mask(match.path.name, stems)]


def _of_kind(listing: Sequence[str], extensions: frozenset[str]) -> list[str]:
    """The paths that may be footage."""
    paths = [Path(relative) for relative in listing]
    stems = {path.stem for path in paths}
    return [
        path.as_posix()
        for path in paths
        if path.suffix.lower() in extensions
        and not any(_is_other(part) for part in path.parts[:-1])
        and not _is_mask(path.name, stems)
    ]


def parts_pattern(paths: Sequence[str]) -> str | None:
    """The pattern that joins videos named CAMERA and a number, such as cam0_001.mp4, to one recording per camera."""
    best = next((layout for layout in infer_layouts(paths) if layout.is_grid), None)
    if best is None or not all(map(looks_like_camera, best.cameras)):
        return None
    return best.pattern.replace("{frame}", "{chapter}")


def _grids(paths: Sequence[str]) -> list[str]:
    """Patterns of images that give several cameras with several frames each; of the same files, the likeliest."""
    grids: list[Layout] = []
    taken: set[str] = set()
    for group in groups_of(paths):
        best = next(iter(infer_layouts(group)), None) if not taken & set(group) else None
        if best is not None and best.is_grid:
            grids.append(best)
            taken |= set(group)
    return [layout.pattern for layout in grids]


def _as_grid(root: Path, layout: tuple[str, list[Match]]) -> tuple[str, list[Match]]:
    """Pattern and files of `layout`, as several cameras with several frames each if their names say so and its pattern
    does not."""
    images = [match for match in layout[1] if match.path.suffix.lower() in IMAGE_EXTENSIONS]
    several = len({match.camera for match in images}) > 1, len({match.frame for match in images}) > 1
    if len(images) < len(layout[1]) or all(several):
        return layout
    grids = _grids([match.path.relative_to(root).as_posix() for match in images])
    return _matching(root, grids[0]) if len(grids) == 1 else layout


def _as_chapters(root: Path, layout: tuple[str, list[Match]]) -> tuple[str, list[Match]] | None:
    """Videos in one folder that have a camera's name before or after GoPro's, such as cam0_GX010042.MP4."""
    pattern, matches = layout
    names = [match.path.name for match in matches]
    if len({match.path.parent for match in matches}) > 1:
        return None
    folder, _, _ = pattern.rpartition("{camera}")
    for form, shape in (
        (r"(?P<camera>.+?)(?P<between>[-_ .]*)(?P<own>G.*)", "{{camera}}{}G{{chapter}}????"),
        (r"(?P<own>G.*?)(?P<between>[-_ .]+)(?P<camera>.+)", "G{{chapter}}????{}{{camera}}"),
    ):
        parts = [re.fullmatch(form, Path(name).stem) for name in names]
        cameras: dict[str, list[str]] = {}
        for part, name in zip(parts, names, strict=True):
            if part is None:
                break
            cameras.setdefault(part["camera"], []).append(part["own"] + Path(name).suffix)
        else:
            between = {part["between"] for part in parts if part is not None}
            if len(between) == 1 and all(map(_are_chapters, cameras.values())):
                return _matching(root, _with_extension(f"{folder}{shape.format(between.pop())}.*", matches))
    return None


def _matching(root: Path, pattern: str) -> tuple[str, list[Match]]:
    return pattern, _without_masks(find_files(root, pattern))


def _video_layouts(paths: Sequence[str]) -> list[str]:
    """Patterns of videos that are in no usual layout: the only one, or several to choose from."""
    folders: dict[str, list[str]] = {}
    for path in paths:
        folders.setdefault(Path(path).parent.as_posix(), []).append(Path(path).name)
    extensions = {Path(path).suffix for path in paths}
    extension = extensions.pop() if len(extensions) == 1 else ".*"
    shape = _folder_per_camera(list(folders))
    if shape is not None:
        if all(len(names) == 1 for names in folders.values()):
            same = {names[0] for names in folders.values()}
            return [f"{shape}/{same.pop() if len(same) == 1 else f'*{extension}'}"]
        if all(_are_chapters(names) for names in folders.values()):
            return [f"{shape}/G{{chapter}}????{extension}"]
        common = set.intersection(*(set(names) for names in folders.values()))
        several = [f"{shape}/{name}" for name in sorted(common)], _each(folders, extension)
        if min(map(len, folders.values())) > 1:  # they may be parts of recordings
            stems = [Path(path).stem for path in paths]
            head, tail = shared_start(stems), shared_start([stem[::-1] for stem in stems])[::-1]
            several[0].insert(1, f"{shape}/{head}{{chapter}}{tail}{extension}")
        first = all(any(map(looks_like_camera, folder.split("/"))) for folder in folders)
        return [*several[not first], *several[first]]
    return _each(folders, extension)


def _each(folders: Mapping[str, Sequence[str]], extension: str) -> list[str]:
    return [f"{folder}/{{camera}}{extension}" for folder, names in sorted(folders.items()) if len(names) > 1]


def _folder_per_camera(folders: Sequence[str]) -> str | None:
    """The pattern of folders that differ in one place, the camera's name, and maybe in places below it."""
    columns = [set(column) for column in zip(*(folder.split("/") for folder in folders), strict=False)]
    if len({folder.count("/") for folder in folders}) > 1 or len(folders) < 2:
        return None
    camera = next(index for index, names in enumerate(columns) if len(names) > 1)
    if len(columns[camera]) < len(folders):
        return None
    parts = [next(iter(names)) if len(names) == 1 else "*" for names in columns]
    return "/".join([*parts[:camera], "{camera}", *parts[camera + 1 :]])


def _are_chapters(names: Sequence[str]) -> bool:
    """Return whether GoPro names these as parts of one recording: GX010042.MP4, GX020042.MP4; GOPR0042.MP4,
    GP010042.MP4."""
    chapters = [_CHAPTER.fullmatch(name) for name in names]
    return all(chapters) and len({match[1] for match in chapters if match is not None}) == 1


_CHAPTER = re.compile(r"G[A-Z](?:\d\d|PR)(\d{4})\.\w+")


def chapters_of_one(paths: Sequence[str]) -> list[str]:
    """The first files that GoPro cameras would name as parts of one recording; empty if there are none."""
    recordings: dict[tuple[Path, str], list[str]] = {}
    for path in map(Path, paths):
        chapter = _CHAPTER.fullmatch(path.name)
        if chapter is not None:
            recordings.setdefault((path.parent, chapter[1]), []).append(path.name)
    return next((sorted(parts) for parts in recordings.values() if len(parts) > 1), [])


def _ambiguous(root: Path, patterns: Sequence[str]) -> StudioError:
    """Names what could be footage; each suggestion has been tried."""
    counts = {}
    for pattern in patterns[:_MOST_SUGGESTED]:
        with contextlib.suppress(StudioError):
            counts[pattern] = len({match.camera for match in find_files(root, pattern)})
    named = " and ".join(
        f"'{pattern}' ({counted(cameras, 'camera')}{_PARTS if '{chapter}' in pattern else ''})"
        for pattern, cameras in counts.items()
        if cameras
    )
    best = max(counts, key=lambda pattern: counts[pattern])
    problem = f"found footage in several places: {named}"
    fix = f"Choose the footage with capture.images, for example '{best}', or move away what does not belong to it."
    return StudioError(
        "footage.ambiguous_layout", problem, file=root, value=list(counts), fix=fix, setting="capture.images"
    )


def _folders_are_frames(root: Path, matches: Sequence[Match]) -> bool:
    """Return whether NUMBER/NUMBER.png means frame/camera, not camera/frame, as in HiFi4G (transforms.json beside
    folders)."""
    cameras = {match.camera for match in matches}
    if all(camera.isdigit() for camera in cameras):
        named = named_in(root / "transforms.json")
        return bool(named) and named <= cameras
    return len(matches) == len({match.frame for match in matches}) * len(cameras) and len(cameras) > 1


def _with_extension(layout: str, matches: Sequence[Match]) -> str:
    """The layout, with `.*` replaced by the extension if all files have the same one."""
    extensions = {match.path.suffix for match in matches}
    return layout[:-2] + extensions.pop() if len(extensions) == 1 and layout.endswith(".*") else layout


def all_beside(root: Path, folders: re.Pattern[str], cameras: Sequence[str]) -> Iterator[tuple[str, list[Match]]]:
    """Patterns of masks or clean plates, each with the files of `cameras` that match it, the most likely first; some
    may match the same files. `folders`, `MASK_FOLDERS` or `PLATE_FOLDERS`, are looked for below `root`, the folders of
    the frames or those of the cameras. Masks may also be beside the images."""
    wanted = set(cameras)
    listing = cache(lambda: list(walk(root, _DEPTH)))
    named, own = _masks_named_in(root / "transforms.json") if folders is MASK_FOLDERS else ([], set())
    for pattern in named:
        matched = _of_cameras(root, pattern, wanted)
        if matched is not None:
            yield matched
    inside: dict[str, list[str]] = {}
    for path in listing():
        for name in path.split("/")[:-1]:
            if folders.fullmatch(name) or name in own:
                inside.setdefault(name, []).append(path)
    if len(inside) > 1:  # as in cam0_mask, cam1_mask, ...
        together = sorted({path for paths in inside.values() for path in paths})
        named = [layout.pattern for group in groups_of(together) for layout in infer_layouts(group, wanted)]
    for name in sorted(inside, key=lambda name: (len(name), name)):
        for pattern in (
            f"{name}/{{camera}}/{{camera}}_mask{{frame}}.*",  # ActorsHQ
            f"{name}/{{camera}}/{{camera}}_{{frame}}_*.*",  # ZJU-MoCap, the first subjects
            f"{name}/{{frame}}/img_{{camera}}.*",  # ReRF
            f"{{frame}}/{name}/image_c_{{camera}}_f_{{frame}}.*",  # PKU-DyMVHumans, data_COLMAP
            f"img/{{frame}}/{name}/img_{{camera}}.*",  # NHR
            *_of_objects(inside[name], wanted),
            *(layout.pattern for group in groups_of(inside[name]) for layout in infer_layouts(group, wanted)),
        ):
            matched = _of_cameras(root, pattern, wanted)
            if matched is not None:
                yield matched
                break
    patterns = [f"{{camera}}/{name}.*" for name in _PLATE_FILES] if folders is PLATE_FOLDERS else []
    patterns += named
    if folders is MASK_FOLDERS:
        stems = {Path(path).stem for path in listing()}
        beside = [path for path in listing() if _is_mask(path, stems)]
        patterns += [layout.pattern for group in groups_of(beside) for layout in infer_layouts(group, wanted)]
    yield from (matched for pattern in patterns if (matched := _of_cameras(root, pattern, wanted)) is not None)


def _of_objects(paths: Sequence[str], cameras: Collection[str]) -> list[str]:
    """The pattern of masks in a folder or file per object, such as masks/cam0/001/00000.png, in a list; empty if the
    paths are no such files."""
    depths = Counter(path.count("/") for path in paths)
    depth = max(depths, key=lambda depth: depths[depth], default=0)
    split = [(*path.split("/")[:-1], PurePosixPath(path).stem) for path in paths if path.count("/") == depth]
    extensions = {PurePosixPath(path).suffix for path in paths}
    extension = extensions.pop() if len(extensions) == 1 else ".*"
    patterns: dict[str, int] = {}
    for column in range(1, depth + 1):
        objects = {parts[column] for parts in split}
        rest = {(*parts[:column], *parts[column + 1 :]) for parts in split}
        if len(objects) < 2 or objects & set(cameras) or len(rest) == len(split):
            continue
        layouts = infer_layouts(sorted("/".join(parts) + ".png" for parts in rest), cameras)
        if layouts and layouts[0].is_grid:
            parts = layouts[0].pattern.removesuffix(".png").split("/")
            patterns["/".join([*parts[:column], "{object}", *parts[column:]]) + extension] = len(objects)
    return sorted(patterns, key=lambda pattern: patterns[pattern])[:1]


def folders_named(root: Path, folders: re.Pattern[str]) -> list[str]:
    """Names of the folders below `root` with such a name that have files."""
    names = {name for path in walk(root, _DEPTH) for name in path.split("/")[:-1] if folders.fullmatch(name)}
    return sorted(names)


def _of_cameras(root: Path, pattern: str, wanted: Collection[str]) -> tuple[str, list[Match]] | None:
    matches = [match for match in find_files(root, pattern) if match.camera in wanted]
    return (_with_extension(pattern, matches), matches) if matches else None
