"""Malicious streams: mutated, with all sizes and checksums updated. The player may play them or report what is wrong;
it must not hang, use more memory than the manifest specifies, or crash.
"""

import shutil

import pytest
from driver import Baked, OpenPage, Site

from tests.support.hostile_streams import mutate
from tests.support.streams import best_of, contents, edit_manifest, group_files, replace_file
from v3studio.studio.stream.sidefile import deflate

pytestmark = pytest.mark.web

COUNT = 20
PATIENCE = 60.0
"""Seconds in which a mutated stream must be refused or played."""

PAGE = """<!doctype html><v3-player id="player" loop style="width: 100px; height: 100px"></v3-player>
<script type="module" src="v3-player.js"></script>"""

PLAY = """async ([url, patience]) => {
  let outcome = null;
  const stop = new AbortController(), signal = stop.signal;
  player.addEventListener('v3-error', ({detail}) => { outcome ??= 'refused: ' + detail; }, {signal});
  let notice = null;
  player.addEventListener('v3-notice', ({detail}) => { notice ??= 'without a group: ' + detail; }, {signal});
  player.addEventListener('v3-looped', () => { outcome ??= notice ?? 'played'; }, {signal});
  player.setAttribute('src', url);
  player.play();
  player.setSpeed(4);
  const began = performance.now();
  // A single frame, or a rate near nothing, is played as well as it can be: then the first picture is enough.
  while (outcome === null && performance.now() - began < 1000 * patience) {
    await new Promise(done => setTimeout(done, 5));
    const {ready, duration, frameCount} = player.state;
    if (ready && (duration > 5 || frameCount === 1)) outcome = 'shown';
  }
  stop.abort();
  return outcome;
}"""


def test_mutated_streams(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """In one page: each is played or rejected with a sentence."""
    files = contents(baked())
    page = open_page(html=PAGE, wait=False)
    page.wait("customElements.get('v3-player')")
    outcomes = []
    for number in range(COUNT):
        kind, changed = mutate(files, number)
        for name, data in changed.items():
            path = site.folder / f"s{number}" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        outcome = page.evaluate(PLAY, [f"s{number}/", PATIENCE])
        assert outcome is not None, f"mutation {number} ({kind}) hangs"
        assert outcome in ("played", "shown") or 20 < len(outcome) < 700
        outcomes.append(outcome.partition(":")[0])
    used = page.evaluate("() => { gc(); return performance.memory.usedJSHeapSize; }")
    assert {"played", "refused", "without a group"} <= set(outcomes)
    assert used < 64 << 20


def unpack_a_bomb(stream):
    bomb = deflate([bytes(20_000_000)])
    for group in range(2):
        replace_file(stream, group, "side", bomb)


def lose_the_videos(stream):
    for group in range(2):
        group_files(stream, group)[1].unlink()


def edit_without_sealing(stream):
    path = stream / "manifest.json"
    path.write_bytes(path.read_bytes().replace(b'"fps":25', b'"fps":24'))


def lead_out_of_the_stream(stream):
    edit_manifest(stream, lambda values: best_of(values["groups"][0])["side"].update(path="../secret.bin"))


REFUSED = {
    shutil.rmtree: "manifest.json cannot be fetched: the server returned status 404",
    lambda stream: edit_manifest(stream, lambda values: values.update(version=99)): "format version 99",
    edit_without_sealing: "does not match its own SHA-256",
    lead_out_of_the_stream: "groups.0.renditions.0.side.path",
    unpack_a_bomb: "decompresses to more than",
    lose_the_videos: ".mp4 cannot be fetched: the server returned status 404",
}


def test_what_cannot_be_played_is_refused_in_a_sentence(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """In one page, which then plays another stream."""
    page = open_page("?src=none/&t=0", wait=False)
    page.wait("(seen.error ?? []).length")
    failure = page.handle.locator("v3-player .failure")
    open_other = "name => { window.seen = {}; document.querySelector('v3-player').setAttribute('src', name); }"
    for number, (spoil, said) in enumerate(REFUSED.items()):
        spoil(shutil.copytree(baked(), site.folder / str(number)))
        page.evaluate(open_other, f"{number}/")
        page.wait("(seen.error ?? []).length")
        assert said in page.seen("error")[0]
        assert failure.inner_text().startswith(page.seen("error")[0])
    assert not any("secret" in path for path, _ in site.requests)
    for address in ("javascript:alert(1)", "data:application/json,{}", "file:///etc/passwd", "blob:x"):
        page.evaluate(open_other, address)
        page.wait("(seen.error ?? []).length")
        assert "http and https" in page.seen("error")[0]
        assert not page.seen("notice"), "it is not tried again"
    page.evaluate(open_other, "#]::")
    failure.get_by_text("#]::", exact=False).wait_for()
    assert "#]::" in page.seen("error")[0]
    shutil.copytree(baked(), site.folder / "whole")
    page.evaluate(open_other, "whole/")
    page.wait_ready()
    assert not failure.is_visible()
