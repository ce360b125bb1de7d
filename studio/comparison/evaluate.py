"""The quality of splats against footage, by the protocol of the evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from v3studio.studio.comparison.metrics import Distance, measure
from v3studio.studio.comparison.view_pair import ViewPair, padded_box

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage
    from v3studio.studio.gaussians import Gaussians


def evaluate(
    gaussians: Gaussians,
    footage: Footage,
    frame: int,
    *,
    cameras: Sequence[str] = (),
    padding: int | None = 8,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    lpips: Distance | None = None,
    device: str = "cpu",
) -> dict[str, dict[str, float]]:
    """Measure splats on a frame, as the stage evaluate does: in the box around the performer.

    Example:
        >>> take = v3.Take.open("my-take")
        >>> footage = v3.open_footage(v3.load_config(take.config).capture, v3.read_rig(take.rig))
        >>> figures = v3.evaluate(v3.trained_video(take).read(0), footage, footage.frames[0])
        >>> sorted(figures), figures["cam4"]["psnr"] > 15
        (['cam4'], True)

    Args:
        gaussians: the splats of the frame.
        footage: opened with a rig, in the world of the splats.
        frame: its number in the footage.
        cameras: names; empty: the held-out cameras that have masks; without any, the training cameras.
        padding: pixels around the bounding box of the performer's mask; None: the full frame. PSNR of the full frame
            is higher, since most of it is background: compare only figures with the same padding.
        background: RGB, 0 to 1, behind performer and splats.
        lpips: the metric; None: it is not measured.
        device: torch device to render on.

    Returns:
        by camera, the metrics by name, see `METRICS`. Cameras that do not see the performer are left out.

    Raises:
        StudioError: `footage.unknown_camera`, `footage.no_such_frame`, an unreadable image or mask.
    """
    results = {}
    for camera in cameras or footage.measured_cameras or footage.train_cameras:
        mask = footage.evaluation_mask(camera, frame)
        box = None if padding is None else padded_box(mask, padding)
        if padding is None or box is not None:
            view = footage.rig[camera]
            pair = ViewPair.of(gaussians, view, footage.image(camera, frame), mask, background, box, device)
            results[camera] = measure(pair, lpips)
    return results
