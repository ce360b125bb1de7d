"""Structure from motion in a child process: `python -m studio.calibration.sfm.worker JOB.json`.

COLMAP calls cannot be interrupted, and a crash in native code would end the calling process, so they run in this one.
Progress is printed as JSON lines `{"step", "done", "total"}`; the last line is `{"finished": true}` or
`{"error": "..."}`. The process ends when its standard input closes or its parent dies. Input in the work folder:
`images/`, `masks/` (numbered) and `job.json`; output: `database.db`, `solution.json` and `points.npz`.
"""

import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.sfm.features import find_matches, say
from studio.calibration.sfm.job import SfmJob, SfmSolution, SolvedCamera
from studio.calibration.sfm.mapping import Mapper
from studio.calibration.sfm.shared_intrinsics import in_given_pixels, square_pixels
from studio.calibration.sfm.uncertainty import uncertainties
from studio.calibration.sfm.verdict import match_inlier_ratio, match_inlier_ratios
from studio.process import claim_stdout


class Worker:
    """One job."""

    def __init__(self, folder: Path, job: SfmJob) -> None:
        self.folder = folder
        self.job = job

    def run(self) -> None:
        """Detect and match features, map, write the result."""
        import pycolmap

        pycolmap.logging.minloglevel = 3
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # COLMAP's own handler prints a stack trace
        pycolmap.set_random_seed(self.job.seed)
        self.solve(find_matches(self.folder, self.job))

    def solve(self, database: Path) -> None:
        """Map a database with matches and write the result."""
        mapper = Mapper(self.folder, database, self.job)
        model, how = mapper.solve()
        self._write(database, model, how, mapper)

    def _write(self, database_path: Path, model: Any, how: str, mapper: Mapper) -> None:
        """Write cameras, points, observations, and the match counts of all images, registered or not."""
        import pycolmap

        names = self.job.names
        database = pycolmap.Database.open(database_path)
        features = {number: int(database.num_keypoints_for_image(number + 1)) for number in range(len(names))}
        database.close()
        pairs = self._pairs(database_path)
        cameras: list[SolvedCamera] = []
        observations: list[tuple[int, int, float, float]] = []
        ids: dict[int, int] = {}
        if model is not None:
            factors = square_pixels(mapper.aspect)
            agreeing = match_inlier_ratios(model, database_path)
            uncertain = uncertainties(model, self.job, self.job.threads, centers=mapper.recentered)
            for order, key in enumerate(sorted(model.points3D)):
                ids[key] = order
            for image in sorted(model.images.values(), key=lambda image: image.name):
                if not image.has_pose:
                    continue
                number = int(Path(image.name).stem)
                name, params = in_given_pixels(model.cameras[image.camera_id], mapper.aspect)
                cameras.append(
                    SolvedCamera(
                        number=number,
                        model=name,
                        params=params,
                        pose=np.asarray(image.cam_from_world().matrix()).tolist(),
                        agree=agreeing.get(image.image_id),
                        uncertain=uncertain.get(image.image_id),
                    )
                )
                for point in image.points2D:
                    if point.has_point3D():
                        x, y = point.xy / factors
                        observations.append((number, ids[point.point3D_id], float(x), float(y)))
        kept = [model.points3D[key] for key in sorted(ids)] if model is not None else []
        np.savez(
            self.folder / "points.npz",
            points=np.array([point.xyz for point in kept], np.float64).reshape(-1, 3),
            colors=np.array([point.color for point in kept], np.uint8).reshape(-1, 3),
            observations=np.array(observations, np.float64).reshape(-1, 4),
        )
        ratio = match_inlier_ratio(model, database_path) if model is not None else 0.0
        solution = SfmSolution(
            mapper=how,
            cameras=tuple(cameras),
            features=features,
            pairs=tuple(pairs),
            match_inlier_ratio=round(ratio, 4),
            sharing=tuple(
                test.model_copy(update={"images": tuple(image - 1 for image in test.images)}) for test in mapper.sharing
            ),
            recentered=mapper.recentered,
            aspect=mapper.aspect,
        )
        (self.folder / "solution.json").write_text(solution.model_dump_json(), encoding="utf-8")

    def _pairs(self, database_path: Path) -> list[tuple[int, int, int]]:
        """Camera numbers and number of verified matches of each pair that has any."""
        import pycolmap

        database = pycolmap.Database.open(database_path)
        keys, counts = database.read_two_view_geometry_num_inliers()
        database.close()
        pairs = [pycolmap.pair_id_to_image_pair(key) for key in keys]
        return [(int(a) - 1, int(b) - 1, int(n)) for (a, b), n in zip(pairs, counts, strict=True) if n]


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
        Worker(path.parent, SfmJob.model_validate_json(path.read_text(encoding="utf-8"))).run()
    except Exception as error:
        say(error=f"{type(error).__name__}: {error}")
        return 1
    say(finished=True)
    return 0


if __name__ == "__main__":
    claim_stdout()  # COLMAP may print there
    code = main()
    sys.stdout.flush()
    os._exit(code)  # a thread is still blocked on standard input
