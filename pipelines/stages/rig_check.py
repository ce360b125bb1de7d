"""Checks before the first hull whether cameras, images and masks agree: a wrong rig costs hours of training."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from v3studio.pipelines.reports.calibration import write_calibration_page
from v3studio.pipelines.stages.initialize_plan import InitializePlan
from v3studio.pipelines.stages.params import key_of
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.studio.calibration.epipolar import PairMatches, match_images
from v3studio.studio.calibration.outlines import Outlines, outline
from v3studio.studio.calibration.report import RigVerdict
from v3studio.studio.calibration.verdict import judge
from v3studio.studio.cameras import Camera
from v3studio.studio.counts import counted, listed
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.progress import ProgressFn
from v3studio.studio.yaml_text import inline_yaml

if TYPE_CHECKING:
    from v3studio.studio.capture import CaptureSettings
    from v3studio.studio.footage import Footage, FootageView
    from v3studio.studio.masks.mask_source import MaskSource


_NAMED_PLACES = 3  # cameras of which the place is named where their masks contradict the others, the worst first
_NEAR = 8  # frames before and after in which it is searched whether a camera is late
_VERSION = 7  # of the judgment: another one judges again


class StoredVerdict(RigVerdict):
    """initialize/verdict.json."""

    key: str = ""  # digest of cameras, images and masks


class _Images(Mapping[str, np.ndarray]):
    """Images of one frame by camera, read on access: those of a large rig do not fit into memory together."""

    def __init__(self, footage: Footage, frame: int) -> None:
        self._footage, self._frame = footage, frame

    def __len__(self) -> int:
        return len(self._footage.rig)

    def __iter__(self) -> Iterator[str]:
        return iter(self._footage.rig.names)

    def __getitem__(self, name: str) -> np.ndarray:
        return self._footage.image(name, self._frame)


def judge_by_images(footage: Footage, frame: int, progress: ProgressFn) -> RigVerdict:
    """Judge the cameras of footage by matches between the images of a frame."""
    pairs = match_images(_Images(footage, frame), progress=progress)
    return judge({camera.name: camera for camera in footage.rig}, pairs, None)


def check_rig(plan: InitializePlan, group: Group, reporter: StageReporter) -> None:
    """Judge the rig by the images and masks of a keyframe, log the verdict, and store it. Raises StudioError: it is
    wrong (`rig.wrong`, `masks.contradiction`), unless `run.check_rig` is false."""
    key, path = key_of("verdict", _VERSION, plan.key(group)), plan.take.rig_verdict
    verdict = read_model(path, StoredVerdict) if plan.is_current(path) else None
    if verdict is None or verdict.key != key:
        verdict = StoredVerdict(key=key, **_judged(plan, group.keyframe, reporter).model_dump())
        path.parent.mkdir(parents=True, exist_ok=True)
        write_model(path, verdict)
        write_calibration_page(plan.take)
    if not verdict.blamed:
        reporter.log(f"cameras: {verdict.grade}. {verdict.reason}")
        return
    wrong, masks = verdict.grade == "wrong", verdict.blamed == "masks"
    code, setting, fix = "masks.contradiction" if masks else "rig.wrong", "run.check_rig", verdict.fix
    fields: dict[str, Any] = {"cameras": list(verdict.doubtful)}
    if masks and "capture.offsets" not in fix:
        setting, value, fix = remedy_of_masks(plan.inputs.capture, plan.footage.mask_source)
        fields |= {} if value is None else {"suggested": value}
    if wrong and plan.checks_rig:
        fix = f"{fix} To train anyway, set run.check_rig to false."
        raise StudioError(code, verdict.reason, fix=fix, setting=setting, **fields)
    warning = Message("rig.doubtful", verdict.reason, fix=fix, fields=fields)
    reporter.warn(replace(warning, code=code, fields={**fields, "setting": setting}) if wrong or masks else warning)


def remedy_of_masks(capture: CaptureSettings, source: MaskSource) -> tuple[str, list[str] | str | None, str]:
    """Return what to do about masks that contradict each other: a setting, its value if that is known, and a
    sentence."""
    from v3studio.studio.masks.agreement.source import AgreedMaskSource
    from v3studio.studio.masks.mask_files import FileMaskSource
    from v3studio.studio.masks.plain_background import PlainMaskSource

    votes = isinstance(source, AgreedMaskSource) and source.votes
    if votes and capture.mask_model is None:
        return "capture.mask_model", "auto", "Add the model for people: set capture.mask_model to auto."
    if votes:
        fix = "Draw garbage masks where the performer never is (Capture page), or record clean plates."
        return "capture.garbage_masks", None, fix
    known = {FileMaskSource: "files", PlainMaskSource: "plain"}.get(type(source), "alpha")
    names = [capture.masks if isinstance(capture.masks, str) and capture.masks != "auto" else known]
    names += ["model"] if capture.mask_model is not None and "model" not in names else []
    fix = f"Let the cameras agree on them: set capture.masks to {inline_yaml(names)}."
    return "capture.masks", names, fix


def _judged(plan: InitializePlan, frame: int, reporter: StageReporter) -> RigVerdict:
    from v3studio.studio.masks.agreement.source import AgreedMaskSource

    footage = plan.footage
    matching = reporter.part("checking the cameras", 0.0, 0.02)
    pairs = match_images(_Images(footage, frame), progress=matching)
    names = footage.train_cameras if plan.masked else ()

    def near(name: str) -> dict[int, np.ndarray]:
        if isinstance(footage.mask_source, AgreedMaskSource):  # agreed with the wrong frames of this camera
            return {}
        frames = set(footage.frames_of(name)) & set(range(frame - _NEAR, frame + _NEAR + 1)) - {frame}
        return {number: footage.mask(name, number) for number in sorted(frames)}

    looking = reporter.part("comparing the masks", 0.02, 0.02)
    views = []
    for number, name in enumerate(names):
        looking(number, len(names))
        views.append(footage.view(name, frame))
    return judge_views({camera.name: camera for camera in footage.rig}, pairs, views, near)


def judge_views(
    cameras: Mapping[str, Camera],
    pairs: Sequence[PairMatches],
    views: Sequence[FootageView],
    near: Callable[[str], Mapping[int, np.ndarray]],
) -> RigVerdict:
    """Judge a rig by the images and masks of a frame, the latter those of `views`, if they are enough. `near` gives
    masks of a camera in other frames, by frame; asked if one of a few cameras contradicts the others."""
    from v3studio.studio.meshing.agreement import LEAST_CAMERAS, PIXELS, frame_that_fits, least_views, mask_verdicts
    from v3studio.studio.meshing.silhouettes import silhouettes

    outlines = Outlines({view.camera.name: [outline(view.mask)] for view in views}) if views else None
    if len(views) < LEAST_CAMERAS:
        return judge(cameras, pairs, None, outlines=outlines)
    shapes = silhouettes(views, max_pixels=PIXELS * len(views))
    least = least_views(shapes)
    verdicts = {verdict.camera: verdict for verdict in mask_verdicts(shapes, least)}
    disagreeing = [name for name, mask in verdicts.items() if mask.wrong]
    verdict = judge(cameras, pairs, {name: mask.error for name, mask in verdicts.items()}, disagreeing, outlines)
    if not disagreeing or "masks" not in verdict.blamed:
        return verdict
    frame, worst = views[0].frame, disagreeing[:_NAMED_PLACES]
    more = [places_of({name: verdicts[name].box for name in worst}, frame)]
    offsets = {}
    if verdict.grade != "wrong":
        fitting = {name: frame_that_fits(shapes, name, near(name), least) for name in worst}
        offsets = {name: other - frame for name, other in fitting.items() if other is not None}
    fix = verdict.fix
    if offsets:
        words = [f"{name} by about {counted(abs(by), 'frame')}" for name, by in offsets.items()]
        more.append(f"Out of time: {listed(words)}; the masks of those frames fit.")
        settings = ", ".join(f"{name}: {by}" for name, by in offsets.items())
        fix = f"Run `v3studio sync`, or add these frames to capture.offsets: {{{settings}}}."
    return verdict.model_copy(update={"reason": " ".join([verdict.reason, *more]), "fix": fix})


def places_of(boxes: Mapping[str, tuple[int, int, int, int] | None], frame: int) -> str:
    """A sentence on where masks contradict the others: by camera, left, top, right and bottom in pixels."""
    places = [
        f"{name} at x {box[0]} to {box[2]}, y {box[1]} to {box[3]}" for name, box in boxes.items() if box is not None
    ]
    return f"Where most, in pixels of frame {frame}: {'; '.join(places)}."
