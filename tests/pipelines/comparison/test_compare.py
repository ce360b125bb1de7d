import errno
import json
import shutil
import signal
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.streams import contents
from tests.support.tiny_capture import Here, environment, run_take
from tests.support.warm_python import warm_python
from v3studio.pipelines.comparison.compare import compare
from v3studio.pipelines.takes.results.evaluation import read_evaluation
from v3studio.pipelines.takes.take import Take
from v3studio.studio.comparison import PROTOCOLS, measure

Takes = tuple[Path, Path]


@pytest.fixture(scope="module")
def two(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Takes:
    """A take, and the same one baked much more coarsely."""
    folder = tmp_path_factory.mktemp("two")
    shutil.copytree(finished / "take", folder / "fine")
    shutil.copytree(finished, folder / "coarse")
    run_take(folder / "coarse", "bake.quality=44", stages=("bake",))
    return folder / "fine", folder / "coarse" / "take"


def test_it_measures_what_the_evaluation_measures(two: Takes, here: Here, tmp_path: Path) -> None:
    done = here("compare", *two, "--out", tmp_path / "out").ok()
    comparison = json.loads((tmp_path / "out" / "comparison.json").read_text())
    fine, coarse = comparison["takes"]
    evaluation = read_evaluation(Take.open(two[0]).evaluation)
    assert (comparison["protocol"]["cameras"], comparison["protocol"]["frames"]) == (["cam4"], [0, 1, 2, 3, 4])
    assert fine["measures"]["psnr"] == pytest.approx(evaluation.summary.psnr_decoded, abs=2e-3)
    assert fine["measures"]["ssim"] == pytest.approx(evaluation.summary.ssim_decoded, abs=2e-4)
    assert fine["total_bytes"] == evaluation.protocol.total_bytes
    assert coarse["total_bytes"] < fine["total_bytes"]
    assert coarse["measures"]["psnr"] < fine["measures"]["psnr"]
    assert fine["measures"]["psnr_color_fit"] != fine["measures"]["psnr"]
    # groups of three frames: one border
    assert [pair["group_border"] for pair in fine["flicker_by_frame"]] == [False, False, True, False]
    assert fine["flicker"] == pytest.approx(np.mean([pair["flicker"] for pair in fine["flicker_by_frame"]]), abs=1e-3)
    compared = [pair["flicker"] for pair in fine["flicker_by_frame"]]
    assert evaluation.frames[0].flicker is None
    assert [row.flicker for row in evaluation.frames[1:]] == pytest.approx(compared, rel=1e-3)
    assert evaluation.summary.flicker_at_group_borders == evaluation.frames[3].flicker
    assert "flicker (levels of 255)" in Take.open(two[0]).report.read_text()
    assert not fine.get("trained_on")
    assert f"{fine['measures']['psnr']:.2f}" in done.stdout
    assert "own masks" in " ".join(done.stdout.split())
    images = sorted(path.name for path in (tmp_path / "out").glob("*.png"))
    assert images == ["cam4_000000.png", "cam4_000004.png"]
    assert cv2.imread(str(tmp_path / "out" / images[0]))[60:].any(), "differences are shown"


def test_an_earlier_comparison_stays_until_the_next_is_written(
    two: Takes, here: Here, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(path, value):
        raise OSError(errno.ENOSPC, "no space")

    again = ("compare", two[0], "--frames", ":2", "--out", tmp_path)
    here(*again, "--images", "2").ok()
    before = contents(tmp_path)
    monkeypatch.setattr("v3studio.pipelines.comparison.compare.write_model", fails)
    here(*again, "--images", "1", "--overwrite").fails("full")
    assert {name: data for name, data in contents(tmp_path).items() if ".comparing" not in str(name)} == before


def test_an_earlier_comparison_is_replaced_and_other_images_stay(two: Takes, here: Here, tmp_path: Path) -> None:
    earlier = {"protocol": {"cameras": ["cam2", "left/cam4"], "frames": [1]}}
    again = ("compare", two[0], "--frames", "::4", "--images", "1", "--out", tmp_path)
    values = here(*again, "--json").result
    values["protocol"].update(earlier["protocol"])
    (tmp_path / "comparison.json").write_text(json.dumps(values))
    for name in ("cam2_000001.png", "left_cam4_000001.png", "poster.png", "cam9_000001.png"):
        (tmp_path / name).write_bytes(b"")
    here(*again).fails("already exists")
    assert (tmp_path / "cam2_000001.png").exists()
    here(*again, "--overwrite").ok()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["cam4_000000.png", "cam9_000001.png", "comparison.json", "poster.png"]


def test_a_folder_that_cannot_be_written_is_refused_before_measuring(two: Takes, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    def progress(done: int, total: int) -> None:
        raise AssertionError("it began to measure")

    with refuses("take.not_writable"):
        compare([two[0]], tmp_path / "file" / "out", PROTOCOLS["box"], progress=progress)
    with pytest.raises(AssertionError, match="began"):
        compare([two[0]], tmp_path / "out", PROTOCOLS["box"], progress=progress)
    assert not (tmp_path / "out").exists()


KILLED_IN_FRAME_3 = """
import os, signal, sys
from pathlib import Path
from v3studio.pipelines.comparison.compare import compare
from v3studio.studio.comparison import PROTOCOLS
def progress(done, total):
    if done == 6:
        os.kill(os.getpid(), signal.SIGKILL)
compare([Path(sys.argv[1]), Path(sys.argv[2])], Path(sys.argv[3]), PROTOCOLS["box"], progress=progress)
"""


def killed(*arguments: Path) -> None:
    """Compare two takes in another process, which is killed when it begins with the fourth frame."""
    killed = warm_python().run(("-c", KILLED_IN_FRAME_3, *map(str, arguments)), env=environment())
    assert killed.returncode == -signal.SIGKILL, killed.stderr


def counted(monkeypatch: pytest.MonkeyPatch) -> Mock:
    """Is called for each view that is measured."""
    counting = Mock(wraps=measure)
    monkeypatch.setattr("v3studio.pipelines.comparison.measuring.measure", counting)
    return counting


def test_a_killed_comparison_goes_on_where_it_was(two: Takes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compare(two, tmp_path / "whole", PROTOCOLS["box"])
    killed(*two, tmp_path / "out")
    left = contents(tmp_path / "out")
    frames = {f".comparing/{frame:06d}.json" for frame in range(3)}
    assert set(left) == {*frames, ".comparing/cam4_000000.png"}
    measured, ticks = counted(monkeypatch), []
    compare(two, tmp_path / "out", PROTOCOLS["box"], progress=lambda done, total: ticks.append((done, total)))
    assert measured.call_count == 2 * 2, "two frames of two takes"
    assert ticks[0] == (6, 10)
    assert ticks[-1] == (10, 10)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert not (tmp_path / "out" / ".comparing").exists()


def test_frames_of_another_comparison_or_damaged_ones_are_measured_again(
    two: Takes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare(two, tmp_path / "whole", PROTOCOLS["box"], images=0)
    measured = counted(monkeypatch)
    killed(*two, tmp_path / "out")
    compare(two, tmp_path / "out", PROTOCOLS["box"], images=0)  # the killed one drew images
    assert measured.call_count == 5 * 2
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    compare(two, tmp_path / "whole", PROTOCOLS["box"])
    for name in ("000001.json", "cam4_000000.png"):
        shutil.rmtree(tmp_path / "out")
        killed(*two, tmp_path / "out")
        damaged = tmp_path / "out" / ".comparing" / name
        damaged.write_bytes(b"{") if damaged.suffix == ".json" else damaged.unlink()
        measured.reset_mock()
        compare(two, tmp_path / "out", PROTOCOLS["box"])
        assert measured.call_count == 3 * 2
        assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_mistakes_are_one_sentence(two: Takes, here: Here, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out")
    here("compare", two[0], "--protocol", "hifi4g", *out).fails("no camera '48'", "--cameras")
    here("compare", two[0], two[0], *out).fails("the same take is named twice")
    here("compare", two[0], "--frames", "::0", *out).fails("'::0' is not of the form A:B", code=2)
    assert not (tmp_path / "out").exists()
    here("compare", two[0], "--out", two[1], "--overwrite").fails("is not an earlier output")
