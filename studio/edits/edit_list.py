"""The edits of a take: what is cut off, taken out and moved after training, without changing what was trained.

Three of them change training, too: a crop box that says so, details, which get more splats, and clicks on masks.

All positions are in the take's own frame (studio.own_frame), which is the world of the capture unless its cameras are
far from zero, very large or very small: so an edit stays where it is when the world is placed differently.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.corrections import MaskClick
from v3studio.studio.rotations import quats_to_matrices
from v3studio.studio.similarity import Similarity, rotation_between

MOST_POINTS = 400  # most points of a region's outline
MOST_REGIONS = 100  # most regions of a take
MOST_DETAILS = 20  # most marked details of a take
MOST_CLICKS = 1000  # most clicks that correct the masks of a take
DETAIL_WEIGHT = 4.0  # weight of a detail unless another is given
UP = (0.0, 1.0, 0.0)  # where up is in a world for which `World.up` is set: as in glTF, three.js and most engines

_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
_Length = Annotated[float, Field(gt=0, le=1e9)]
Vector = tuple[_Number, _Number, _Number]


class Edit(BaseModel):
    """Base of the models. Unknown keys are refused: an edit of a later version must not be left out silently."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class Trim(Edit):
    """The frames that are baked and exported."""

    first: int = Field(ge=0, le=10_000_000)  # in point: number of the first frame in the footage
    last: int = Field(ge=0, le=10_000_000)  # out point: that of the last frame

    @model_validator(mode="after")
    def _in_order(self) -> Trim:
        if self.last < self.first:
            raise ValueError(f"the last frame, {self.last}, is before the first, {self.first}")
        return self

    def holds(self, frame: int) -> bool:
        return self.first <= frame <= self.last


class CropBox(Edit):
    """A box; splats outside are removed."""

    center: Vector  # its middle
    size: tuple[_Length, _Length, _Length]  # lengths of its edges

    rotation: tuple[_Number, _Number, _Number, _Number] = (1.0, 0.0, 0.0, 0.0)
    """Quaternion wxyz that turns the world's axes to its edges."""

    training: bool = False
    """Whether training sees only what is in front of the box, too. The take is then trained again."""

    @model_validator(mode="after")
    def _turns(self) -> CropBox:
        if not 0.5 < float(np.linalg.norm(self.rotation)) < 2:
            raise ValueError("rotation must be a unit quaternion wxyz")
        return self

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): the directions of its edges, one per row."""
        return quats_to_matrices(np.array(self.rotation)).T

    @property
    def corners(self) -> np.ndarray:
        """(8, 3): its corners; bit 0, 1 and 2 of an index tell the side on the first, second and third axis."""
        signs = np.array([[1 if index >> axis & 1 else -1 for axis in range(3)] for index in range(8)])
        corners: np.ndarray = np.array(self.center) + (signs * np.array(self.size) / 2) @ self.axes
        return corners

    def holds(self, points: np.ndarray) -> np.ndarray:
        """(...,) whether each of (..., 3) points is inside."""
        local = np.abs((points - np.array(self.center)) @ self.axes.T)
        inside: np.ndarray = (local <= np.array(self.size) / 2).all(axis=-1)
        return inside

    def cut(self, camera: Camera, mask: np.ndarray) -> np.ndarray:
        """An (H, W) mask, 0 where a pinhole camera does not see the box; as it is if a corner is beside or behind the
        camera."""
        import cv2

        pixels, depth = camera.project(self.corners)
        if depth.min() <= 1e-6:
            return mask
        seen = np.zeros(mask.shape, np.uint8)
        hull = cv2.convexHull((pixels - 0.5).astype(np.float32))
        if np.abs(hull).max() > 2**14:  # OpenCV draws coordinates below 2^15
            right, bottom = camera.width, camera.height
            image = np.array([[-1, -1], [right, -1], [right, bottom], [-1, bottom]], np.float32)
            _, clipped = cv2.intersectConvexConvex(hull, image)
            hull = hull[:0] if clipped is None else clipped
        if len(hull):
            cv2.fillConvexPoly(seen, np.round(hull).astype(np.int32), 1)
        return np.where(seen, mask, 0).astype(mask.dtype)


class Ground(Edit):
    """A plane; splats below it are removed."""

    normal: Vector  # direction that points up from it, any length above 0
    height: _Number  # where it is: the distance from the origin along `normal`

    @model_validator(mode="after")
    def _has_direction(self) -> Ground:
        if not any(self.normal):
            raise ValueError("normal must not be 0")
        return self

    @property
    def unit(self) -> np.ndarray:
        """(3,): the unit normal."""
        normal = np.array(self.normal)
        unit: np.ndarray = normal / np.linalg.norm(normal)
        return unit

    def holds(self, points: np.ndarray) -> np.ndarray:
        """(...,) whether each of (..., 3) points is on or above it."""
        above: np.ndarray = points @ self.unit >= self.height
        return above


class Floaters(Edit):
    """The splats that count as floaters and are removed. A group's splats are judged together, see `selection`."""

    opacity: float | None = Field(default=None, gt=0, le=1)
    """Splats that never reach this opacity in their group are removed; None: none."""

    splats: int | None = Field(default=None, ge=1, le=100_000_000)
    """Clusters of fewer splats are removed; None: no such limit."""

    share: float | None = Field(default=None, gt=0, lt=1)
    """Clusters with a smaller share of the group's splats are removed; None: no such limit."""

    distance: _Length | None = None
    """Splats closer than this are in the same cluster, world units; None: 2% of the diagonal of the performer's box."""

    @model_validator(mode="after")
    def _says_something(self) -> Floaters:
        if self.opacity is None and self.splats is None and self.share is None:
            raise ValueError("opacity, splats or share must be set")
        return self


