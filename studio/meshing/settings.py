"""Settings of the initial points: the visual hull, its surface, and samples on it."""

from typing import Annotated, ClassVar

from pydantic import Field

from v3studio.studio.settings import Affects, Heading, Settings


class InitializeSettings(Settings):
    """Initial points of each keyframe, sampled from the visual hull of the masks."""

    affects: ClassVar[Affects | None] = Affects("initial_points")

    points: Annotated[int, Heading("Points")] = Field(default=50_000, ge=100, le=5_000_000)
    """Number of points sampled on the surface of the hull."""

    resolution: Annotated[int, Heading("Hull")] = Field(default=256, ge=16, le=1024)
    """Voxels along the longest side of the hull; fewer if the pixels of the images are coarser than the voxels."""

    tolerance: float = Field(default=0.1, ge=0, le=0.5)
    """Fraction of the cameras whose masks can be outvoted by the others (at least one camera if there are four or
    more). 0: no voting."""

    max_faces: int = Field(default=200_000, ge=100)
    """Maximum number of faces of the mesh."""

    def outvoted(self, cameras: int) -> int:
        """Number of cameras that can be outvoted in a rig of `cameras` cameras."""
        if self.tolerance == 0 or cameras < 4:
            return 0
        return max(1, round(self.tolerance * cameras))
