import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.looping import wait_in_loop
from tests.support.splats import converted_splats, write_group
from tests.support.streams import bake_numbered, set_capture
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.take.exports import ExportRequest, Exports
from v3studio.pipelines.takes.authored.edits import change_edits
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, write_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits import EditList, Trim, World
from v3studio.studio.stream import CapturePlace


def finish(exports: Exports, seconds: float = 180.0) -> None:
    wait_in_loop("ended", lambda: not exports.running, seconds)


def request(kind: str, source: Path | str, target: Path) -> ExportRequest:
    export = ExportRequest(kind, str(source), "walk", target.parent)
    export.set_target(str(target))
    return export


def test_a_sequence_is_written_and_nothing_is_overwritten(stream_folder: Path, tmp_path: Path) -> None:
    exports = Exports()
    exports.start(request("ply", stream_folder, tmp_path / "out"))
    with refuses("export.running"):
        exports.start(request("spz", stream_folder, tmp_path / "other"))
    finish(exports)
    assert exports.result == f"Written: {tmp_path / 'out'}"
    assert not exports.failed
    assert len(list((tmp_path / "out").glob("*.ply"))) == 12
    assert exports.progress.endswith("12 of 12")
    assert exports.words == ""
    with refuses("export.target_exists", file=tmp_path / "out"):
        exports.start(request("ply", stream_folder, tmp_path / "out"))


@pytest.mark.parametrize(("of", "kind"), [("decoded", "camera-path"), ("trained", "exr")])
def test_views_of_a_trimmed_and_placed_take_become_those_of_what_is_exported(
    of: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames 2 to 7 of the take, in a world that is ten times as large."""
    from v3studio.studio.formats.camera_path import read_path_keys

    take = Take.create(tmp_path / "take")
    world = World(up=(0, 0, 1), origin=(0, 0.5, 0), scale=10)
    if of == "decoded":
        bake_numbered(take.stream, (6,), 25)
        set_capture(take.stream, CapturePlace(2, world.similarity))
    else:
        splats = converted_splats(0)
        for frame in range(9):
            write_frame(take.finished_frame(0, frame), splats, FrameMetadata())
        write_group(take, 0, range(9))
        change_edits(take.edits, EditList(trim=Trim(first=2, last=7), world=world), "trim")
    exports, chosen = Exports(), request(kind, take.root, tmp_path / "out.mp4")
    chosen.of = of
    views = [OrbitCamera().orbit(turn, 0).camera(1280, 720) for turn in (0, 60, 90)]
    exports.path.add(views[0], 2)
    exports.path.add(views[1], 7)
    given = tmp_path / "given.json"
    program = f"import sys, shutil; shutil.copy(sys.argv[sys.argv.index('--path') + 1], {str(given)!r})"
    monkeypatch.setattr("v3studio.gui.models.take.jobs.v3studio_command", lambda: [sys.executable, "-c", program])
    exports.start(chosen)
    finish(exports)
    keys = read_path_keys(given, 10.0)
    assert [key.frame for key in keys] == [0, 5]
    points = np.random.default_rng(1).normal(0, 0.3, (50, 3))
    for key, view in zip(keys, views, strict=False):
        there = key.camera.project(world.similarity.points(points))[0]
        assert there == pytest.approx(view.project(points)[0], abs=1e-6)
    exports.path.add(views[2], 1)
    exports.path.add(views[2], 8)
    with refuses("export.frames_left_out", value=[1, 8], expected=[2, 7]) as error:
        exports.start(chosen)
    assert "view 3 (frame 1), view 4 (frame 8)" in str(error.value)


def test_a_request_becomes_the_command_line(tmp_path: Path) -> None:
    export = ExportRequest("turntable", "/takes/walk", "walk", tmp_path, "decoded")
    assert export.target == str(tmp_path / "walk-decoded-turntable.mp4")
    export.of, export.seconds, export.size, export.background = "trained", "2.5", "640x360", "white"
    assert export.target == str(tmp_path / "walk-trained-turntable.mp4"), "named after the source"
    arguments = [word for word in export.arguments() if word != "--json"]
    options = dict(zip(arguments[1::2], arguments[2::2], strict=False))
    assert options["--out"] == export.target
    assert options["--of"] == "trained"
    assert (options["--seconds"], options["--size"], options["--background"]) == ("2.5", "640x360", "1,1,1")
    export.background = "as captured"
    assert "--background" not in export.arguments()
    export.set_target(str(tmp_path / "mine.mp4"))
    export.of = "decoded"
    assert export.target == str(tmp_path / "mine.mp4"), "a typed name is kept"
    export.move_to(tmp_path / "deep")
    assert export.path == tmp_path / "deep" / "mine.mp4"
    for seconds in ("", "0", "-1", "long", "nan"):
        export.seconds = seconds
        with refuses("export.bad_seconds", value=seconds):
            export.arguments()
