"""A capture small enough to go through the whole pipeline in seconds: a moving textured ball."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from tests.support.events import events_in
from tests.support.rigs import on_circle, pose
from tests.support.warm_python import warm_python
from v3studio.pipelines.config import Config, load_config, parse_override
from v3studio.pipelines.events import Event, Finished
from v3studio.pipelines.takes.take import Take

WIDTH, HEIGHT, FRAMES = 64, 48, 5
RADIUS = 0.55
CAMERAS = tuple(f"cam{number}" for number in range(6))
ROOT = Path(__file__).parents[2]

SETTINGS = """
capture:
  root: capture
  images: images/{camera}/{frame:03d}.png
  rig: cameras.json
  masks: alpha
  held_out: [cam4]
  fps: 25
initialize: {points: 400, resolution: 32}
train:
  group_size: 3
  keyframe_iterations: 25
  densify_from: 5
  densify_until: 15
  densify_every: 5
  densify_max_splats: 600
  prune_finetune_iterations: 5
  max_splats: 400
  motion_iterations: 10
  finetune_iterations: 20
  hash_levels: 4
run: {threads: 1, preview_seconds: 0}
"""


def ball(K: np.ndarray, R: np.ndarray, t: np.ndarray, center: np.ndarray) -> np.ndarray:
    """(H, W, 4) uint8 RGBA: the ray-cast ball, colored by its surface coordinates."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    rays = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones_like(rows)], -1) @ R
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    eye = -R.T @ t
    along = rays @ (center - eye)
    inside = RADIUS**2 - (np.linalg.norm(center - eye) ** 2 - along**2)
    hit = inside > 0
    surface = (eye + rays * (along - np.sqrt(np.maximum(inside, 0)))[..., None] - center) / RADIUS
    color = 0.5 + 0.4 * np.sin(surface * [4.0, 5.0, 6.0] + [0.0, 1.0, 2.0])
    image = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    image[hit, :3] = color[hit] * 255
    image[hit, 3] = 255
    return image


def write_capture(root: Path, frames: int = FRAMES) -> None:
    """images/camN/FFF.png with alpha, and cameras.json."""
    K = np.array([[70.0, 0, WIDTH / 2], [0, 70.0, HEIGHT / 2], [0, 0, 1]])
    rig = []
    for number, name in enumerate(CAMERAS):
        world_to_camera = pose(on_circle(2 * np.pi * number / len(CAMERAS), 3.0, 0.8))
        R, t = world_to_camera[:3, :3], world_to_camera[:3, 3]
        rig.append({"name": name, "width": WIDTH, "height": HEIGHT, "K": K.tolist(), "R": R.tolist(), "t": t.tolist()})
        folder = root / "images" / name
        folder.mkdir(parents=True)
        for frame in range(frames):
            image = ball(K, R, t, np.array([0.03 * frame, 0.02 * frame, 0.0]))
            assert cv2.imwrite(str(folder / f"{frame:03d}.png"), cv2.cvtColor(image, cv2.COLOR_RGBA2BGRA))
    (root / "cameras.json").write_text(json.dumps({"cameras": rig}))


def write_project(folder: Path) -> None:
    """`capture/` and `ball.yaml` in a folder."""
    write_capture(folder / "capture")
    (folder / "ball.yaml").write_text(SETTINGS)


class Done(NamedTuple):
    """Output and exit code of a command."""

    returncode: int
    stdout: str
    stderr: str

    def ok(self) -> "Done":
        """Itself; fails unless the command succeeded."""
        assert self.returncode == 0, self.stderr
        return self

    def fails(self, *words: str, code: int = 1) -> "Done":
        """Itself; fails unless the command failed with this code, and these words in what it said."""
        assert self.returncode == code, self.stderr
        for part in words:
            assert part in self.stderr
        return self

    @property
    def result(self) -> Any:
        """The result of the last event, with --json."""
        last = self.events[-1]
        assert isinstance(last, Finished)
        return last.result

    @property
    def events(self) -> list[Event]:
        """The events, with --json."""
        return events_in(self.stdout)


Here = Callable[..., Done]


def v3studio(*arguments: object) -> Done:
    """Run the command line in a separate process, as a user or the window would."""
    done = warm_python().run(("-m", "v3studio.pipelines.cli", *arguments), text=True, env=environment())
    return Done(done.returncode, done.stdout, done.stderr)


def environment() -> dict[str, str]:
    """Environment with the checkout on the path, wherever the command starts."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return {**os.environ, "PYTHONPATH": path, "COLUMNS": "200"}


def results(take: Path) -> dict[str, bytes]:
    """Trained frames, initial points, the stream and the evaluation by path; not what says how long they took."""
    folders = [take / name for name in ("initialize", "train", "stream")]
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.name != "group.json"]
    return {path.relative_to(take).as_posix(): path.read_bytes() for path in (*files, take / "evaluation.json")}


def settings_in(project: Path, *overrides: str) -> Config:
    """The settings in `ball.yaml`, with others such as `bake.quality=30`."""
    return load_config(project / "ball.yaml", [parse_override(text) for text in overrides])


def run_take(project: Path, *overrides: str, **options: Any) -> list[Event]:
    """Run the take `take/` of a project in this process, or begin it; its events."""
    from v3studio.pipelines.runs.runner import run

    events: list[Event] = []
    run(Take.create(project / "take"), settings_in(project, *overrides), events.append, **options)
    return events
