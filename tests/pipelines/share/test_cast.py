import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.splats import noise, round_splats
from tests.support.streams import bake_numbered, contents, edit_manifest
from tests.support.web_servers import PLAYER
from v3studio.pipelines.share.cast import read_cast
from v3studio.pipelines.share.page import PageText
from v3studio.pipelines.share.sharing import share
from v3studio.studio.formats import ply, read_splats
from v3studio.studio.stream import StreamReader

ROOT = Path(__file__).parents[3]
ITEM = {"stream": "walk"}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the stream `walk`, splats, and the built page."""
    said = {"credits": "Jane <Doe>", "license": "CC BY 4.0"}
    edit_manifest(bake_numbered(tmp_path / "walk", [2], 25.0), lambda manifest: manifest.update(metadata=said))
    ply.write(tmp_path / "a chair #1.ply", round_splats(noise(3)(20, 3), -2.0, 0.9))
    page = (ROOT / "web" / "src" / "index.html").read_text()
    monkeypatch.setattr("v3studio.pipelines.share.cast_folder.read_player", lambda: replace(PLAYER, page=page))
    return tmp_path


def document(place: Path, *items: object, **fields: object) -> Path:
    path = place / "cast.json"
    path.write_text(json.dumps({"format": "v3studio-cast", "version": 1, "items": items or [ITEM], **fields}))
    return path


def test_the_page_has_each_stream_once(place: Path) -> None:
    chair = {"splats": "a chair #1.ply", "scale": 2}
    cast = document(place, ITEM, {**ITEM, "start": 1.5, "turn": [0, 90, 0]}, chair, title="Two & a chair")
    shared = share(cast, place / "site")
    site = place / "site"
    first, second, third = json.loads((site / "cast.json").read_text())["items"]
    assert contents((site / first["stream"]).parent) == contents(place / "walk")
    assert (second["stream"], second["start"]) == (first["stream"], 1.5)
    np.testing.assert_allclose(
        np.reshape(second["place"], (3, 4)), np.eye(3, 4)[[2, 1, 0]] * [[1], [1], [-1]], atol=1e-12
    )
    # Static splats are a stream of one frame.
    np.testing.assert_allclose(np.reshape(third["place"], (3, 4)), 2 * np.eye(3, 4))
    with StreamReader.open((site / third["stream"]).parent) as still:
        assert still.frame_count == 1
        chair = np.sort(read_splats(place / "a chair #1.ply").means.numpy(), axis=0)
        np.testing.assert_allclose(np.sort(still.gaussians(0).means.numpy(), axis=0), chair, atol=0.01)
    page = (site / "index.html").read_text()
    assert "<title>Two &amp; a chair</title>" in page
    assert 'data-credits="Jane &lt;Doe&gt;, CC BY 4.0"' in page
    # What is there without a script, and in a link preview.
    assert "<noscript>" in page
    [poster], [preview] = site.glob("poster.*.jpg"), site.glob("preview.*.jpg")
    assert f'<img src="{poster.name}"' in page
    assert "<h1>Two &amp; a chair</h1>" in page
    assert f'<meta property="og:image" content="{preview.name}">' in page
    assert cv2.imread(str(preview)).shape == (630, 1200, 3)
    assert cv2.imread(str(poster)).std() > 1
    [script] = site.glob("v3-cast.*.js")
    assert f'src="{script.name}"' in page
    assert shared.total_bytes == sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    share(cast, site, PageText(title="Other", credits="Somebody"), overwrite=True)
    assert 'data-credits="Somebody"' in (site / "index.html").read_text()


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"version": 2}, "version"),
        ({"sound": "a.wav"}, "sound"),
        ({"camera": {"fov": 0}}, "camera.fov"),
        ({"ground": {"shadow": 2}}, "ground.shadow"),
        ({"items": []}, "items"),
        ({"items": [{**ITEM, "position": [0, 0]}]}, "items.0.position.2"),
        ({"items": [{**ITEM, "position": [0, 0, float("nan")]}]}, "items.0.position.2"),
        ({"items": [{**ITEM, "scale": 0}]}, "items.0.scale"),
        ({"items": [{**ITEM, "start": -1}]}, "items.0.start"),
        ({"items": [ITEM, {**ITEM, "splats": "a.ply"}]}, "items.1"),
        ({"items": [{"splats": "a.glb"}]}, "items.0"),
    ],
)
def test_a_document_that_is_refused_names_the_value(place: Path, change: dict[str, Any], key: str) -> None:
    cast = document(place, **change) if "items" not in change else document(place)
    cast.write_text(json.dumps({**json.loads(cast.read_text()), **change}))
    with refuses("share.bad_cast", file=cast, key=key):
        share(cast, place / "site")
    assert not (place / "site").exists()


def test_the_example_and_the_guide_describe_casts(place: Path) -> None:
    example = share(ROOT / "examples" / "web" / "cast.json", place / "example")
    assert example.stream_bytes > 500_000
    guide = (ROOT / "docs" / "guides" / "web.md").read_text(encoding="utf-8")
    [written] = re.findall(r"```json\n(.*?)```", guide, re.DOTALL)
    (place / "guide.json").write_text(written)
    assert len(read_cast(place / "guide.json").items) == 4


def test_what_is_missing_leaves_the_earlier_share(place: Path) -> None:
    site = place / "site"
    share(document(place), site)
    before = contents(site)
    with refuses("share.bad_cast", file=place / "none.spz"):
        share(document(place, ITEM, {"splats": "none.spz"}), site, overwrite=True)
    with refuses("stream.not_found"):
        share(document(place, {"stream": "none"}), site, overwrite=True)
    with refuses("share.bad_cast"):
        share(document(place), site, PageText(view="30,10"), overwrite=True)
    (place / "cast.json").write_text("{")
    with refuses("share.bad_cast", file=place / "cast.json"):
        share(place / "cast.json", site, overwrite=True)
    assert contents(site) == before
    with refuses("share.bad_cast"):
        share(document(place), place / "one.html")
