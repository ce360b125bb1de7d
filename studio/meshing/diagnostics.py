"""Why a hull is empty: which cameras' masks do not go together with the others'."""

from __future__ import annotations

from typing import NoReturn

import torch

from studio.errors import StudioError
from studio.meshing.silhouettes import Silhouettes


def raise_disagreement(shapes: Silhouettes, points: torch.Tensor, slack: float, min_views: int) -> NoReturn:
    """Name the cameras that refuse the points on which most of the others agree.

    Args:
        shapes: the silhouettes.
        points: (N, 3) float32 world points that cover where the hull should be.
        slack: how far outside a silhouette cone a point may be to count as accepted, world units.
        min_views: how many cameras must see a point of the hull.

    Raises:
        StudioError: always.
    """
    refused, seen = [], []
    for index in range(len(shapes)):
        value, sees = shapes.distance(index, points)
        refused.append(sees & (value < -slack))
        seen.append(sees)
    refusal, sight = torch.stack(refused), torch.stack(seen)
    views = sight.sum(0)
    count = len(shapes)
    if int(views.max()) < min_views:
        raise StudioError(
            f"The visual hull is empty: no point is seen by more than {int(views.max())} of {count} cameras "
            f"where {min_views} are needed; check the camera poses (or lower min_view_share)."
        )
    agreement = (sight & ~refusal).sum(0).float() / views.clamp_min(1)
    agreement[views < min_views] = -1
    top = agreement >= agreement.max() - 1e-6
    share = refusal[:, top].float().mean(1)
    blamed = [shapes.names[i] for i in torch.argsort(share, descending=True).tolist() if share[i] > 0.25]
    empty = [name for name, box in zip(shapes.names, shapes.boxes, strict=True) if box is None]
    hint = f" ({', '.join(empty)} empty)" if empty else ""
    if len(blamed) > count // 2 or not blamed:
        raise StudioError(
            f"The visual hull is empty: the masks of {', '.join(blamed or shapes.names)} agree on no common "
            f"volume{hint}; check the camera poses and the masks."
        )
    raise StudioError(
        f"The visual hull is empty: the masks of {', '.join(blamed)}{hint} disagree with those of the other "
        f"{count - len(blamed)} cameras; mend these masks or leave these cameras out."
    )
