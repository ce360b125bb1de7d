from .edit_list import CropBox, DetailMark, EditList, Floaters, Ground, Region, RegionView, Trim, World
from .following import follow
from .selection import Paths, Selection, select

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
    "select",
]
