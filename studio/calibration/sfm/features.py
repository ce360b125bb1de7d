"""COLMAP's features and matches, into a database with one image a camera. Runs inside the worker's process.

Of several moments of the same fixed cameras, each is searched and matched on its own; then all keypoints of a camera
become one image, because the camera has one pose. That is a rig with as little freedom as fixed cameras have: COLMAP's
own rigs would let the whole rig move from moment to moment.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Callable
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.sfm.pairs import FEW, glance

_out_lock = threading.Lock()


def say(**values: Any) -> None:
    """One JSON line to the parent."""
    with _out_lock:
        print(json.dumps(values), flush=True)


@contextmanager
def polled(step: str, total: int, count: Callable[[], int]) -> Any:
    """Reports a count that a native call drives, twice a second."""
    done = threading.Event()

    def watch() -> None:
        while not done.wait(0.5):
            say(step=step, done=min(count(), total), total=total)

    thread = threading.Thread(target=watch, daemon=True)
    say(step=step, done=0, total=total)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
    say(step=step, done=total, total=total)


def count_rows(database: Path, query: str) -> int:
    """A number from a database that another thread is filling."""
    try:
        with sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=0.1) as connection:
            return int(connection.execute(query).fetchone()[0])
    except sqlite3.Error:
        return 0


def file_name(number: int, sync_frame: int) -> str:
    """Of a camera's picture of a moment; the first one also names the camera and gives the points their colors."""
    return image_name(number) if sync_frame == 0 else f"{number:04d}_{sync_frame:03d}.png"


def image_name(number: int) -> str:
    """Of a camera in the database that is mapped."""
    return f"{number:04d}.png"


def find_matches(folder: Path, job: dict[str, Any]) -> Path:
    """Features and verified matches of all pictures.

    Args:
        folder: the work folder with images/ and masks/.
        job: see `worker.Worker`.

    Returns:
        the database to map: image n + 1 is camera n.
    """
    final, each = folder / "database.db", folder / "moments.db"
    for leftover in (*folder.glob("database.db*"), *folder.glob("moments.db*")):
        leftover.unlink()
    _import(each, job)
    _extract(each, folder, job)
    _match(each, folder, job)
    _merge(each, final, job)
    return final


def _import(path: Path, job: dict[str, Any]) -> None:
    """Every picture with its lens, in the order of cameras and moments, so that numbers do not depend on threads."""
    import pycolmap

    database = pycolmap.Database.open(path)
    lenses = write_lenses(database, job)
    for number, lens in enumerate(job["lens_of"]):
        for sync_frame in range(job["sync_frames"]):
            write_image(database, file_name(number, sync_frame), *lenses[lens])
    database.close()


def write_lenses(database: Any, job: dict[str, Any]) -> list[tuple[Any, Any]]:
    """Cameras, each with a rig of its own, in the order of `lenses`."""
    import pycolmap

    found = []
    for lens in job["lenses"]:
        camera = pycolmap.Camera(model=lens["model"], width=lens["width"], height=lens["height"], params=lens["params"])
        camera.has_prior_focal_length = bool(lens["prior"])
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(camera.sensor_id)
        rig.rig_id = database.write_rig(rig)
        found.append((camera, rig))
    return found


def write_image(database: Any, name: str, camera: Any, rig: Any) -> int:
    """An image with a frame of its own; its number in the database."""
    import pycolmap

    image = pycolmap.Image(name=name, camera_id=camera.camera_id)
    image.image_id = database.write_image(image)
    frame = pycolmap.Frame()
    frame.rig_id = rig.rig_id
    frame.add_data_id(image.data_id)
    frame.frame_id = database.write_frame(frame)
    return int(image.image_id)


def _extract(path: Path, folder: Path, job: dict[str, Any]) -> None:
    import pycolmap

    reader = pycolmap.ImageReaderOptions()
    if job["masks"]:
        reader.mask_path = folder / "masks"
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = int(job["threads"])
    options.use_gpu = False
    options.max_image_size = int(job["max_image_size"])
    options.sift.max_num_features = int(job["max_features"])
    names = [
        file_name(number, sync_frame) for number in range(len(job["names"])) for sync_frame in range(job["sync_frames"])
    ]
    with polled("features", len(names), lambda: count_rows(path, "SELECT COUNT(*) FROM keypoints")):
        pycolmap.extract_features(
            path,
            folder / "images",
            image_names=names,
            reader_options=reader,
            extraction_options=options,
            device=pycolmap.Device.cpu,
        )


