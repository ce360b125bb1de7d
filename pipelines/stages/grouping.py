"""How far the performer moves, which decides where groups begin: see `pipelines.takes.frames.groups`.

The stage `initialize` finds it once, on a few cameras, and stores it in the take.
"""

from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.training_views import within_box
from v3studio.pipelines.takes.files.digests import digest_of
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.results.stage_files import FoundMotion
from v3studio.studio.progress import ProgressFn

CAMERAS = 4  # maximum number of training cameras to look at, evenly spaced


def find_motion(inputs: Inputs, progress: ProgressFn) -> bool:
    """Find how far the performer moves and write it to `Take.motion`. False: it was known."""
    path, seen, frames = inputs.take.motion, inputs.seen_by_training(), inputs.raw_footage.frames
    key = digest_of([1, seen, list(frames), result_of(inputs.take, "calibrate")])
    since = inputs.since.get("initialize", 0)
    if path.is_file() and path.stat().st_mtime_ns >= since and read_model(path, FoundMotion).key == key:
        return False
    from v3studio.studio.footage.motion import motion

    footage, box = inputs.calibrated_footage, inputs.training_box
    names = footage.train_cameras
    cameras = tuple(dict.fromkeys(names[index * len(names) // CAMERAS] for index in range(CAMERAS if names else 0)))
    moved = []
    before = [within_box(footage.view(name, footage.frames[0]), box) for name in cameras]
    for number, frame in enumerate(footage.frames[1:], 1):
        progress(number, len(footage.frames))
        after = [within_box(footage.view(name, frame), box) for name in cameras]
        found = [motion((a.image, b.image), (a.mask, b.mask)) for a, b in zip(before, after, strict=True)]
        known = [one for one in found if one is not None]
        moved.append(round(sum(known) / max(len(known), 1), 4))
        before = after
    inputs.take.forget("initialize")
    write_model(path, FoundMotion(key=key, frames=footage.frames, motion=tuple(moved), cameras=cameras))
    return True