class RegionView(Edit):
    """The camera through which a region was drawn: pinhole, OpenCV convention, as `studio.cameras.Camera`."""

    width: int = Field(ge=1, le=100_000)  # of the image, pixels
    height: int = Field(ge=1, le=100_000)  # of the image, pixels
    K: tuple[Vector, Vector, Vector]  # intrinsics, pixels

    world_to_camera: tuple[tuple[_Number, _Number, _Number, _Number], ...] = Field(min_length=4, max_length=4)
    """(4, 4) rigid transform."""

    @model_validator(mode="after")
    def _is_camera(self) -> RegionView:
        try:
            _ = self.camera
        except StudioError as error:
            raise ValueError(error.message.problem) from None
        return self

    @property
    def camera(self) -> Camera:
        return Camera("region", self.width, self.height, np.array(self.K), np.array(self.world_to_camera))

    @classmethod
    def of(cls, camera: Camera) -> RegionView:
        """Make a view of a pinhole camera."""
        values = camera.to_dict()
        return cls.model_validate({name: values[name] for name in cls.model_fields})


class Region(Edit):
    """An outline that was drawn in a view, extruded away from the viewer; splats in it are removed.

    A region, unlike a list of splats, keeps its meaning in other groups and after training again.
    """

    view: RegionView  # from where it was drawn

    outline: tuple[tuple[_Number, _Number], ...] = Field(min_length=1, max_length=MOST_POINTS)
    """Pixels of the view, origin at the corner: the corners of a lasso, or the path of a brush."""

    radius: _Length | None = None  # of the brush, pixels; None: a lasso
    near: float = Field(default=0.0, ge=0, le=1e9)  # least depth along the viewing axis, world units
    far: float | None = Field(default=None, gt=0, le=1e9)  # greatest depth; None: no limit

    drawn: int | None = Field(default=None, ge=0, le=10_000_000)
    """The frame on which it was drawn, by its number in the footage: of its group, the splats are removed that are
    inside in this frame, wherever they move. None: no such frame."""

    frames: tuple[int, int] | None = None
    """Numbers in the footage of the first and last frame for which it holds; None: all. A splat lives as long as its
    group, so it is removed from the whole group."""

    @model_validator(mode="after")
    def _in_order(self) -> Region:
        if self.radius is None and len(self.outline) < 3:
            raise ValueError("a lasso needs at least three points")
        if self.far is not None and self.far <= self.near:
            raise ValueError("far must be greater than near")
        if self.frames is not None and not 0 <= self.frames[0] <= self.frames[1]:
            raise ValueError("frames must be a first and a last frame number")
        return self


