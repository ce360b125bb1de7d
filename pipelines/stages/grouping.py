"""Measures how far the performer moves, which decides where groups begin: see `pipelines.takes.frames.groups`.

The stage `initialize` finds it once, on a few cameras, and stores it in the take.
"""

from v3studio.pipelines.stages.initialize_plan import InitializePlan
from v3studio.pipelines.stages.training.views import within_box
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.results.stage_files import FoundMotion
from v3studio.studio.progress import ProgressFn

CAMERAS = 4  # maximum number of training cameras to look at, evenly spaced


def find_motion(plan: InitializePlan, progress: ProgressFn) -> bool:
    """Find how far the performer moves and write it to `Take.motion`. False: it was known."""
    file, key = plan.take.motion, plan.motion_key
    if plan.is_current(file) and read_model(file, FoundMotion).key == key:
        return False
    from v3studio.studio.footage.motion import motion

    footage, box = plan.footage, plan.box
    names = footage.train_cameras
    cameras = tuple(dict.fromkeys(names[index * len(names) // CAMERAS] for index in range(CAMERAS if names else 0)))
    moved = []
    before = [within_box(footage.view(name, footage.frames[0]), box) for name in cameras]
    for number, frame in enumerate(footage.frames[1:], 1):
        progress(number, len(footage.frames))
        after = [within_box(footage.view(name, frame), box) for name in cameras]
        paths = [motion((a.image, b.image), (a.mask, b.mask)) for a, b in zip(before, after, strict=True)]
        known = [path for path in paths if path is not None]
        moved.append(round(sum(known) / max(len(known), 1), 4))
        before = after
    plan.take.forget("initialize")
    write_model(file, FoundMotion(key=key, frames=footage.frames, motion=tuple(moved), cameras=cameras))
    return True
