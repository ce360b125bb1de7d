"""All settings of a run: one section per stage, composed of the library's settings models.

`studio.settings` describes the library's settings models. Only settings specific to the pipelines are declared here:
grouping, evaluation and the run itself.
"""

import os
from functools import reduce
from operator import getitem
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, JsonValue, field_validator

from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.meshing.settings import InitializeSettings
from v3studio.studio.settings import Affects, Color, Conflict, Empty, Heading, Name, Settings, affected
from v3studio.studio.stream.settings import BakeSettings
from v3studio.studio.training.settings import GROUP_SIZE, TrainSettings


class GroupSettings(Settings):
    """Settings that decide where groups begin."""

    group_size: Annotated[int, Heading("Groups"), Affects("grouping")] = Field(default=GROUP_SIZE, ge=1, le=1000)
    """Maximum number of frames per group. Groups are shorter where the performer moves fast: a group's frames are not
    farther from its keyframe than about half the performer's size. The frame in the middle is trained first, as a
    keyframe, and the frames after and before it follow. The paper uses 20, and begins with the keyframe."""


# Fields of the last base come first.
class TrainStageSettings(TrainSettings, GroupSettings):
    """Training a group: a keyframe, then motion and fine-tuning, frame by frame."""


class EvaluateSettings(Settings):
    """Measuring the trained and the baked frames."""

    affects: ClassVar[Affects | None] = Affects("evaluation")

    crop_padding: Annotated[int, Heading("Evaluation")] = Field(default=8, ge=0, le=10_000)
    """Metrics are computed in the bounding box of the performer's mask, padded by this many pixels."""

    exact_masks: Annotated[Name | None, Empty("as in training")] = None
    """Pattern of ground-truth masks, relative to capture.root, if the capture has them. They are never used for
    training. null: the masks that training uses."""

    background: Annotated[Color, Affects("evaluation", "manifest")] = (0.0, 0.0, 0.0)
    """Background color behind the performer in evaluation and previews (red, green, blue; 0 to 1)."""

    lpips: Annotated[Literal["alex", "vgg"] | None, Empty("not measured")] = None
    """Also compute LPIPS, with AlexNet (alex, recommended by its authors for comparisons) or VGG16 (vgg). null: no. The
    network's weights (244 or 553 MB) are downloaded from download.pytorch.org on first use."""


class RunSettings(Settings):
    """The run itself: seed, device, threads."""

    affects: ClassVar[Affects | None] = Affects()

    seed: Annotated[
        int, Heading("Run"), Affects("cameras_from_images", "cameras_from_points", "initial_points", "set", "keyframe")
    ] = Field(default=0, ge=0, lt=2**31)
    """Random seed: equal seeds give equal takes."""

    device: str = "auto"
    """Device for training and rendering: cpu, cuda, cuda:N, or auto (a GPU if available)."""

    threads: Annotated[int | None, Empty("one per core")] = Field(default=None, ge=1, le=1024)
    """CPU threads. null: one per core."""

    groups_at_once: Annotated[int | None, Empty("automatic")] = Field(default=None, ge=1, le=64)
    """Groups trained in parallel, sharing the CPU threads. null: on a CPU as many as threads and memory allow, at most
    8; on a GPU one."""

    check_rig: bool = True
    """Stop at `initialize` if cameras, images and masks contradict each other. false: only warn."""

    check_footage: bool = True
    """Read all frames while training begins and stop at broken footage (unreadable files, empty or all-white masks).
    false: such frames are only found when their turn comes, and training skips a camera in frames where it does not see
    the performer."""

    live: bool = False
    """Bake each group as soon as it is trained, while others train, and publish the groups in order: `v3studio serve`
    shows the take from its first group on, and players follow. The finished stream is the same."""

    preview_seconds: float = Field(default=20.0, ge=0)
    """Minimum interval between preview images during training, in seconds. 0: no previews."""

    executor: Annotated[Literal["local", "ray"], Heading("Several machines")] = "local"
    """Where groups run. local: in this process. ray: as tasks of a Ray cluster, which needs the package ray; all nodes
    must see the take and the footage (under other paths: run.paths)."""

    address: str = Field(default="local", min_length=1)
    """The Ray cluster: HOST:PORT of its head node from a node of the cluster, ray://HOST:10001 from outside, auto for
    the cluster that runs on this machine, or local to start one on this machine for this run."""

    gpus_per_group: Annotated[float | None, Empty("automatic")] = Field(default=None, ge=0, le=16)
    """GPUs that a group takes on a Ray cluster; 0.5: two groups share one. null: 1 if the cluster has GPUs and device
    is not cpu, else 0."""

    memory_per_group: Annotated[float | None, Empty("automatic")] = Field(default=None, gt=0, le=4096)
    """Memory in GB that a group takes on a Ray cluster, so that fewer run at once on small nodes. null: estimated from
    the images. It is raised when a node runs out of memory."""

    paths: Annotated[dict[str, tuple[str, ...]], Empty("none")] = Field(default={})
    """Other paths of shared folders on other machines; example: {/mnt/footage: [/Volumes/footage]}. A machine without
    the folder /mnt/footage looks for the footage, and for the take of a Ray run, below the first of the listed folders
    that it has."""

    @property
    def thread_count(self) -> int:
        """CPU threads: `threads`, or one per core that this process may use."""
        return self.threads or len(os.sched_getaffinity(0))

    @field_validator("paths", mode="before")
    @classmethod
    def _one_or_several(cls, value: Any) -> Any:
        return (
            {key: (place,) if isinstance(place, str) else place for key, place in value.items()}
            if isinstance(value, dict)
            else value
        )

    @field_validator("paths")
    @classmethod
    def _whole_paths(cls, value: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
        for path in (path for key, others in value.items() for path in (key, *others)):
            if not path.startswith("/"):
                raise Conflict(f"'{path}' is not a whole path", "Paths begin with /.")
        return value

    @field_validator("device")
    @classmethod
    def _known_device(cls, value: str) -> str:
        kind, _, index = value.partition(":")
        if kind not in ("auto", "cpu", "cuda") or (index and (kind != "cuda" or not index.isdecimal())):
            raise Conflict("must be auto, cpu, cuda or cuda:N")
        return value


class Config(Settings):
    """All settings of a run."""

    capture: CaptureSettings = CaptureSettings()
    calibrate: CalibrateSettings = CalibrateSettings()
    initialize: InitializeSettings = InitializeSettings()
    train: TrainStageSettings = TrainStageSettings()
    bake: BakeSettings = BakeSettings()
    evaluate: EvaluateSettings = EvaluateSettings()
    run: RunSettings = RunSettings()


def values_of(config: Config) -> dict[str, JsonValue]:
    """All settings, JSON-ready, by dotted name."""
    sections = config.model_dump(mode="json")
    return {name: reduce(getitem, name.split("."), sections) for name in affected(Config)}
