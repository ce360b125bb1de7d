"""Diagnosis of an empty visual hull: finds the cameras whose masks disagree with the others."""

from typing import NoReturn

import torch

from studio.errors import StudioError
from studio.meshing.silhouettes import Silhouette


def raise_disagreement(shapes: list[Silhouette], points: torch.Tensor, slack: float, min_views: int) -> NoReturn:
    """Raise an error that names the cameras that reject the (N, 3) float32 world points, covering the expected hull, on
    which most other cameras agree. `slack`: distance in world units by which a point may be outside a silhouette cone;
    `min_views`: number of cameras that must see a point."""
    rejections, visible = [], []
    for shape in shapes:
        value, seen = shape.distance(points)
        rejections.append(seen & (value < -slack))
        visible.append(seen)
    rejected, sees = torch.stack(rejections), torch.stack(visible)
    views = sees.sum(0)
    names, count = [shape.camera.name for shape in shapes], len(shapes)
    most = int(views.max())
    if most < min_views:
        problem = (
            f"The visual hull is empty: no point is seen by more than {most} of {count} cameras, but {min_views} are "
            "required"
        )
        raise StudioError("hull.no_overlap", problem, value=most, fix="Check the camera poses.", expected=min_views)
    agreement = (sees & ~rejected).sum(0).float() / views.clamp_min(1)
    agreement[views < min_views] = -1
    top = agreement >= agreement.max() - 1e-6
    share = rejected[:, top].float().mean(1)
    outliers = [names[i] for i in torch.argsort(share, descending=True).tolist() if share[i] > 0.25]
    empty = [shape.camera.name for shape in shapes if shape.box is None]
    hint = f" (empty masks: {', '.join(empty)})" if empty else ""
    if len(outliers) > count // 2 or not outliers:
        cameras = outliers or names
        problem = f"The visual hull is empty: the masks of {', '.join(cameras)} have no common volume{hint}"
        fix = "Check the camera poses and the masks."
        raise StudioError("hull.masks_disagree", problem, fix=fix, cameras=tuple(cameras), empty=tuple(empty))
    problem = (
        f"The visual hull is empty: the masks of {', '.join(outliers)}{hint} disagree with those of the other "
        f"{count - len(outliers)} cameras"
    )
    fix = "Fix these masks, or exclude these cameras."
    raise StudioError("hull.masks_disagree", problem, fix=fix, cameras=tuple(outliers), empty=tuple(empty))
