"""Structure from motion in a process of its own: `python -m studio.calibration.sfm.worker JOB.json`.

COLMAP's calls cannot be interrupted and a fault in native code would end the caller, so they run here. Progress goes
to standard output as JSON lines `{"step", "done", "total"}`; a last line `{"finished": true}` or `{"error": "..."}`.
The process ends when its standard input closes or its parent dies. Work folder: `images/`, `masks/` (both numbered),
`job.json` in, `database.db`, `solution.json` and `points.npz` out.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.sfm.features import find_matches, say
from studio.calibration.sfm.mapping import Mapper
from studio.calibration.sfm.verdict import match_inlier_ratio
from studio.standard_output import claim_stdout


class Worker:
    """One job.

    Args:
        folder: the work folder.
        job: what `sfm.reconstruct` wrote: names; moments (how many pictures a camera); lenses (model, width,
            height, params, prior, known) and lens_of (index of a lens for each name); masks; pairs (of numbers, [] for
            all); poses ((3, 4) a camera or []); the settings.
    """

    def __init__(self, folder: Path, job: dict[str, Any]) -> None:
        self.folder = folder
        self.job = job

    def run(self) -> None:
        """Features, matches, mapping, result."""
        import pycolmap

        pycolmap.logging.minloglevel = 3
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # COLMAP's own handler prints a stack
        pycolmap.set_random_seed(int(self.job["seed"]))
        self.solve(find_matches(self.folder, self.job))

    def solve(self, database: Path) -> None:
        """Mapping and result, from a database with matches."""
        mapper = Mapper(self.folder, database, self.job)
        model, how = mapper.solve()
        self._write(database, model, how, mapper.sharing)

    def _write(self, database_path: Path, model: Any, how: str, sharing: list[dict[str, Any]]) -> None:
        """Cameras, points, every observation, and what is known of the cameras that found no place."""
        import pycolmap

        names = self.job["names"]
        database = pycolmap.Database.open(database_path)
        features = {number: int(database.num_keypoints_for_image(number + 1)) for number in range(len(names))}
        database.close()
        pairs = self._pairs(database_path)
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
        explained = match_inlier_ratio(model, database_path) if model is not None else 0.0
        solution = {
            "mapper": how,
            "cameras": cameras,
            "features": features,
            "pairs": pairs,
            "match_inlier_ratio": round(explained, 4),
            "sharing": [{**found, "images": [image - 1 for image in found["images"]]} for found in sharing],
        }
        (self.folder / "solution.json").write_text(json.dumps(solution))

    def _pairs(self, database_path: Path) -> list[tuple[int, int, int]]:
        """Image numbers and verified matches of every pair that has any."""
        import pycolmap

        database = pycolmap.Database.open(database_path)
        keys, counts = database.read_two_view_geometry_num_inliers()
        database.close()
        pairs = [pycolmap.pair_id_to_image_pair(key) for key in keys]
        return [(int(a) - 1, int(b) - 1, int(n)) for (a, b), n in zip(pairs, counts, strict=True) if n]


def _die_with_parent() -> None:
    """Ask Linux to kill this process when its parent dies: a native call may keep every Python thread waiting."""
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
    _die_with_parent()
    path = Path(sys.argv[1])
    try:
        Worker(path.parent, json.loads(path.read_text())).run()
    except Exception as error:
        say(error=f"{type(error).__name__}: {error}")
        return 1
    say(finished=True)
    return 0


if __name__ == "__main__":
    claim_stdout()  # COLMAP may print there
    code = main()
    sys.stdout.flush()
    os._exit(code)  # a thread still waits for standard input
