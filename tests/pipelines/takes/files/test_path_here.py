from pathlib import Path

import pytest

from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.files.path_here import path_here, places_to_look
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError


def test_a_folder_is_found_where_this_machine_has_it(tmp_path: Path) -> None:
    (tmp_path / "volumes" / "footage" / "day1").mkdir(parents=True)
    (tmp_path / "volumes" / "footage" / "day1" / "cam1.mp4").touch()
    paths = {"/mnt": ["/nowhere"], "/mnt/footage": ["/net/footage", str(tmp_path / "volumes" / "footage")]}
    there = Path("/mnt/footage/day1")
    assert path_here(there, paths) == tmp_path / "volumes" / "footage" / "day1"
    assert path_here(Path("/mnt/footage2/day1"), paths) == Path("/mnt/footage2/day1")
    assert path_here(tmp_path, {str(tmp_path): ["/other"]}) == tmp_path, "what exists is used"
    places = [str(tmp_path / "volumes/footage/day1"), "/nowhere/footage/day1"]
    assert list(map(str, places_to_look(there, paths))) == [str(there), "/net/footage/day1", *places]


def test_a_take_opens_footage_that_is_mounted_elsewhere(project: Path) -> None:
    (project / "capture").rename(project / "mounted")
    take = Take.create(project / "take")
    config = load_config(project / "ball.yaml", [("run.paths", {str(project / "capture"): str(project / "mounted")})])
    assert config.run.paths == {str(project / "capture"): (str(project / "mounted"),)}
    assert Inputs(take, config).raw_footage.frames == (0, 1, 2, 3, 4)
    assert config.capture.root == project / "capture", "settings keep the path that they were written with"


def test_a_path_that_is_not_whole_is_refused() -> None:
    with pytest.raises(StudioError, match="'footage' is not a whole path"):
        load_config(None, [("run.paths", {"/mnt/footage": "footage"})])
