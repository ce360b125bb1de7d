"""Malicious streams: mutated, with all sizes and checksums updated. The player may play them or report what is wrong;
it must not hang, use more memory than the manifest specifies, or crash.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from studio.stream.sidefile import deflate
from tests.support import hostile_streams
from tests.support.streams import best_of, edit_manifest, replace_file

pytestmark = pytest.mark.web

ROOT = Path(__file__).parents[2]
COUNT = 20


def test_mutated_streams(baked, browser):
    """In one page: each is played or rejected with a sentence."""
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    with hostile_streams.hosted(ROOT / "v3studio" / "player") as host:
        outcomes = list(hostile_streams.attack(page, host, hostile_streams.read_stream(baked()), range(COUNT)))
        used = page.evaluate("() => { gc(); return performance.memory.usedJSHeapSize; }")
    page.close()
    assert [number for number, _, _ in outcomes] == list(range(COUNT))
    for number, kind, outcome in outcomes:
        assert outcome is not None, f"mutation {number} ({kind}) hangs"
        assert outcome in ("played", "shown") or 20 < len(outcome) < 700
    words = {outcome.partition(":")[0] for _, _, outcome in outcomes}
    assert {"played", "refused", "without a group"} <= words
    assert used < 64 << 20
    assert not errors


def test_a_bomb_is_not_unpacked(site, baked, open_page):
    shutil.copytree(baked(), site.stream)
    bomb = deflate([bytes(200_000_000)])
    for group in range(2):
        replace_file(site.stream, group, "side", bomb)
    page = open_page(wait=False)
    page.wait("(seen.error ?? []).length")
    assert "decompresses to more than" in page.seen("error")[0]


def test_a_path_out_of_the_stream_is_refused(site, baked, open_page):
    shutil.copytree(baked(), site.stream)
    edit_manifest(site.stream, lambda values: best_of(values["groups"][0])["side"].update(path="../secret.bin"))
    page = open_page(wait=False)
    page.wait("(seen.error ?? []).length")
    assert "groups.0.renditions.0.side.path" in page.seen("error")[0]
    assert not any("secret" in path for path, _ in site.requests)


def test_a_manifest_that_was_edited_is_refused(site, baked, open_page):
    shutil.copytree(baked(), site.stream)
    path = site.stream / "manifest.json"
    path.write_bytes(path.read_bytes().replace(b'"fps":25', b'"fps":24'))
    page = open_page(wait=False)
    page.wait("(seen.error ?? []).length")
    assert "does not match its own SHA-256" in page.seen("error")[0]
