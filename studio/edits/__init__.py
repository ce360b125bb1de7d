"""Edits: trim, crop box, ground, floaters, regions and the placement of the world, as functions of trained splats."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.edits.edit_list import CropBox, DetailMark, EditList, Floaters, Ground, Region, RegionView, Trim, World
    from studio.edits.following import follow
    from studio.edits.moving import moved
    from studio.edits.selection import Paths, Selection, select
    from studio.edits.silhouette import silhouette

__all__ = [
    "CropBox",
    "DetailMark",
    "EditList",
    "Floaters",
    "Ground",
    "Paths",
    "Region",
    "RegionView",
    "Selection",
    "Trim",
    "World",
    "follow",
    "moved",
    "select",
    "silhouette",
]

lazy_exports(__name__)