class DetailMark(Edit):
    """A part of the performer, as face or hand, that gets more than its share of the splats when the take is trained.

    It is a ball that moves with the performer.
    """

    radius: _Length  # of the ball

    weight: float = Field(default=DETAIL_WEIGHT, ge=1, le=100)
    """How much more its pixels count in the loss, and its splats where splats are added and pruned."""

    path: tuple[tuple[Annotated[int, Field(ge=0, le=10_000_000)], Vector], ...] = Field(
        min_length=1, max_length=100_000
    )
    """Frame numbers in the footage, ascending, and where the middle of the ball is in these frames. It moves straight
    from one to the next, and stays before the first and after the last."""

    @model_validator(mode="after")
    def _in_order(self) -> DetailMark:
        if any(before >= after for (before, _), (after, _) in pairwise(self.path)):
            raise ValueError("the frames of a path must be ascending")
        return self

    def at(self, frame: int) -> np.ndarray:
        """(3,) the middle of the ball in a frame, by its number in the footage."""
        frames = [frame_number for frame_number, _ in self.path]
        places = np.array([place for _, place in self.path])
        return np.array([np.interp(frame, frames, places[:, axis]) for axis in range(3)])


class World(Edit):
    """The place of the world of streams and exports in that of the capture."""

    up: Vector | None = None  # direction that becomes +y, in the capture's world; None: nothing is turned
    origin: Vector = (0.0, 0.0, 0.0)  # point of the capture's world that becomes the origin
    scale: float = Field(default=1.0, ge=1e-6, le=1e6)  # units of the new world in one of the capture's

    @model_validator(mode="after")
    def _has_direction(self) -> World:
        if self.up is not None and not any(self.up):
            raise ValueError("up must not be 0")
        return self

    @property
    def similarity(self) -> Similarity:
        """The transform from the capture's world to the new one."""
        rotation = np.eye(3) if self.up is None else rotation_between(np.array(self.up), np.array(UP))
        return Similarity(self.scale, rotation, -self.scale * rotation @ np.array(self.origin))


class EditList(Edit):
    """All edits of a take. What is None or empty is not edited."""

    trim: Trim | None = None
    crop: CropBox | None = None
    ground: Ground | None = None
    floaters: Floaters | None = None
    regions: tuple[Region, ...] = Field(default=(), max_length=MOST_REGIONS)
    world: World | None = None
    details: tuple[DetailMark, ...] = Field(default=(), max_length=MOST_DETAILS)
    masks: tuple[MaskClick, ...] = Field(default=(), max_length=MOST_CLICKS)

    @property
    def removes(self) -> bool:
        return any((self.crop, self.ground, self.floaters, self.regions))

    @property
    def similarity(self) -> Similarity:
        """The transform from the capture's world to that of streams and exports."""
        return Similarity() if self.world is None else self.world.similarity

    def without(self, name: str, at: int | None = None) -> EditList:
        """A copy without the edit of this name; of those with several, without that at the index `at`, or all."""
        those = getattr(self, name)
        if not isinstance(those, tuple):
            return self.with_(**{name: None})
        return self.with_(**{name: () if at is None else (*those[:at], *those[at + 1 :])})

    def with_(self, **changes: Any) -> EditList:
        """A copy with other values; None or an empty tuple removes an edit."""
        return EditList(**{name: getattr(self, name) for name in EditList.model_fields} | changes)
