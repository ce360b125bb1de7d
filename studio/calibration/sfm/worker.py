"""Structure from motion in a child process: `python -m v3studio.studio.calibration.sfm.worker JOB.json`.

COLMAP calls cannot be interrupted, and a crash in native code would end the calling process, so they run in this one.
Progress is printed as JSON lines `{"step", "done", "total"}`, an error as `{"error": {...}}`, the fields of its
`Message`. The process ends when its standard input closes or its parent dies. Input in the work folder: `images/`,
`masks/` (numbered) and `job.json`; output: `database.db`, `solution.json` and `points.npz`.
"""

import os
import signal
import sys
import threading
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.report import SharedIntrinsicsReport, SolutionReport
from v3studio.studio.calibration.sfm.features import find_matches, say
from v3studio.studio.calibration.sfm.fisheyes import asks_for_fisheyes, with_fisheyes
from v3studio.studio.calibration.sfm.job import SfmJob, SfmSolution
from v3studio.studio.calibration.sfm.mapping import Mapper
from v3studio.studio.calibration.sfm.shared_intrinsics import LIMIT, in_given_pixels, square_pixels
from v3studio.studio.calibration.sfm.uncertainty import uncertainties
from v3studio.studio.calibration.sfm.verdict import match_inlier_ratio, match_inlier_ratios
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.process import claim_stdout


def run(folder: Path, job: SfmJob) -> None:
    """Detect and match features, map, write the result."""
    pycolmap.logging.minloglevel = 3
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # COLMAP's own handler prints a stack trace
    pycolmap.set_random_seed(job.seed)
    solve(folder, find_matches(folder, job), job)


def solve(folder: Path, database_path: Path, job: SfmJob) -> None:
    """Map a database with matches. Writes cameras, points, observations, and the match counts of all images, registered
    or not."""
    mapper = Mapper(folder, database_path, job)
    model, how = mapper.solve()
    if job.find_wide and asks_for_fisheyes(mapper, model):
        mapper, model, how = with_fisheyes(mapper, model, how)
        database_path, job = mapper.database, mapper.job
    names = job.names
    matches, partners = dict.fromkeys(names, 0), dict.fromkeys(names, 0)
    with pycolmap.Database.open(database_path) as database:
        features = {name: int(database.num_keypoints_for_image(number)) for number, name in enumerate(names, 1)}
        for key, count in zip(*database.read_two_view_geometry_num_inliers(), strict=True):
            for image in pycolmap.pair_id_to_image_pair(key):
                name = names[image - 1]
                matches[name] += int(count)
                partners[name] = max(partners[name], int(count))
    cameras = []
    observations: list[tuple[int, int, float, float]] = []
    ids: dict[int, int] = {}
    figures: dict[str, Any] = {}
    if model is not None:
        factors = square_pixels(mapper.aspect)
        ids = {key: order for order, key in enumerate(sorted(model.points3D))}
        for image in sorted(model.images.values(), key=lambda image: image.name):
            if not image.has_pose:
                continue
            number, camera = int(Path(image.name).stem), model.cameras[image.camera_id]
            pose = np.asarray(image.cam_from_world().matrix())
            lens = in_given_pixels(camera, mapper.aspect)
            cameras.append(Camera(names[number], camera.width, camera.height, world_to_camera=pose, **lens).to_dict())
            for point in image.points2D:
                if point.has_point3D():
                    x, y = point.xy / factors
                    observations.append((number, ids[point.point3D_id], float(x), float(y)))
        sigmas = uncertainties(model, job, centers=mapper.recentered)
        agreeing = match_inlier_ratios(model, database_path)
        figures = {
            "match_inlier_ratio": round(match_inlier_ratio(model, database_path), 4),
            "agree": {names[image - 1]: round(ratio, 3) for image, ratio in agreeing.items()},
            "uncertain": {names[image - 1]: round(position, 5) for image, (position, _) in sigmas.items()},
            "uncertain_degrees": {names[image - 1]: round(degrees, 3) for image, (_, degrees) in sigmas.items()},
        }
    kept = [model.points3D[key] for key in ids]
    np.savez(
        folder / "points.npz",
        points=np.array([point.xyz for point in kept], np.float64).reshape(-1, 3),
        colors=np.array([point.color for point in kept], np.uint8).reshape(-1, 3),
        observations=np.array(observations, np.float64).reshape(-1, 4),
    )
    sharing = [
        SharedIntrinsicsReport(
            images=[names[image - 1] for image in images], shared=growth < LIMIT, misfit=round(growth, 2)
        )
        for images, growth in mapper.sharing
    ]
    report = SolutionReport(
        mapper=how,
        features=features,
        matches=matches,
        sharing=sharing,
        aspect=mapper.aspect,
        **figures,
    )
    solution = SfmSolution(cameras=tuple(cameras), partners=partners, report=report)
    (folder / "solution.json").write_text(solution.model_dump_json(exclude_unset=True), encoding="utf-8")


def die_with_parent() -> None:
    """Have Linux kill this process when its parent dies: a native call may block all Python threads."""
    if sys.platform == "linux":
        import ctypes

        PR_SET_PDEATHSIG = 1
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def main() -> int:
    """Run the job file named on the command line."""

    def end_with_parent() -> None:
        sys.stdin.buffer.read()
        os._exit(3)

    threading.Thread(target=end_with_parent, daemon=True).start()
    die_with_parent()
    path = Path(sys.argv[1])
    try:
        run(path.parent, SfmJob.model_validate_json(path.read_text(encoding="utf-8")))
    except StudioError as error:  # a camera that was solved is invalid
        fix = "Use more frames (calibrate.frame_count), a board or marked points."
        say(error=asdict(replace(error.message, fix=fix)))
        return 1
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        say(error=asdict(Message("calibration.worker_failed", f"Structure from motion failed: {text}", value=text)))
        return 1
    return 0


if __name__ == "__main__":
    claim_stdout()  # COLMAP may print there
    code = main()
    sys.stdout.flush()
    os._exit(code)  # a thread is still blocked on standard input
