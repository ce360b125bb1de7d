"""Frames are the same by the C++ kernel as by their definition in NumPy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.studio.stream.conftest import turned_bodies
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.cpu import load_kernels
from v3studio.studio.rasterizer.kernels import definitions_only
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from v3studio.studio.stream.decoder import GroupTables
from v3studio.studio.stream.manifest import Rendition
from v3studio.studio.stream.motion_state import Side

SPLATS = 1001  # not a multiple of the kernel's blocks


def with_odd_colors(frames: list[Gaussians]) -> list[Gaussians]:
    """Colors so far from the others that they become escapes, in the first and the last of the kernel's blocks; and
    grays at both ends of the codes of a video."""
    odd = [replace(frame, sh=frame.sh.clamp(-0.8, 0.8)) for frame in frames]
    for frame in odd:
        frame.sh[20:60, 0] = torch.tensor([1.0, -1.0]).repeat(20)[:, None]
        frame.sh[3, 0] = torch.tensor([60.0, 40.0, -50.0])
        frame.sh[SPLATS - 2, 0] = torch.tensor([-30.0, 20.0, 70.0])
        frame.logit_opacities[5:9] = torch.tensor([-40.0, 40.0, 12.0, -12.0])  # beyond the margin on either side
    return odd


@pytest.mark.parametrize("degree", [0, 3])
def test_kernel_and_definition_agree(tmp_path: Path, degree: int) -> None:
    settings = BakeSettings(preset="veryfast", quality=20)
    entry = bake_group(with_odd_colors(turned_bodies(4, SPLATS, degree)), tmp_path, 0, 0, settings)
    write_manifest(tmp_path, [entry], 30, settings)
    with StreamReader.open(tmp_path) as reader:
        group = reader.groups[0]
        files = reader.fetch(group)
        assert isinstance(group, Rendition)
        escapes = Side.parse(files[group.side.path], group).escapes.code
        assert len(escapes) > 0, "the test needs escapes"
        assert ((escapes < 0) | (escapes > 255)).all(), "the video has all others"
        decoder, tables = reader.open_group(group, files), GroupTables(group, files[group.side.path])
        for index in range(4):
            frame = decoder.read()
            assert index == 0 or tables.state.rotations(index) is not None, "the test needs blocks that turn"
            with definitions_only():
                wanted = dict(frame.gaussians().items())
            threaded = dict(tables.gaussians(index, frame.picture, threads=3).items())
            for name, found in frame.gaussians().items():
                assert torch.equal(found, threaded[name]), (name, index)
                # logarithms of the kernel's own; at 1 - 1e-6, one rounding of the opacity is 6% of the rest
                rtol = {"log_scales": 1e-6, "logit_opacities": 0.07}.get(name, 0.0)
                assert torch.allclose(found, wanted[name], rtol=rtol, atol=2e-6 if rtol else 0), (name, index)
        decoder.close()


def arguments() -> dict[str, object]:
    """A call on two splats with 13 channels."""
    return {
        "picture": np.zeros((13, 2), np.uint8),
        "pixels": np.array([0, 1], np.int32),
        "first": np.arange(0, 26, 2),
        "steps": np.ones(13, np.float32),
        "offsets": np.zeros(13, np.float32),
        "escape_starts": np.zeros(14, np.int64),
        "escape_splats": np.zeros(0, np.int32),
        "escape_codes": np.zeros(0, np.float32),
        "gains": np.ones(2, np.float32),
        "keyframe": np.zeros((2, 3), np.float32),
        "local": np.zeros((2, 4), np.float32),
        "labels": np.zeros(2, np.int32),
        "maps": np.zeros((1, 4, 3), np.float32),
        "rotations": None,
        "means": torch.empty(2, 3),
        "quats": torch.empty(2, 4),
        "log_scales": torch.empty(2, 3),
        "logits": torch.empty(2),
        "sh": torch.empty(2, 1, 3),
        "threads": 1,
    }


ESCAPE = {"escape_starts": np.array([0] * 13 + [1]), "escape_codes": np.array([300], np.float32)}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"pixels": np.array([0, 2], np.int32)}, "outside the picture"),
        ({"pixels": np.array([0, -1], np.int32)}, "pixels has a negative value"),
        ({"first": np.arange(0, 24, 2)}, "10 \\+ 3 K channels"),
        ({"labels": np.array([0, 1], np.int32)}, "a label is outside the blocks"),
        ({"escape_starts": np.ones(14, np.int64)}, "escape_starts must ascend"),
        ({**ESCAPE, "escape_splats": np.array([2], np.int32)}, "an escape is outside the group"),
        ({"means": torch.empty(1, 3)}, "means has 3 values, expected 6"),
        ({"sh": torch.empty(2, 4, 3)}, "sh has 24 values, expected 6"),
    ],
)
def test_no_call_reads_or_writes_outside_of_its_arrays(changed: dict[str, object], said: str) -> None:
    kernels = load_kernels()
    kernels.dequantize(**arguments())
    with pytest.raises(ValueError, match=said):
        kernels.dequantize(**{**arguments(), **changed})
