"""Malicious streams: mutated, with all sizes and checksums updated. The player may play them or report what is wrong;
it must not hang, use more memory than the manifest specifies, or crash.

V3STUDIO_HOSTILE_STREAMS sets how many are tried; the default is quick.
"""

from __future__ import annotations

import os
import random
import shutil
import zlib
from pathlib import Path
from typing import Any

import pytest

from studio.stream.sidefile import deflate
from tests.support.streams import best_of, edit_manifest, group_files, replace_file

pytestmark = pytest.mark.web

COUNT = int(os.environ.get("V3STUDIO_HOSTILE_STREAMS", "24"))
BATCH = 12
VALUES: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    7,
    255,
    65536,
    2**31,
    2**53,
    1e300,
    -1e9,
    1e-300,
    "",
    "x",
    "../x",
    [],
    {},
    [[]],
]


def mutate_bytes(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(changed))
        kind = rng.randrange(4)
        if kind == 0:
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[at : at + rng.randint(1, 16)] = rng.randbytes(rng.randint(0, 16))
        elif kind == 2:
            changed[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0"])
        else:
            del changed[at : at + rng.randint(1, 200)]
        if not changed:
            changed = bytearray(b"\0")
    return bytes(changed)


def mutate(rng: random.Random, folder: Path) -> str:
    """Change a stream; returns a description of the change, for the message if the player fails."""
    kind = rng.choice(["manifest", "side content", "side file", "video"])
    if kind == "manifest":

        def change(values: dict[str, Any]) -> None:
            at: Any = values
            for _ in range(rng.randint(1, 5)):
                keys = list(at) if isinstance(at, dict) else list(range(len(at)))
                key = rng.choice(keys)
                if isinstance(at[key], dict | list) and at[key] and rng.random() < 0.85:
                    at = at[key]
                    continue
                at[key] = rng.choice(VALUES)
                return

        try:
            edit_manifest(folder, change)
        except (TypeError, KeyError, ValueError, AttributeError):
            (folder / "manifest.json").write_bytes(b"[" * rng.randint(1, 100_000))  # a checksum cannot be added
    elif kind == "side content":
        group = rng.randrange(2)
        raw = zlib.decompress(group_files(folder, group)[0].read_bytes(), wbits=-15)
        changed = mutate_bytes(rng, raw)
        replace_file(folder, group, "side", deflate([changed]), len(changed))
    else:
        group, key = rng.randrange(2), "side" if kind == "side file" else "video"
        file = group_files(folder, group)[("side", "video").index(key)]
        replace_file(folder, group, key, mutate_bytes(rng, file.read_bytes()))
    return kind


TRY = """async url => {
  const element = document.createElement('v3-player');
  element.style.cssText = 'width: 100px; height: 100px';
  element.setAttribute('loop', '');
  element.setAttribute('src', url);
  let outcome = null;
  element.addEventListener('v3-error', ({detail}) => { outcome ??= 'error: ' + detail; });
  element.addEventListener('v3-looped', () => { outcome ??= 'played'; });
  document.body.append(element);
  element.play();
  element.setSpeed(4);
  const began = performance.now();
  // One frame alone, or a rate near nothing, is played as well as it can be: then the first picture is enough.
  while (outcome === null && performance.now() - began < 60_000) {
    await new Promise(done => setTimeout(done, 50));
    const {ready, duration, frameCount} = element.state;
    if (ready && (duration > 5 || frameCount === 1)) outcome = 'shown';
  }
  element.remove();
  return outcome;
}"""


@pytest.mark.parametrize("batch", range(-(-COUNT // BATCH)))
def test_mutated_streams(site, baked, open_page, batch):
    originals = baked(stream_version=2), baked()
    (site.folder / "host.html").write_text(
        "<!doctype html><v3-player hidden></v3-player><script type='module' src='v3-player.js'></script>"
    )
    page = open_page(path="/host.html", wait=False)
    page.wait("customElements.get('v3-player')")
    seen: dict[str, int] = {}
    for number in range(BATCH * batch, min(BATCH * (batch + 1), COUNT)):
        folder = site.folder / f"s{number}"
        shutil.copytree(originals[number % 2], folder)
        kind = mutate(random.Random(number), folder)
        outcome = page.evaluate(TRY, f"s{number}/")
        assert outcome is not None, f"stream {number} ({kind}) hangs"
        assert len(outcome) < 700
        seen[outcome[:6]] = seen.get(outcome[:6], 0) + 1
        shutil.rmtree(folder)
    used = page.evaluate("() => { gc(); return performance.memory.usedJSHeapSize; }")
    assert used < 64 << 20, seen
    assert not page.errors
    assert sum(seen.values()) == min(BATCH, COUNT - BATCH * batch)


def test_a_bomb_is_not_unpacked(site, baked, open_page):
    shutil.copytree(baked(), site.stream)
    for group in range(2):
        replace_file(site.stream, group, "side", deflate([bytes(200_000_000)]))
    page = open_page(wait=False)
    page.wait("(seen.error ?? []).length")
    assert "decompresses to more than" in page.seen("error")[0]


def test_a_path_out_of_the_stream_is_refused(site, baked, open_page):
    shutil.copytree(baked(), site.stream)
    edit_manifest(site.stream, lambda values: best_of(values["groups"][0])["side"].update(path="../secret.bin"))
    page = open_page(wait=False)
    page.wait("(seen.error ?? []).length")
    assert "groups.0.side.path" in page.seen("error")[0]
    assert not any("secret" in path for path, _ in site.requests)


def test_a_manifest_that_was_edited_is_refused(site, baked, open_page):
    shutil.copytree(baked(), site.stream)
    path = site.stream / "manifest.json"
    path.write_bytes(path.read_bytes().replace(b'"fps":25', b'"fps":24'))
    page = open_page(wait=False)
    page.wait("(seen.error ?? []).length")
    assert "does not match its own SHA-256" in page.seen("error")[0]
