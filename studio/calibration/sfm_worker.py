"""Structure from motion in a process of its own: `python -m studio.calibration.sfm_worker JOB.json`.

COLMAP's calls cannot be interrupted and a fault in native code would end the caller, so they run here. Progress goes
to standard output as JSON lines `{"step", "done", "total"}`; a last line `{"finished": true}` or `{"error": "..."}`.
The process ends when its standard input closes: it does not outlive its parent. Work folder: `images/`, `masks/`
(both numbered), `job.json` in, `database.db`, `solution.json` and `points.npz` out.
"""

from __future__ import annotations

import json
import os
import sqlite3
import sys
import threading
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

_out_lock = threading.Lock()


def _say(**values: Any) -> None:
    with _out_lock:
        print(json.dumps(values), flush=True)


@contextmanager
def _polled(step: str, total: int, count: Callable[[], int]) -> Any:
    """Reports a count that a native call drives, twice a second."""
    done = threading.Event()

    def watch() -> None:
        while not done.wait(0.5):
            _say(step=step, done=min(count(), total), total=total)

    thread = threading.Thread(target=watch, daemon=True)
    _say(step=step, done=0, total=total)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
    _say(step=step, done=total, total=total)


class Worker:
    """One job.

    Args:
        folder: the work folder.
        job: what `studio.calibration.sfm` wrote: names; lenses (model, width, height, params, prior, known) and lens_of
            (index of a lens for each name); masks; the settings.
    """

    def __init__(self, folder: Path, job: dict[str, Any]) -> None:
        self.folder = folder
        self.job = job
        self.database = folder / "database.db"
        self.threads = int(job["threads"])
        self.seed = int(job["seed"])

    def _count(self, query: str) -> int:
        try:
            with sqlite3.connect(f"file:{self.database}?mode=ro", uri=True, timeout=0.1) as connection:
                return int(connection.execute(query).fetchone()[0])
        except sqlite3.Error:
            return 0

    def run(self) -> None:
        """Features, matches, mapping, result."""
        import pycolmap

        pycolmap.logging.minloglevel = 3
        pycolmap.set_random_seed(self.seed)
        for leftover in self.folder.glob("database.db*"):
            leftover.unlink()
        self._import()
        self._extract()
        self._match()
        model, mapper = self._map()
        self._write(model, mapper)

    def _import(self) -> None:
        """Images and their lenses, in the order of the names, so that numbers do not depend on threads."""
        import pycolmap

        database = pycolmap.Database.open(self.database)
        cameras, rigs = {}, {}
        for index, lens in enumerate(self.job["lenses"]):
            camera = pycolmap.Camera(
                model=lens["model"], width=lens["width"], height=lens["height"], params=lens["params"]
            )
            camera.has_prior_focal_length = bool(lens["prior"])
            camera.camera_id = database.write_camera(camera)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(camera.sensor_id)
            rig.rig_id = database.write_rig(rig)
            cameras[index], rigs[index] = camera, rig
        for number, lens_index in enumerate(self.job["lens_of"]):
            image = pycolmap.Image(name=f"{number:04d}.png", camera_id=cameras[lens_index].camera_id)
            image.image_id = database.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rigs[lens_index].rig_id
            frame.add_data_id(image.data_id)
            frame.frame_id = database.write_frame(frame)
        database.close()

    def _extract(self) -> None:
        import pycolmap

        reader = pycolmap.ImageReaderOptions()
        if self.job["masks"]:
            reader.mask_path = self.folder / "masks"
        options = pycolmap.FeatureExtractionOptions()
        options.num_threads = self.threads
        options.use_gpu = False
        options.max_image_size = int(self.job["max_image_size"])
        options.sift.max_num_features = int(self.job["max_features"])
        names = [f"{number:04d}.png" for number in range(len(self.job["names"]))]
        with _polled("features", len(names), lambda: self._count("SELECT COUNT(*) FROM keypoints")):
            pycolmap.extract_features(
                self.database,
                self.folder / "images",
                image_names=names,
                reader_options=reader,
                extraction_options=options,
                device=pycolmap.Device.cpu,
            )

    def _match(self) -> None:
        import pycolmap

        matching = pycolmap.FeatureMatchingOptions()
        matching.num_threads = self.threads
        matching.use_gpu = False
        matching.guided_matching = bool(self.job["guided"])
        verification = pycolmap.TwoViewGeometryOptions()
        verification.ransac.random_seed = self.seed
        count = len(self.job["names"])
        pairs = count * (count - 1) // 2
        with _polled("matches", pairs, lambda: self._count("SELECT COUNT(*) FROM two_view_geometries")):
            pycolmap.match_exhaustive(
                self.database,
                matching_options=matching,
                verification_options=verification,
                device=pycolmap.Device.cpu,
            )

    def _map(self) -> tuple[Any, str]:
        """The model with the most cameras of the attempts allowed, and how it was found."""
        wanted = {"incremental": ["incremental", "lenient"], "global": ["global"]}.get(
            self.job["mapper"], ["incremental", "lenient", "global"]
        )
        best, how = None, ""
        for attempt in wanted:
            models = self._global() if attempt == "global" else self._incremental(attempt == "lenient")
            for model in models:
                if best is None or model.num_reg_images() > best.num_reg_images():
                    best, how = model, attempt
            if best is not None and best.num_reg_images() == len(self.job["names"]):
                break
        return best, how

    def _incremental(self, lenient: bool) -> list[Any]:
        import pycolmap

        options = pycolmap.IncrementalPipelineOptions()
        options.num_threads = self.threads
        options.random_seed = self.seed
        options.mapper.random_seed = self.seed
        options.triangulation.random_seed = self.seed
        options.mapper.num_threads = self.threads
        options.min_model_size = 2
        options.max_num_models = 4
        options.ba_refine_principal_point = bool(self.job["refine_principal_point"])
        if self.job["keep_known"]:
            options.constant_cameras = {i + 1 for i, lens in enumerate(self.job["lenses"]) if lens["known"]}
        if lenient:
            # Few cameras far apart share few points: accept weaker starts and weaker registrations.
            options.min_num_matches = 10
            options.mapper.init_min_num_inliers = 30
            options.mapper.init_min_tri_angle = 6.0
            options.mapper.abs_pose_min_num_inliers = 12
            options.mapper.abs_pose_min_inlier_ratio = 0.15
            options.triangulation.ignore_two_view_tracks = False
        total = len(self.job["names"])
        state = {"done": 0}

        def first_pair() -> None:
            state["done"] = 2
            _say(step="mapping", done=2, total=total)

        def next_image() -> None:
            state["done"] = min(state["done"] + 1, total)
            _say(step="mapping", done=state["done"], total=total)

        _say(step="mapping", done=0, total=total)
        out = self.folder / "models"
        out.mkdir(exist_ok=True)
        found = pycolmap.incremental_mapping(
            self.database,
            self.folder / "images",
            out,
            options=options,
            initial_image_pair_callback=first_pair,
            next_image_callback=next_image,
        )
        return list(found.values())

    def _global(self) -> list[Any]:
        import pycolmap

        options = pycolmap.GlobalPipelineOptions()
        options.num_threads = self.threads
        options.random_seed = self.seed
        options.min_model_size = 2
        if self.job["keep_known"] and any(lens["known"] for lens in self.job["lenses"]):
            # The global mapper cannot hold some lenses and refine others.
            options.mapper.bundle_adjustment.refine_focal_length = False
            options.mapper.bundle_adjustment.refine_extra_params = False
        out = self.folder / "models_global"
        out.mkdir(exist_ok=True)
        _say(step="global mapping", done=0, total=1)
        if not all(lens["prior"] for lens in self.job["lenses"]):
            # Unlike the incremental mapper the global one cannot find its way from a guessed focal length.
            calibration = pycolmap.ViewGraphCalibrationOptions()
            calibration.random_seed = self.seed
            pycolmap.calibrate_view_graph(self.database, calibration)
        found = pycolmap.global_mapping(self.database, self.folder / "images", out, options=options)
        return list(found.values())

    def _write(self, model: Any, mapper: str) -> None:
        """Cameras, points, every observation, and what is known of the cameras that found no place."""
        import pycolmap

        names = self.job["names"]
        database = pycolmap.Database.open(self.database)
        features = {number: int(database.num_keypoints_for_image(number + 1)) for number in range(len(names))}
        database.close()
        pairs = self._pairs()
        cameras: list[dict[str, Any]] = []
        observations: list[tuple[int, int, float, float]] = []
        ids: dict[int, int] = {}
        if model is not None:
            for order, key in enumerate(sorted(model.points3D)):
                ids[key] = order
            for image in sorted(model.images.values(), key=lambda image: image.name):
                if not image.has_pose:
                    continue
                number = int(Path(image.name).stem)
                lens = model.cameras[image.camera_id]
                cameras.append(
                    {
                        "number": number,
                        "model": lens.model.name,
                        "params": [float(p) for p in lens.params],
                        "pose": np.asarray(image.cam_from_world().matrix()).tolist(),
                    }
                )
                for point in image.points2D:
                    if point.has_point3D():
                        observations.append((number, ids[point.point3D_id], float(point.xy[0]), float(point.xy[1])))
        kept = [model.points3D[key] for key in sorted(ids)] if model is not None else []
        np.savez(
            self.folder / "points.npz",
            points=np.array([point.xyz for point in kept], np.float64).reshape(-1, 3),
            colors=np.array([point.color for point in kept], np.uint8).reshape(-1, 3),
            observations=np.array(observations, np.float64).reshape(-1, 4),
        )
        solution = {"mapper": mapper, "cameras": cameras, "features": features, "pairs": pairs}
        (self.folder / "solution.json").write_text(json.dumps(solution))

    def _pairs(self) -> list[tuple[int, int, int]]:
        """Image numbers and verified matches of every pair that has any."""
        import pycolmap

        database = pycolmap.Database.open(self.database)
        keys, counts = database.read_two_view_geometry_num_inliers()
        database.close()
        pairs = [pycolmap.pair_id_to_image_pair(key) for key in keys]
        return [(int(a) - 1, int(b) - 1, int(n)) for (a, b), n in zip(pairs, counts, strict=True) if n]


def main() -> int:
    """Run the job file named on the command line."""

    def end_with_parent() -> None:
        sys.stdin.buffer.read()
        os._exit(3)

    threading.Thread(target=end_with_parent, daemon=True).start()
    path = Path(sys.argv[1])
    try:
        Worker(path.parent, json.loads(path.read_text())).run()
    except Exception as error:
        _say(error=f"{type(error).__name__}: {error}")
        return 1
    _say(finished=True)
    return 0


if __name__ == "__main__":
    sys.stdout.flush()
    code = main()
    sys.stdout.flush()
    os._exit(code)  # a thread still waits for standard input