def _match(path: Path, folder: Path, job: dict[str, Any]) -> None:
    """Pairs of cameras at the same moment: those given, else all of few cameras, else those that a glance chooses."""
    cameras, sync_frames = len(job["names"]), int(job["sync_frames"])
    pairs = [tuple(pair) for pair in job["pairs"]]
    if not pairs and cameras > FEW:
        middle = sync_frames // 2

        def prepare(database: Any) -> list[int]:
            lenses = write_lenses(database, job)
            return [write_image(database, image_name(n), *lenses[lens]) for n, lens in enumerate(job["lens_of"])]

        def match(preview: Path, every: list[tuple[int, int]]) -> None:
            names = [(image_name(a), image_name(b)) for a, b in every]
            _match_images(preview, folder, job, names, "glance", _verification(job, fewest=5))

        pictures = [number * sync_frames + middle + 1 for number in range(cameras)]
        pairs = glance(path, folder / "glance.db", pictures, prepare, match)
    pairs = pairs or list(combinations(range(cameras), 2))
    names = [(file_name(a, t), file_name(b, t)) for t in range(sync_frames) for a, b in pairs]
    _match_images(path, folder, job, names, "matches", _verification(job))


def _match_images(
    path: Path, folder: Path, job: dict[str, Any], pairs: list[tuple[str, str]], step: str, verification: Any
) -> None:
    """Match and verify pairs of pictures by name."""
    import pycolmap

    listed = folder / "pairs.txt"
    listed.write_text("".join(f"{first} {second}\n" for first, second in pairs))
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = int(job["threads"])
    matching.use_gpu = False
    matching.guided_matching = bool(job["guided"]) and step == "matches"
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = listed
    with polled(step, len(pairs), lambda: count_rows(path, "SELECT COUNT(*) FROM two_view_geometries")):
        pycolmap.match_image_pairs(
            path,
            matching_options=matching,
            pairing_options=pairing,
            verification_options=verification,
            device=pycolmap.Device.cpu,
        )


def _verification(job: dict[str, Any], fewest: int | None = None) -> Any:
    import pycolmap

    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = int(job["seed"])
    if fewest is not None:
        options.min_num_inliers = fewest
    return options


def _merge(each: Path, final: Path, job: dict[str, Any]) -> None:
    """One image a camera: its keypoints of all moments one after the other, and the matches with them."""
    import pycolmap

    source, target = pycolmap.Database.open(each), pycolmap.Database.open(final)
    lenses = write_lenses(target, job)
    sync_frames = int(job["sync_frames"])
    starts: dict[int, int] = {}  # number of a picture to its first keypoint's place
    for number, lens in enumerate(job["lens_of"]):
        image_id = write_image(target, image_name(number), *lenses[lens])
        parts, at = [], 0
        for sync_frame in range(sync_frames):
            picture = number * sync_frames + sync_frame + 1
            keypoints = source.read_keypoints(picture)
            starts[picture] = at
            at += len(keypoints)
            parts.append(np.asarray(keypoints))
        target.write_keypoints(image_id, np.concatenate(parts))
    together: dict[tuple[int, int], list[np.ndarray]] = {}
    keys, _ = source.read_two_view_geometry_num_inliers()
    for key in keys:
        first, second = pycolmap.pair_id_to_image_pair(key)
        found = np.asarray(source.read_two_view_geometry(first, second).inlier_matches).reshape(-1, 2)
        if len(found):
            pair = ((first - 1) // sync_frames + 1, (second - 1) // sync_frames + 1)
            together.setdefault(pair, []).append(found + np.array([starts[first], starts[second]]))
    for (first, second), matches in sorted(together.items()):
        target.write_matches(first, second, np.concatenate(matches).astype(np.uint32))
    source.close()
    target.close()
    verifier = pycolmap.GeometricVerifierOptions()
    verifier.num_threads = int(job["threads"])
    pycolmap.geometric_verification(final, verifier_options=verifier, two_view_geometry_options=_verification(job))
