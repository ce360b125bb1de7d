"""Writes the reference data of the player's unit tests (web/tests): arrays computed in Python.

python tests/web/write_fixtures.py FOLDER
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import support


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        # QP 4 has escapes; the figure has few of them.
        stream = support.bake(Path(temporary) / "stream", lengths=(5, 3), splats=700, degree=1, qp=4)
        planes = support.bake(Path(temporary) / "planes", lengths=(2,), splats=300, profile="planes", qp=0)
        for name, place in (("motion", stream), ("planes", planes)):
            python = support.PythonFrames(place)
            group = python.reader.manifest.groups[0]
            (folder / f"{name}.json").write_bytes((place / "manifest.json").read_bytes())
            np.stack(python.luma(0)).tofile(folder / f"{name}.luma")
            positions = np.stack([python.gaussians(frame).means.numpy() for frame in range(group.frame_count)])
            positions.astype(np.float32).tofile(folder / f"{name}.positions")
            python.close()
        side = json.loads((stream / "manifest.json").read_bytes())["groups"][0]["side"]
        (folder / "motion.bin").write_bytes((stream / side["path"]).read_bytes())
        (folder / "side.json").write_text(json.dumps(support.side_arrays(stream, 0)))
    tiles = [(16, 256), (16, 7), (48, 2304), (80, 6001), (176, 30976), (1040, 1_081_600)]
    orders = {f"{tile} {count}": support.morton_pixels(tile, count) for tile, count in tiles}
    sums = {key: [sum(pixels), *pixels[:50], *pixels[-50:]] for key, pixels in orders.items()}
    (folder / "morton.json").write_text(json.dumps(sums))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
