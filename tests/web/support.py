"""The player's tests' access to the library: streams to play, and their frames as Python decodes and renders them.

If modules move, this is the only file to change.
"""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from tests.support.sounds import clicks as click_sound
from tests.support.sounds import write_wav
from v3studio.studio.audio import SoundFile, cut_sound
from v3studio.studio.cameras import Camera, look_at_pose
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.stream import BakeSettings, Rung, StreamReader, bake_group, bake_set, bake_sound, write_manifest
from v3studio.studio.stream.encode import write_manifest as manifest_writer
from v3studio.studio.stream.morton import deinterleave, square_scan
from v3studio.studio.stream.motion_state import Side

FPS = 25.0


def body(frames: int, splats: int, degree: int, seed: int = 0) -> list[Gaussians]:
    """A swaying figure: small opaque splats on a few ellipsoids, colored by position, with some faint ones around."""
    generator = torch.Generator().manual_seed(seed)

    def noise(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    directions = torch.nn.functional.normalize(noise(splats, 3), dim=1)
    part = torch.arange(splats) % 4
    centers = torch.tensor([[0.0, -0.55, 0.0], [0.0, 0.0, 0.0], [-0.35, -0.1, 0.0], [0.35, -0.1, 0.1]])
    radii = torch.tensor([[0.16, 0.2, 0.16], [0.22, 0.45, 0.15], [0.07, 0.4, 0.07], [0.07, 0.4, 0.07]])
    means = centers[part] + radii[part] * directions + 0.004 * noise(splats, 3)
    quats = torch.nn.functional.normalize(noise(splats, 4), dim=1)
    log_scales = np.log(0.02) + 0.35 * noise(splats, 3)
    logits = 1.5 + 1.5 * noise(splats)
    sh = torch.zeros(splats, (degree + 1) ** 2, 3)
    sh[:, 0] = 1.2 * torch.sin(5 * means + part[:, None]) + 0.2 * noise(splats, 3)
    if degree:
        sh[:, 1:] = 0.12 * noise(splats, (degree + 1) ** 2 - 1, 3)
    result = []
    for t in range(frames):
        sway = Rotation.from_rotvec([0, 0, 0.25 * np.sin(0.5 * t + seed)])
        moving = part >= 2
        matrix = torch.from_numpy(sway.as_matrix()).float()
        moved = torch.where(moving[:, None], means @ matrix.T, means) + torch.tensor([0.02 * t, 0.0, 0.0])
        turned = (sway * Rotation.from_quat(quats.numpy()[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
        turned_quats = torch.where(moving[:, None], torch.from_numpy(turned).float(), quats)
        # A few splats flash and jump in one frame: more than the picture's codes can represent, which causes escapes.
        flash, there = sh.clone(), moved.clone()
        if t == 2:
            flash[:6, 0] += 3.0
            there[6:9] += 0.3
        result.append(Gaussians(there, turned_quats, log_scales, logits, flash))
    return result


def room(splats: int) -> Gaussians:
    """Splats of a shell around the figure and of columns that stand between it and cameras."""
    random = torch.Generator().manual_seed(7)
    directions = torch.randn(splats, 3, generator=random)
    means = 2.6 * directions / directions.norm(dim=1, keepdim=True)
    means[: splats // 3] *= 0.3
    sizes = torch.rand(splats, 3, generator=random) * 1.2 - 3.6
    colors = torch.rand(splats, 1, 3, generator=random) * 2 - 1
    quats = torch.randn(splats, 4, generator=random)
    return Gaussians(means, quats, sizes, torch.full((splats,), 1.5), colors)


def camera(
    azimuth: float, *, elevation: float = 10.0, distance: float = 2.6, size: tuple[int, int] = (320, 400)
) -> Camera:
    """A camera that looks at the figure; angles in degrees; y also points down in the world."""
    a, e = np.radians([azimuth, elevation])
    eye = distance * np.array([np.sin(a) * np.cos(e), -np.sin(e), -np.cos(a) * np.cos(e)])
    width, height = size
    K = np.array([[1.05 * height, 0, width / 2], [0, 1.05 * height, height / 2], [0, 0, 1.0]])
    pose = look_at_pose(eye, np.zeros(3), np.array([0.0, -1.0, 0.0]))
    return Camera(f"a{azimuth:g}", width, height, K, pose)


def bake(
    folder: Path,
    lengths: Sequence[int] = (5, 4),
    splats: int = 1500,
    degree: int = 0,
    qp: int = 16,
    ladder: Sequence[int] = (),
    paged: bool = False,
    clicks: Sequence[float] | None = None,
    dilations: Sequence[float] = (),
    behind: int = 0,
    **options: Any,
) -> Path:
    """Bake a stream of the figure into a folder; `ladder`: QPs of its renditions, `paged`: all groups but one in a
    page, `clicks`: sound with clicks at these times, `dilations`: of each group, `behind`: splats of a set
    around the figure, `options`: further settings."""
    rungs = tuple(Rung(qp=one) for one in ladder)
    settings = BakeSettings(quality=qp, preset="ultrafast", ladder=rungs, **options)  # type: ignore[arg-type]
    entries, first = [], 0
    for index, frames in enumerate(lengths):
        figure = body(frames, splats + 40 * index, degree, index)
        if dilations:
            figure = [replace(frame, dilation=dilations[index]) for frame in figure]
        entries.append(bake_group(figure, folder, index, first, settings))
        first += frames
    view = {"suggested_camera": camera(0).to_dict(), "up": [0.0, -1.0, 0.0], "background": [0.0, 0.0, 0.0]}
    parts = bake_set(room(behind), folder, settings) if behind else ()
    audio = None
    if clicks is not None:
        wav = SoundFile(write_wav(folder.with_suffix(".wav"), click_sound(first / FPS, clicks)))
        audio = bake_sound(cut_sound(wav, 0, first / FPS), folder)
    with mock.patch.object(manifest_writer, "INLINE_BYTES", 1 if paged else manifest_writer.INLINE_BYTES):
        write_manifest(folder, entries, FPS, settings, {**view, "title": "Test figure"}, audio=audio, behind=parts)
    return folder


def decoded(folder: Path, *frames: int) -> list[Gaussians]:
    """Frames of a stream as Python decodes them."""
    with StreamReader.open(folder) as reader:
        return [reader.gaussians(frame) for frame in frames]


def luma(folder: Path, group_index: int) -> list[np.ndarray]:
    """Pictures of a group, (H, W) uint8 each."""
    with StreamReader.open(folder) as reader:
        group = reader.groups[group_index]
        decoder = reader.open_group(group)
        frames = [decoder.read() for _ in range(group.frame_count)]
        decoder.close()
    return [frame.picture for frame in frames]


def side_arrays(folder: Path, group_index: int) -> dict[str, Any]:
    """Contents of a group's side file as Python parses it, and the pixels of splats in its tile; JSON-ready."""
    with StreamReader.open(folder) as reader:
        group = reader.groups[group_index]
        side = Side.parse(reader.fetch(group)[group.side.path], group)
    order = np.lexsort((side.escapes.splat, side.escapes.frame))
    return {
        "cells": deinterleave(side.codes).astype(int).reshape(-1).tolist(),
        "labels": side.labels.tolist(),
        "classes": side.classes.tolist(),
        "motions": side.affine.reshape(-1).tolist(),
        "turns": side.rotation.reshape(-1).tolist(),
        "escapes": [
            [int(getattr(side.escapes, name)[i]) for name in ("frame", "splat", "channel", "code")] for i in order
        ],
        "pixels": square_scan(group.tile, group.splats).tolist(),
    }


def morton_pixels(tile: int, count: int) -> list[int]:
    return square_scan(tile, count).tolist()


def draw(gaussians: Gaussians, view: Camera, background: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(H, W, 3) uint8, rendered by `studio.rasterizer`."""
    image = rasterize(gaussians, view, torch.tensor(list(background))).image
    return (image.clamp(0, 1) * 255).round().to(torch.uint8).numpy()


def camera_values(view: Camera) -> dict[str, Any]:
    """A camera in the player's format."""
    size = {"width": view.width, "height": view.height}
    return {**size, "K": view.K.tolist(), "worldToCamera": view.world_to_camera.tolist()}


def live(source: Path, folder: Path, groups: int, live: bool = True) -> Path:
    """Publish the first groups of a stream; returns `source`."""
    with StreamReader.open(source) as reader:
        entries = [reader.index.group(number) for number in range(groups)]
        metadata, settings = reader.manifest.metadata, BakeSettings(ladder=(Rung(qp=16),))
    shutil.copytree(source / "files", folder / "files", dirs_exist_ok=True)
    write_manifest(folder, entries, FPS, settings, metadata, live=live)
    return source
