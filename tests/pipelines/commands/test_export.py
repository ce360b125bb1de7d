import json
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import OpenEXR
import pytest
import torch

from tests.support.rigs import camera_at
from tests.support.splats import write_group
from tests.support.tiny_capture import Here
from tests.support.warm_python import WarmProcess
from v3studio.pipelines.events import Log
from v3studio.pipelines.takes.authored.edits import change_edits
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, write_frame
from v3studio.pipelines.takes.results.videos import trained_video
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.edits.edit_list import EditList, Trim
from v3studio.studio.formats import read_splats
from v3studio.studio.formats.camera_path import Key, write_path_keys
from v3studio.studio.formats.usd import UsdFrames
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, write_manifest

CENTER = np.array([0.2, 0.1, 0.3])
EYES = {"front": (3.0, 0.0, 0.8), "side": (0.0, 3.0, 0.8), "back": (-3.0, 0.5, 0.8)}
RIG = Rig(tuple(camera_at(name, eye, CENTER, focal=80.0, size=(96, 64)) for name, eye in EYES.items()))


def body(frame: int, splats: int) -> Gaussians:
    generator = torch.Generator().manual_seed(splats)
    means = torch.randn(splats, 3, generator=generator) * torch.tensor([0.2, 0.2, 0.4]) + torch.tensor(CENTER).float()
    means[:, 0] += 0.01 * frame
    quats = torch.nn.functional.normalize(torch.randn(splats, 4, generator=generator), dim=1)
    return Gaussians(means, quats, torch.full((splats, 3), -3.0), torch.full((splats,), 2.0), torch.ones(splats, 1, 3))


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take with two groups of three and two frames, trained and baked, made without a run."""
    take = Take.create(tmp_path_factory.mktemp("export") / "take")
    take.config.write_text("capture: {fps: 12.5}\nevaluate: {background: [0.0, 0.0, 1.0]}\n")
    take.rig.parent.mkdir()
    write_rig(RIG, take.rig)
    settings = BakeSettings(quality=0)
    entries = []
    for group, (first, count, splats) in enumerate(((0, 3, 60), (3, 2, 75))):
        frames = [body(index, splats) for index in range(first, first + count)]
        for index, frame in enumerate(frames, first):
            write_frame(take.finished_frame(group, index), frame, FrameMetadata())
        write_group(take, group, range(first, first + count))
        entries.append(bake_group(frames, take.stream, group, first, settings))
    metadata = {"suggested_camera": RIG["side"].to_dict(), "up": [0.0, 0.0, 1.0], "background": [1.0, 0.0, 0.0]}
    write_manifest(take.stream, entries, 12.5, settings, metadata)
    return take.root


def test_ply_of_the_trained_or_the_decoded_splats(here: Here, take: Path, tmp_path: Path) -> None:
    options = ("--of", "trained", "--format", "ply", "--frames", "1:5:2")
    done = here("export", take, *options, "--out", tmp_path / "trained").ok()
    assert done.stdout.endswith("trained: 2 frames\n")
    assert [path.name for path in sorted((tmp_path / "trained").iterdir())] == ["frame_0001.ply", "frame_0003.ply"]
    assert torch.equal(read_splats(tmp_path / "trained" / "frame_0003.ply").means, body(3, 75).means)
    here("export", take, "--format", "ply", "--out", tmp_path / "one.ply", "--frames", "3:4").ok()  # the default
    with StreamReader.open(take / "stream") as reader:
        assert torch.equal(read_splats(tmp_path / "one.ply").means, reader.gaussians(3).means)


@pytest.mark.parametrize(
    ("dilations", "words"),
    [((0.1, 0.1), "with 0.1 and look bolder"), ((0.3, 0.6), "with 0.6 and look thinner"), ((0.3, 0.3), "")],
)
def test_another_dilation_is_told(here: Here, tmp_path: Path, dilations: tuple[float, float], words: str) -> None:
    settings = BakeSettings(quality=0)
    groups = [
        bake_group([replace(body(number, 60), dilation=dilation)], tmp_path / "s", number, number, settings)
        for number, dilation in enumerate(dilations)
    ]
    write_manifest(tmp_path / "s", groups, 10.0, settings)
    for kind in ("ply", "turntable.mp4"):
        size = () if kind == "ply" else ("--size", "32x32")
        done = here("export", tmp_path / "s", "--format", kind[:9], "--out", tmp_path / kind, *size).ok()
        told = words and kind != "turntable.mp4"  # movies are drawn here, as trained
        assert [words in line for line in done.stdout.splitlines()] == ([False, True] if told else [not words])
    assert read_splats(tmp_path / "ply" / "frame_0001.ply").dilation == 0.3
    done = here("export", tmp_path / "s", "--format", "ply", "--out", tmp_path / "again", "--json")
    notes = [event.message for event in done.events if isinstance(event, Log)]
    assert [words in note for note in notes] == ([True] if words else [])


def test_harmonics_can_be_cut(here: Here, tmp_path: Path) -> None:
    settings = BakeSettings(quality=0)
    colored = body(0, 60).with_sh_degree(2)
    write_manifest(tmp_path / "s", [bake_group([colored], tmp_path / "s", 0, 0, settings)], 10.0, settings)
    for degree in (0, 1):
        out = tmp_path / f"{degree}.ply"
        here("export", tmp_path / "s", "--format", "ply", "--sh-degree", degree, "--out", out).ok()
        assert read_splats(out).sh_degree == degree


def test_viewer_axes(here: Here, take: Path, tmp_path: Path) -> None:
    here("export", take / "stream", "--format", "ply", "--axes", "viewer", "--out", tmp_path / "out").ok()
    with StreamReader.open(take / "stream") as reader:
        world = reader.gaussians(0).means
    means = read_splats(tmp_path / "out" / "frame_0000.ply").means
    assert torch.allclose(means[:, 1], -world[:, 2], atol=1e-5)  # y down
    here("export", take / "stream", "--format", "spz", "--frames", "0:1", "--out", tmp_path / "a.spz").ok()
    assert torch.allclose(read_splats(tmp_path / "a.spz").means[:, 1], world[:, 2], atol=1e-3)  # y up
    assert (tmp_path / "a.spz").read_bytes()[:5] == b"NGSP\x04"
    older = ("--spz-version", "3", "--frames", "0:1", "--out", tmp_path / "b.spz")
    here("export", take / "stream", "--format", "spz", *older).ok()
    assert (tmp_path / "b.spz").read_bytes()[:2] == b"\x1f\x8b"
    assert torch.equal(read_splats(tmp_path / "b.spz").means, read_splats(tmp_path / "a.spz").means)


def test_plys_there_and_back(here: Here, take: Path, tmp_path: Path) -> None:
    here("export", take, "--format", "ply", "--out", tmp_path / "plys").ok()
    options = ("--fps", "12.5", "--bake.quality", "0", "--up", "0,0,2")
    done = here("import", tmp_path / "plys", "--out", tmp_path / "back", *options, "--bake.first_group_size", "2").ok()
    assert "back: 5 frames in 3 groups, " in done.stdout
    for unused in (("--train.dilation", "3"), ("--bake.view_range", "none")):
        done = here("import", tmp_path / "plys", "--out", tmp_path / "other", *unused, "--json").fails(code=2)
        assert done.events[-1].code == "import.setting_not_used"
    with StreamReader.open(tmp_path / "back") as reader:
        assert (reader.fps, reader.manifest.settings["qp"]) == (12.5, 0)
        assert reader.manifest.metadata["up"] == [0, 0, 1]
        for index in range(5):
            meant = body(index, 60 if index < 3 else 75).means
            means = reader.gaussians(index).means
            assert torch.cdist(meant.double(), means.double()).min(dim=1).values.max() < 5e-3


def test_movies(here: Here, take: Path, tmp_path: Path) -> None:
    turn = tmp_path / "turn.mp4"
    options = ("--of", "trained", "--format", "turntable", "--size", "96x64", "--seconds", "0.4", "--json")
    *_, last, end = here("export", take, *options, "--out", turn).ok().events
    assert (last.label, last.figures) == ("export turntable", {"done": 5, "total": 5})
    assert end.result["path"] == str(turn)
    with av.open(str(turn)) as file:
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    assert len(frames) == 5
    assert frames[0][0, 0, 2] > 240  # the take's background is blue
    assert frames[0][32, 48].min() > 100  # the body at the center

    keys = [Key(0, RIG["front"], 4.0), Key(1, RIG["side"], 0.0)]
    write_path_keys(keys, tmp_path / "path.json")
    path = ("--format", "camera-path", "--size", "96x64", "--path")
    options = (tmp_path / "path.json", "--fps", "4", "--background", "0,1,0", "--out", tmp_path / "path.mp4")
    assert here("export", take / "stream", *path, *options).ok().stdout.endswith("path.mp4: 4 frames of 96x64\n")
    done = here("export", take, *path, take / "calibrate" / "rig.json", "--out", tmp_path / "rig.mp4").ok()
    assert done.stdout.endswith("rig.mp4: 5 frames of 96x64\n")  # as long as the video


def test_plates_have_the_numbers_of_the_footage_and_the_world_of_the_usd_file(
    here: Here, take: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ("--format", "exr", "--shutter", "180", "--shutter-samples", "2", "--json")
    done = here("export", take, *options, "--camera", "side", "--frames", "1:3", "--out", "side").ok()
    assert sorted(path.name for path in (tmp_path / "side").iterdir()) == ["plate.0001.exr", "plate.0002.exr"]
    assert done.result == {"path": str(tmp_path / "side"), "format": "exr", "frames": 2}
    file = OpenEXR.File(str(tmp_path / "side" / "plate.0001.exr"))
    places = np.stack([file.channels()[f"P.{axis}"].pixels for axis in "XYZ"], -1)
    here("export", take, "--format", "usd", "--out", tmp_path / "a.usda", "--start-number", "1001").ok()
    splats = UsdFrames(tmp_path / "a.usda")
    assert splats.times == [1001, 1002, 1003, 1004, 1005]
    means = splats.read(1002).means.numpy()
    drawn = places[file.channels()["RGBA"].pixels[..., 3] > 0.9]
    assert np.abs(drawn.mean(0) - means.mean(0)).max() < 0.2
    assert drawn[:, 1].std() > 1.5 * drawn[:, 2].std()  # y is up: the body is twice as high as wide

    # the same camera, by way of the USD file
    path = ("--path", tmp_path / "a.usda", "--camera", "side", "--start-number", "1001", "--size", "96x64")
    here("export", take, *options, *path, "--frames", "1:3", "--out", tmp_path / "again").ok()
    again = OpenEXR.File(str(tmp_path / "again" / "plate.1001.exr"))
    for name, channel in file.channels().items():
        np.testing.assert_allclose(again.channels()[name].pixels, channel.pixels, atol=2e-3, rtol=1e-3)
    done = here("export", take, "--format", "camera-path", *path, "--out", tmp_path / "a.mp4").ok()
    assert done.stdout.endswith("a.mp4: 5 frames of 96x64\n")


def test_mistakes_are_one_sentence(here: Here, take: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (tmp_path / "notes.txt").write_text("not an export", encoding="utf-8")
    cases = [
        ([take, "--format", "ply", "--out", tmp_path], "is not an earlier output of this command"),
        ([take, "--format", "ply", "--out", out, "--frames", "0:9"], "Choose a range within 0:5"),
        ([take, "--format", "ply", "--out", tmp_path / "a.ply"], "5 frames cannot be written to one file"),
        ([take / "stream", "--of", "trained", "--format", "ply", "--out", out], "--of trained needs a take"),
        ([take, "--format", "camera-path", "--out", tmp_path / "a.mp4"], "needs --path"),
        ([take, "--format", "exr", "--out", out], "needs --path FILE or --camera NAME"),
        ([take, "--format", "exr", "--camera", "top", "--out", out], "no camera named 'top'"),
        ([take / "stream", "--format", "exr", "--camera", "side", "--out", out], "--camera side needs a take"),
        ([take, "--format", "ply", "--camera", "side", "--out", out], "does not take --camera"),
        ([take, "--format", "videogs", "--axes", "viewer", "--out", out], "supports only the axes of the capture"),
        ([take, "--format", "ply", "--spz-version", "3", "--out", out], "does not take --spz-version"),
        ([tmp_path / "none", "--format", "ply", "--out", out], "no such folder"),
    ]
    for arguments, message in cases:
        usage = "--" in message or "axes" in message or "one file" in message
        done = here("export", *arguments).fails(message, code=2 if usage else 1)
        assert done.stderr.startswith("error: ")
        assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    assert here("export", take, "--format", "obj", "--out", out).returncode == 2
    for option, value in (("--size", "big"), ("--size", "0x64"), ("--background", "red"), ("--frames", "all")):
        here("export", take, "--format", "ply", "--out", out, option, value).fails(f"'{value}' is not", code=2)
    here("import", take, "--out", out).fails("no .ply, .spz, .sog, .splat files")


def test_frames_have_their_numbers_in_the_footage(here: Here, take: Path, tmp_path: Path) -> None:
    whole = Path(shutil.copytree(take, tmp_path / "take"))
    for path in sorted((whole / "train").glob("group_*/group.json")):
        group = json.loads(path.read_text())
        path.write_text(json.dumps(group | {"frames": [60 + 2 * frame for frame in group["frames"]]}))
    options = ("--format", "ply", "--frames", "62:66")
    for of in ("trained", "decoded"):
        here("export", whole, "--of", of, *options, "--out", tmp_path / of).ok()
        assert sorted(path.name for path in (tmp_path / of).iterdir()) == ["frame_0062.ply", "frame_0064.ply"]
    change_edits(whole / "edits.json", EditList(trim=Trim(first=63, last=67)), "trim")
    video = trained_video(whole)
    assert (video.frame_count, video.number(0), video.number(1)) == (2, 64, 66)
    assert torch.equal(video.read(0).means, trained_video(take).read(2).means)
    here("export", whole, "--of", "trained", *options, "--out", tmp_path / "early").fails("64 to 66")


def test_ctrl_c_stops_and_leaves_nothing(start: Callable[..., WarmProcess], take: Path, tmp_path: Path) -> None:
    options = ("--format", "turntable", "--size", "640x480", "--seconds", "600", "--json")
    process = start("export", take, *options, "--out", tmp_path / "a.mp4")
    while '"done": 0' in process.stdout.readline():
        pass
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(120)
    assert process.returncode == 130, errors
    assert list(tmp_path.iterdir()) == []
