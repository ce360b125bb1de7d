"""Decoder of the profile `planes`, the exact inverse of `encode.planes`."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor, wait

import numpy as np

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream.decoders.decoder import DecodedFrame, GroupDecoder, check_luma
from v3studio.studio.stream.layout import component_gaussians
from v3studio.studio.stream.manifest import PlanesRendition
from v3studio.studio.stream.quantize import LEVELS_8, LEVELS_16, dequantize, join_bytes
from v3studio.studio.stream.video import PlaneDecoder


class PlanesDecoder(GroupDecoder):
    """Decodes all planes of a frame in parallel. `files`: content by path, from `StreamReader.fetch`."""

    group: PlanesRendition

    def __init__(self, group: PlanesRendition, files: Mapping[str, bytes], pool: ThreadPoolExecutor, name: str) -> None:
        super().__init__(group)
        self._pool, self._name = pool, name
        size, pictures = (group.side, group.side), group.frame_count
        # Opening parses each file's headers, so it pays to do that in parallel too.
        opening = [
            pool.submit(PlaneDecoder, files[plane.path], f"{name}/{plane.path}", size, pictures)
            for plane in group.videos
        ]
        wait(opening)
        self._decoders = [future.result() for future in opening if future.exception() is None]
        for future in opening:
            if (error := future.exception()) is not None:
                self.close()
                raise error

    def _read(self, index: int) -> DecodedFrame:
        group = self.group
        planes = np.empty((len(self._decoders), group.side, group.side), dtype=np.uint8)
        reading = [
            self._pool.submit(decoder.read, plane) for decoder, plane in zip(self._decoders, planes, strict=True)
        ]
        wait(reading)  # for all, before raising the error of one: the caller may then close the decoders
        for future in reading:
            future.result()
        for entry, plane in zip(group.videos, planes, strict=True):
            check_luma(entry, index, plane, self._name)
        return DecodedFrame(planes, self._gaussians)

    def _gaussians(self, planes: np.ndarray) -> Gaussians:
        group = self.group
        flat = planes.reshape(len(planes), -1)[:, : group.splats]
        values = np.empty((len(group.components), group.splats), np.float32)
        index = 0
        for row, entry in zip(values, group.components, strict=True):
            if len(entry.planes) == 1:
                row[:] = dequantize(flat[index], entry.min, entry.max, LEVELS_8)
            else:
                codes = join_bytes(flat[index], flat[index + 1], mirrored=entry.planes[1].part == "low_mirrored")
                row[:] = dequantize(codes, entry.min, entry.max, LEVELS_16)
            index += len(entry.planes)
        return component_gaussians(values, group.sh_degree, group.dilation)

    def close(self) -> None:
        for decoder in self._decoders:
            decoder.close()
        self._decoders = []
