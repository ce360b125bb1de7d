"""COLMAP features and matches in a database with one image per camera. Runs in the worker process.

With several sync frames of fixed cameras, features are detected and matched per sync frame; then all keypoints of a
camera become one image, because the camera has one pose. COLMAP's rigs would let the rig move between sync frames.
"""

import json
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing, contextmanager
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.sfm.job import SfmJob, file_name
from v3studio.studio.calibration.sfm.pairs import FEW, largest, worthwhile

_MAX_IMAGE_SIZE = 2400  # longer side in pixels; larger images are downscaled for feature detection
_out_lock = threading.Lock()


def say(**values: Any) -> None:
    """Print one JSON line for the parent process."""
    with _out_lock:
        print(json.dumps(values), flush=True)


@contextmanager
def polled(step: str, total: int, count: Callable[[], int]) -> Any:
    """Report the progress of a native call twice per second, by polling `count`."""
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


def count_rows(database: Path, query: str, written: bool = False) -> int:
    """The result of a count query on a database; 0 if it cannot be read.

    Args:
        written: COLMAP is writing to it. COLMAP has an SQLite of its own, and two in one process do not see each
            other's locks: without readonly_shm, this one would truncate the index that the other has mapped, which
            loses rows or ends the process (https://www.sqlite.org/howtocorrupt.html, section 2.2.1).
    """
    options = "mode=ro&readonly_shm=1" if written else "mode=ro"
    try:
        with closing(sqlite3.connect(f"file:{database}?{options}", uri=True, timeout=0.1)) as connection:
            return int(connection.execute(query).fetchone()[0])
    except sqlite3.Error:
        return 0


def find_matches(folder: Path, job: SfmJob) -> Path:
    """Detect features, match and verify them; the database for mapping, where camera n has image n + 1."""
    final, each = folder / "database.db", folder / "sync_frames.db"
    for leftover in (*folder.glob("database.db*"), *folder.glob("sync_frames.db*")):
        leftover.unlink()
    with pycolmap.Database.open(each) as database:
        write_images(database, job, job.sync_frames)
    _extract(each, folder, job)
    _match(each, folder, job)
    merge_sync_frames(each, final, job)
    return final


def write_images(database: Any, job: SfmJob, sync_frames: int = 1) -> None:
    """Write the job's cameras, each with a rig, and images of sync frames, each with a frame, in a fixed order, so that
    ids do not depend on threads: the images of camera n have ids from n * sync_frames + 1 on."""
    cameras = []
    for own in job.intrinsics:
        camera = pycolmap.Camera(model=own.model, width=own.width, height=own.height, params=own.params)
        camera.has_prior_focal_length = own.prior
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(camera.sensor_id)
        rig.rig_id = database.write_rig(rig)
        cameras.append((camera, rig))
    for number, index in enumerate(job.intrinsics_of):
        camera, rig = cameras[index]
        for sync_frame in range(sync_frames):
            image = pycolmap.Image(name=file_name(number, sync_frame), camera_id=camera.camera_id)
            image.image_id = database.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig.rig_id
            frame.add_data_id(image.data_id)
            database.write_frame(frame)


def _extract(path: Path, folder: Path, job: SfmJob) -> None:
    reader = pycolmap.ImageReaderOptions()
    if job.masks:
        reader.mask_path = folder / "masks"
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = job.threads
    options.use_gpu = False
    options.max_image_size = _MAX_IMAGE_SIZE
    options.sift.max_num_features = job.max_features
    names = [file_name(number, sync_frame) for number in range(len(job.names)) for sync_frame in range(job.sync_frames)]
    images, cpu, count = folder / "images", pycolmap.Device.cpu, "SELECT COUNT(*) FROM keypoints"
    with polled("features", len(names), lambda: count_rows(path, count, written=True)):
        # Once, on a busy machine, COLMAP left an image out silently. A second call continues with those that
        # are missing; an image without any feature is not missing.
        for _ in range(2):
            pycolmap.extract_features(
                path, images, image_names=names, reader_options=reader, extraction_options=options, device=cpu
            )
            if count_rows(path, count) >= len(names):
                break


def _match(path: Path, folder: Path, job: SfmJob) -> None:
    """Match camera pairs per sync frame: the given pairs, all pairs of a few cameras, or the pairs of a preview."""
    pairs = list(job.pairs)
    if not pairs and len(job.names) > FEW:
        pairs = _preview_pairs(path, folder, job)
    pairs = pairs or list(combinations(range(len(job.names)), 2))
    names = [(file_name(a, t), file_name(b, t)) for t in range(job.sync_frames) for a, b in pairs]
    _match_images(path, folder, job, names, "matches", _verification(job))


