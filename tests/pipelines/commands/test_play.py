from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.rigs import ring
from tests.support.streams import bake_numbered, edit_manifest, set_at
from v3studio.studio.stream import BakeSettings


@pytest.mark.parametrize(
    ("size", "refused"), [((64, 48), False), ((20_000, 20_000), True), ((1, 10**9), True), ((8192, 8193), True)]
)
def test_the_size_of_a_render_is_bounded(tmp_path: Path, here: Callable, size: tuple[int, int], refused: bool) -> None:
    stream = bake_numbered(tmp_path / "stream", (1,), 25, 30, BakeSettings(preset="ultrafast"))
    camera = {**ring(3).cameras[0].to_dict(), "width": size[0], "height": size[1]}
    edit_manifest(stream, set_at(("metadata",), {"suggested_camera": camera}))
    words = (f"the suggested camera has {size[0]}x{size[1]} pixels", "Remove --render.") if refused else ()
    here("play", stream, "--render").fails(*words, code=int(refused))
