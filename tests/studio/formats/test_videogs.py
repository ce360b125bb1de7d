"""The VideoGS layout, read by a reader that was written from the description of the layout alone. Like the players of
the released code, it decodes with OpenCV to BGR pictures and converts these to gray."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import refuses
from v3studio.studio.formats.videogs import export_videogs


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