def _preview_pairs(path: Path, folder: Path, job: SfmJob) -> list[tuple[int, int]]:
    """Pairs of cameras (0-based, the smaller first) worth matching, by their largest features in the middle sync frame;
    see `studio.calibration.sfm.pairs`."""
    preview = folder / "preview.db"
    preview.unlink(missing_ok=True)
    with pycolmap.Database.open(path) as full, pycolmap.Database.open(preview) as small:
        write_images(small, job)
        for number in range(len(job.names)):
            picture = number * job.sync_frames + job.sync_frames // 2 + 1
            keypoints = np.asarray(full.read_keypoints(picture))
            descriptors = full.read_descriptors(picture)
            chosen = largest(keypoints)
            small.write_keypoints(number + 1, keypoints[chosen])
            descriptors.data = np.asarray(descriptors.data)[chosen]
            small.write_descriptors(number + 1, descriptors)
    names = list(combinations(map(file_name, range(len(job.names))), 2))
    _match_images(preview, folder, job, names, "preview", _verification(job, fewest=5))
    with pycolmap.Database.open(preview) as small:
        keys, counts = small.read_two_view_geometry_num_inliers()
    match_counts = {}
    for key, count in zip(keys, counts, strict=True):
        first, second = sorted(pycolmap.pair_id_to_image_pair(key))
        match_counts[first - 1, second - 1] = int(count)
    for leftover in folder.glob("preview.db*"):
        leftover.unlink()
    return worthwhile(match_counts, len(job.names))


def _match_images(
    path: Path, folder: Path, job: SfmJob, pairs: list[tuple[str, str]], step: str, verification: Any
) -> None:
    """Match and verify pairs of images, given by name."""
    listed = folder / "pairs.txt"
    listed.write_text("".join(f"{first} {second}\n" for first, second in pairs))
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = job.threads
    matching.use_gpu = False
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = listed
    verified = "SELECT COUNT(*) FROM two_view_geometries"
    options = {"matching_options": matching, "pairing_options": pairing, "verification_options": verification}
    with polled(step, len(pairs), lambda: count_rows(path, verified, written=True)):
        pycolmap.match_image_pairs(path, **options, device=pycolmap.Device.cpu)


def _verification(job: SfmJob, fewest: int | None = None) -> Any:
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = job.seed
    if fewest is not None:
        options.min_num_inliers = fewest
    return options


def verify(path: Path, job: SfmJob) -> None:
    """Verify the matches of each sync frame again, with the lenses of a job, in place."""
    with pycolmap.Database.open(path) as database:
        for number, own in enumerate(job.intrinsics, 1):
            camera = pycolmap.Camera(model=own.model, width=own.width, height=own.height, params=own.params)
            camera.camera_id, camera.has_prior_focal_length = number, own.prior
            database.update_camera(camera)
        database.clear_two_view_geometries()
    _verify(path, job)


def _verify(path: Path, job: SfmJob) -> None:
    verifier = pycolmap.GeometricVerifierOptions()
    verifier.num_threads = job.threads
    pycolmap.geometric_verification(path, verifier_options=verifier, two_view_geometry_options=_verification(job))


def merge_sync_frames(each: Path, final: Path, job: SfmJob) -> None:
    """One image per camera: its keypoints of all sync frames concatenated, with the matches renumbered."""
    with pycolmap.Database.open(each) as source, pycolmap.Database.open(final) as target:
        write_images(target, job)
        sync_frames = job.sync_frames
        starts: dict[int, int] = {}  # image id to the index of its first keypoint
        for number in range(len(job.names)):
            parts, at = [], 0
            for sync_frame in range(sync_frames):
                picture = number * sync_frames + sync_frame + 1
                keypoints = source.read_keypoints(picture)
                starts[picture] = at
                at += len(keypoints)
                parts.append(np.asarray(keypoints))
            target.write_keypoints(number + 1, np.concatenate(parts))
        together: dict[tuple[int, int], list[np.ndarray]] = {}
        keys, _ = source.read_two_view_geometry_num_inliers()
        for key in keys:
            first, second = pycolmap.pair_id_to_image_pair(key)
            inliers = np.asarray(source.read_two_view_geometry(first, second).inlier_matches).reshape(-1, 2)
            if len(inliers):
                pair = ((first - 1) // sync_frames + 1, (second - 1) // sync_frames + 1)
                together.setdefault(pair, []).append(inliers + np.array([starts[first], starts[second]]))
        for (first, second), matches in sorted(together.items()):
            target.write_matches(first, second, np.concatenate(matches).astype(np.uint32))
    _verify(final, job)
