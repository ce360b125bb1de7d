"""Accuracy of the estimated motion: compares the translation of splats with that of the true surface.

    python benchmarks/motion_truth.py TAKE MESHES [--every N] [--json FILE]

TAKE is a trained take of a capture whose surface is known: MESHES/000000.ply, 000001.ply, ..., one mesh per frame, all
with the same vertices in the same order. For each frame except keyframes, the motion stage is run again from the
previous trained frame, with the take's settings and seed. Each splat is associated with the nearest point of the
surface in the previous frame, and the translations of both are compared:

    error  mean of |translation of the splat - translation of the surface| over all splats whose distance from the
           surface is below 2% of the performer's size
    moved  mean of |translation of the surface| over the same splats
    tied   fraction of the splats that are that close to the surface
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from studio.environment import passive_openmp
from studio.json_types import JsonObject

passive_openmp()  # before torch is imported

_NEAR = 0.02


def surface_motion(before: Path, after: Path, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) translations of the surface points nearest to (N, 3) points, and (N,) distances to them."""
    import open3d as o3d

    first, second = (o3d.io.read_triangle_mesh(str(path)) for path in (before, after))
    triangles = np.asarray(first.triangles)
    if not np.array_equal(triangles, np.asarray(second.triangles)):
        raise SystemExit(f"{before.name} and {after.name} do not have the same triangles, so points cannot be tracked.")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(first))
    found = scene.compute_closest_points(o3d.core.Tensor(points.astype(np.float32)))
    corners = triangles[found["primitive_ids"].numpy()]
    u, v = found["primitive_uvs"].numpy().T
    weights = np.stack([1 - u - v, u, v], 1)[..., None]
    shift = np.asarray(second.vertices) - np.asarray(first.vertices)
    distance = np.linalg.norm(found["points"].numpy() - points, axis=1)
    return (shift[corners] * weights).sum(1), distance


def main() -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--every", type=int, default=1, help="measure every Nth frame (default %(default)s)")
    parser.add_argument("--json", type=Path, help="also write the results to this file")
    arguments = parser.parse_args()

    from pipelines.config import load_config
    from pipelines.stages.inputs import Inputs
    from pipelines.stages.params import derived_seed
    from pipelines.takes.frame_files import read_frame
    from pipelines.takes.take import Take
    from studio.training import TrainingView, train_interframe

    take = Take.open(arguments.take)
    config = load_config(take.config)
    inputs = Inputs(take, config)
    footage = inputs.footage.calibrated
    settings = config.train.replace(finetune_iterations=0)
    rows: list[JsonObject] = []
    print(f"{'frame':>6} {'error':>9} {'moved':>9} {'ratio':>6} {'tied':>5} {'seconds':>8}   (world units)")
    for group in inputs.groups:
        for position in range(1, len(group.frames), arguments.every):
            index, frame = group.first + position, group.frames[position]
            previous = read_frame(take.trained_frame(group.index, index - 1))
            before = read_frame(take.trained_frame(group.index, index - 2)) if position > 1 else None
            third = read_frame(take.trained_frame(group.index, index - 3)) if position > 2 else None
            views = [
                TrainingView.from_view(footage.view(camera, frame), inputs.device, settings.crop_margin)
                for camera in footage.train_cameras
            ]
            started = time.monotonic()
            warped = train_interframe(
                previous.to(inputs.device),
                views,
                settings,
                before_previous=None if before is None else before.to(inputs.device),
                third_last=None if third is None else third.to(inputs.device),
                seed=derived_seed(config.run.seed, "train", group.index, position),
            ).warped.to("cpu")
            seconds = time.monotonic() - started
            names = [arguments.meshes / f"{number:06d}.ply" for number in (group.frames[position - 1], frame)]
            truth, distance = surface_motion(*names, previous.means.numpy())
            tied = distance < _NEAR * float(np.ptp(previous.means.numpy(), axis=0).max())
            ours = (warped.means - previous.means).numpy()
            rows.append(
                {
                    "frame": int(frame),
                    "error": float(np.linalg.norm(ours - truth, axis=1)[tied].mean()),
                    "moved": float(np.linalg.norm(truth, axis=1)[tied].mean()),
                    "tied": float(tied.mean()),
                    "seconds": seconds,
                }
            )
            row = rows[-1]
            print(
                f"{frame:6d} {row['error']:9.5f} {row['moved']:9.5f} {row['error'] / row['moved']:6.3f} "
                f"{row['tied']:5.2f} {seconds:8.1f}",
                flush=True,
            )
    if not rows:
        raise SystemExit("The take contains only keyframes.")
    error, moved = (sum(row[name] for row in rows) / len(rows) for name in ("error", "moved"))
    print(f"mean over {len(rows)} frames: error {error:.5f}, moved {moved:.5f}, ratio {error / moved:.3f}")
    if arguments.json:
        arguments.json.write_text(json.dumps({"frames": rows, "error": error, "moved": moved}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
