"""EditedFrame: the trained frame that is edited, its group, and what edits remove of it."""

from bisect import bisect_right

import numpy as np

from v3studio.gui.pages.review.tools import FLOATERS
from v3studio.pipelines.takes.frames.edited import edits_of_group, read_paths
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.frames.frame_numbers import trained_groups
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits.edit_list import EditList, Floaters
from v3studio.studio.edits.selection import Paths, Selection, select
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.memory_cache import MemoryCache

SEEN = 0.1  # opacity of splats that are clicked, and that a new box surrounds
KEPT = 8  # selections that are kept: a drag compares two, a proposal a few more


class EditedFrame:
    """A trained frame with the splats of its group, whose `paths` say where they are. For one thread."""

    at: int
    group: Group
    gaussians: Gaussians
    paths: Paths

    def __init__(self) -> None:
        self._paths_of: object = None
        self._frame_of: object = None
        self._selections: MemoryCache[EditList, Selection] = MemoryCache(KEPT)

    def read(self, take: Take | None, frame: int) -> None:
        """Read what has changed; the last frame if `frame`, counted from 0, is beyond. Raises StudioError."""
        files, starts = take.trained_files() if take is not None else ([], ())
        if take is None or not files:
            raise StudioError("take.not_trained", "there is nothing to edit yet", stage="train")
        index = min(frame, len(files) - 1)
        number = bisect_right(starts, index) - 1
        start, end = starts[number], (*starts[1:], len(files))[number]
        key = (take.root, number, start, end, files[start].stat().st_mtime_ns)
        if self._paths_of != key:
            self.group = trained_groups(take)[number]
            self.paths = read_paths(take, self.group)
            self._paths_of, self._selections = key, MemoryCache(KEPT)
        self.at = index - start
        if self._frame_of != (key, index):
            self.gaussians = read_frame(files[index])
            self._frame_of = (key, index)

    def selection(self, edits: EditList) -> Selection:
        """The splats that edits of the take remove of the group."""
        edits = edits_of_group(edits, self.group)
        return self._selections.get_or_make(edits, lambda wanted: select(wanted, self.paths))

    def proposed_floaters(self, edits: EditList) -> Floaters:
        """The first of `FLOATERS` that remove something else than the edits do; the last if none does."""
        removed = self.selection(edits).removed
        for limits in FLOATERS:
            if (self.selection(edits.with_(floaters=limits)).removed & ~removed).any():
                return limits
        return FLOATERS[-1]

    def seen(self, removed: np.ndarray) -> np.ndarray:
        """(M, 3) float64: the frame's splats that can be seen, without the removed (N,) ones."""
        visible = ~removed & (self.paths.opacities[self.at] > SEEN)
        if not visible.any():
            visible = ~removed
        points: np.ndarray = self.paths.means[self.at][visible].astype(np.float64)
        return points
