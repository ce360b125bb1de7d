"""The VideoGS layout, read by a reader that was written from the description of the layout alone. Like the players of
the released code, it decodes with OpenCV to BGR pictures and converts these to gray."""

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import torch

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import refuses
from v3studio.studio.formats.sequence import open_import
from v3studio.studio.formats.videogs import export_videogs, open_videogs


def players_reader(folder, lossless: bool = True) -> list[dict[str, np.ndarray]]:
    """All frames: positions, f_dc, f_rest, opacity, scale and rotation, as in the released players."""
    groups = json.loads((folder / "group_info.json").read_text())
    ranges = json.loads((folder / "viewer_min_max.json").read_text())
    assert sorted(groups, key=int) == [str(g) for g in range(len(groups))]
    frames = []
    for g in range(len(groups)):
        first, last = groups[str(g)]["frame_index"]
        assert first == len(frames)
        attributes = len(ranges[str(first)]["info"]) // 2
        files = [cv2.VideoCapture(str(folder / f"group{g}" / f"{c}.mp4")) for c in range(attributes + 3)]
        for index in range(first, last + 1):
            count, info = ranges[str(index)]["num"], ranges[str(index)]["info"]
            assert len(info) == 2 * attributes
            pixels = []
            for file in files:
                good, picture = file.read()
                assert good
                gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
                assert gray.shape[0] == gray.shape[1] == 8 * (gray.shape[0] // 8)
                assert (gray.shape[0] - 8) ** 2 < count <= gray.shape[0] ** 2
                assert not (lossless and gray.ravel()[count:].any())
                pixels.append(gray.ravel()[:count].astype(np.float64))
            values = []
            for attribute in range(attributes):
                if attribute < 3:
                    level = (256 * pixels[2 * attribute + 1] + pixels[2 * attribute]) / 65535
                else:
                    level = pixels[attribute + 3] / 255
                low, high = info[2 * attribute : 2 * attribute + 2]
                values.append(level * (high - low) + low)
            table = np.stack(values, axis=1)
            found = {"position": table[:, :3], "normal": table[:, 3:6], "f_dc": table[:, 6:9], "f_rest": table[:, 9:-8]}
            frames.append({**found, "opacity": table[:, -8], "scale": table[:, -7:-4], "rotation": table[:, -4:]})
        assert not any(file.read()[0] for file in files)
    return frames


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_the_players_see_what_was_exported(tmp_path: Path, make_video: MakeVideo, degree: int) -> None:
    """QP 0: every splat is within half a quantization step of the ranges of its frame."""
    video = make_video((3, 1, 2), degree=degree)
    export_videogs(video, tmp_path / "out", qp=0)
    frames = players_reader(tmp_path / "out")
    assert len(frames) == 6
    for group in video.groups:
        keyframe = video.read(group[0])
        # match exported splats by the nearest one in the first frame of the group
        distance = torch.cdist(torch.tensor(frames[group[0]]["position"]), keyframe.means.double())
        which = distance.argmin(dim=1)
        assert len(set(which.tolist())) == len(keyframe)
        for index in group:
            meant, frame = video.read(index)[which], frames[index]
            expected = {
                "position": (meant.means, 65535),
                "f_dc": (meant.sh[:, 0], 255),
                "f_rest": (meant.sh[:, 1:].reshape(len(meant), -1), 255),
                "opacity": (meant.opacities, 255),
                "scale": (meant.scales, 255),
            }
            assert not frame["normal"].any()
            for name, (values, levels) in expected.items():
                array = values.double().numpy()
                if array.size:
                    least = 0 if name == "opacity" else array.min(axis=0)
                    step = (array.max(axis=0) - least) / levels
                    assert (np.abs(frame[name] - array) <= 0.5 * step + 1e-6).all(), name
            rotation = frame["rotation"] / np.linalg.norm(frame["rotation"], axis=1, keepdims=True)
            alike = np.abs((rotation * meant.unit_quats.double().numpy()).sum(axis=1))
            assert alike.min() > 1 - 4e-5


def test_what_is_imported_is_what_the_players_see(tmp_path: Path, make_video: MakeVideo) -> None:
    video = make_video((4, 3))
    export_videogs(video, tmp_path / "out", qp=0)
    imported = open_import(tmp_path / "out")
    assert imported.groups == video.groups
    for back, players in zip(imported, players_reader(tmp_path / "out"), strict=True):
        np.testing.assert_allclose(back.means, players["position"], atol=1e-6)
        np.testing.assert_allclose(back.scales, players["scale"], rtol=1e-5)
        np.testing.assert_allclose(back.opacities, players["opacity"], atol=2e-6)
        np.testing.assert_allclose(back.sh[:, 0], players["f_dc"], atol=1e-6)
        np.testing.assert_allclose(back.quats, players["rotation"], atol=1e-6)


@pytest.mark.parametrize("qp", [0, 20, 28, 35])
def test_padding_is_invisible_and_opacities_exact_as_the_codec(tmp_path: Path, make_video: MakeVideo, qp: int) -> None:
    """Players draw nothing below 1/255. A codec's quantizer with the step s has an error of s / sqrt(12)."""
    video = make_video((4,), splats=1900)  # of 48 x 48 pixels
    export_videogs(video, tmp_path / "out", qp=qp)
    entries = json.loads((tmp_path / "out" / "viewer_min_max.json").read_text())
    file = cv2.VideoCapture(str(tmp_path / "out" / "group0" / "12.mp4"))
    for index in range(4):
        count, (low, high) = entries[str(index)]["num"], entries[str(index)]["info"][18:20]
        values = cv2.cvtColor(file.read()[1], cv2.COLOR_BGR2GRAY).ravel() / 255 * (high - low) + low
        assert (len(values), count) == (48 * 48, 1900)
        assert abs(values[count:]).max() < 1 / 255
        # ordered, since the export orders splats: a lower bound of the error, and close to it where it is small
        meant = np.sort(video.read(index).opacities.numpy())
        error = np.sort(values[:count]) - meant
        step = max(1, 2 ** ((qp - 4) / 6)) / 255 * meant.max()
        assert np.sqrt((error**2).mean()) <= 1.1 * step / 12**0.5
        assert abs(error).max() <= 0.55 * step


def test_names_and_constant_channels(tmp_path: Path, make_video: MakeVideo) -> None:
    video = make_video((5,))
    still = video.read(0)
    still.sh[:] = 0.25
    part = video.part(2, 5)
    export_videogs(part, tmp_path / "out", qp=0)
    info = json.loads((tmp_path / "out" / "group_info.json").read_text())
    assert info == {"0": {"frame_index": [0, 2], "name_index": [2, 4]}}
    export_videogs(video.part(0, 1), tmp_path / "constant", qp=0)
    np.testing.assert_array_equal(players_reader(tmp_path / "constant")[0]["f_dc"], 0.25)
    with refuses("export.invalid_qp", value=52):
        export_videogs(video, tmp_path / "new", qp=52)
    with refuses("export.already_exists", file=tmp_path / "out"):
        export_videogs(video, tmp_path / "out")


@pytest.fixture
def exported(tmp_path: Path, make_video: MakeVideo) -> Path:
    export_videogs(make_video((3, 2)), tmp_path / "out", qp=0)
    return tmp_path / "out"


def test_frames_called_by_their_names_as_the_released_baker_does(exported: Path) -> None:
    expected = [frame.means for frame in open_videogs(exported)]
    info = json.loads((exported / "group_info.json").read_text())
    for entry in info.values():
        entry["name_index"] = [number + 3 for number in entry["frame_index"]]
    (exported / "group_info.json").write_text(json.dumps(info))
    table = json.loads((exported / "viewer_min_max.json").read_text())
    (exported / "viewer_min_max.json").write_text(json.dumps({str(int(k) + 3): v for k, v in table.items()}))
    for found, meant in zip(open_videogs(exported), expected, strict=True):
        assert torch.equal(found.means, meant)


def test_limited_range_video_is_scaled_to_the_full_one(exported: Path) -> None:
    """Limited range, as the released baker encodes: within two levels of full range."""
    before = open_videogs(exported).read(0)
    path = exported / "group0" / "12.mp4"  # opacity
    with av.open(str(path)) as file:
        pictures = [frame.to_ndarray()[: frame.height] for frame in file.decode(video=0)]
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=30, options={"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = pictures[0].shape[1], pictures[0].shape[0], "yuv420p"
        for picture in pictures:
            limited = np.full((picture.shape[0] * 3 // 2, picture.shape[1]), 128, np.uint8)
            limited[: picture.shape[0]] = np.rint(16 + picture * (219 / 255))
            out.mux(stream.encode(av.VideoFrame.from_ndarray(limited, format="yuv420p")))
        out.mux(stream.encode())
    after = open_videogs(exported).read(0)
    span = float(before.opacities.max() - before.opacities.min())
    assert (after.opacities - before.opacities).abs().max() <= 2 / 255 * span


def test_damaged_layouts(exported: Path, tmp_path: Path) -> None:
    groups, frames = "group_info.json", "viewer_min_max.json"
    two = {"frame": "2", "name": "info"}
    too_small = {"file": exported / "group0" / "0.mp4", "frame": 2, "expected": 10**6}
    cases = [
        (groups, lambda v: v["1"].update(frame_index=[4, 4]), "invalid_group",
         {"group": 1, "value": (4, 4), "expected": 3}),
        (groups, lambda v: v["1"].update(frame_index=[3, 10**9]), "invalid_group", {"group": 1, "value": (3, 10**9)}),
        (groups, lambda v: v.pop("0"), "invalid_group", {"group": 0}),
        (frames, lambda v: v["2"].update(num=10**9), "invalid_frame", {"frame": "2", "name": "num", "value": 10**9}),
        (frames, lambda v: v["2"]["info"].pop(), "invalid_frame", {**two, "value": None}),
        (frames, lambda v: v["2"].update(info=[0, 1] * 5), "invalid_frame", {**two, "value": 10}),
        (frames, lambda v: v["2"]["info"].__setitem__(0, 1e9), "invalid_frame", two),
        (frames, lambda v: v.pop("4"), "missing_frame", {"frame": "4"}),
        (frames, lambda v: v["2"].update(num=10**6), "picture_too_small", too_small),
    ]  # fmt: skip
    for name, edit, code, fields in cases:
        path = exported / name
        good = path.read_text()
        values = json.loads(good)
        edit(values)
        path.write_text(json.dumps(values))
        with refuses(f"videogs.{code}", **{"file": path, **fields}):
            list(open_videogs(exported))
        path.write_text(good)
    video = exported / "group0" / "7.mp4"
    data = video.read_bytes()
    for wrong in (data[:200], b""):
        video.write_bytes(wrong)
        with refuses("videogs.video_unreadable", file=video):
            open_videogs(exported).read(1)
    video.unlink()
    with refuses("videogs.file_missing", file=video):
        open_videogs(exported).read(1)
    video.write_bytes((exported / "group1" / "7.mp4").read_bytes())  # two frames instead of three
    with refuses("videogs.video_too_short", file=video):
        open_videogs(exported).read(2)
    with refuses("videogs.file_missing", file=tmp_path / "group_info.json"):
        open_videogs(tmp_path)
