"""The frames follow the sound; it is exact in time, and off until the viewer wants it if the browser says so."""

import base64
import itertools
import shutil
from pathlib import Path

import pytest
from driver import Baked, OpenPage, Site

from v3studio.studio.stream import StreamReader

pytestmark = pytest.mark.web

FPS = 25
CLICK = 0.12

FAKE = """() => {
  // The element's clock in the hands of the test.
  window.heard = 0; window.playing = false; window.starts = []; window.seen = {};
  const {element} = document.querySelector('v3-player').engine.sound;
  Object.defineProperty(element, 'currentTime', {
    get: () => window.heard += 1e-9, // never stuck
    set: (at) => { window.heard = at; window.starts.push(at); } });
  Object.defineProperty(element, 'ended', {value: false}); // the real one may be at its end
  element.play = async () => { window.playing = true; };
  element.pause = () => { window.playing = false; };
}"""


WITHOUT_WEB_AUDIO = "delete window.AudioContext"
"""The element plays, as at other speeds and for long loops."""


LISTEN = """{
  // Records when clicks reach the output, on the clock of its samples.
  window.clicks = [];
  const connect = AudioNode.prototype.connect;
  AudioNode.prototype.connect = function (target, ...others) {
    if (target instanceof AudioDestinationNode) void listen(this, connect);
    return connect.call(this, target, ...others);
  };
  async function listen(node, connect) {
    const code = `registerProcessor('clicks', class extends AudioWorkletProcessor {
      process([[samples]]) {
        (samples ?? []).forEach((value, i) => {
          const at = (currentFrame + i) / sampleRate;
          if (Math.abs(value) > 0.2 && at - (this.last ?? -1) > 0.1) this.port.postMessage(this.last = at);
        });
        return true;
      }
    })`;
    await node.context.audioWorklet.addModule(URL.createObjectURL(new Blob([code], {type: 'text/javascript'})));
    const worklet = new AudioWorkletNode(node.context, 'clicks');
    worklet.port.onmessage = ({data}) => window.clicks.push(data);
    connect.call(node, worklet);
  }
}"""


@pytest.fixture
def sounding(site: Site, baked: Baked) -> Path:
    """Nine frames with a click in frame 3."""
    return shutil.copytree(baked(ladder=(16,), splats=300, clicks=(CLICK,)), site.stream)


def test_loops_have_no_gap(sounding: Path, open_page: OpenPage) -> None:
    """Clicks of one loop and the next are exactly a loop apart, and the frames stay with them."""
    page = open_page("?t=0", LISTEN)
    page.wait("player.engine.sound?.present")
    page.click("play")  # an input, which allows sound
    page.wait("window.clicks.length >= 6 && (seen.looped ?? []).length >= 6")
    page.call("pause")
    clicks = page.evaluate("() => window.clicks")
    apart = [after - before for before, after in itertools.pairwise(clicks)]
    assert sum(abs(gap - 9 / FPS) < 0.001 for gap in apart) >= 4, apart


def test_it_plays_with_the_click_where_it_should_be_and_the_frames_follow(sounding: Path, open_page: OpenPage) -> None:
    page = open_page("?t=0", WITHOUT_WEB_AUDIO)
    page.wait("player.engine.sound?.present")
    page.click("play")  # an input: without one, Chromium refuses some sounds, even muted ones
    page.wait("(seen.looped ?? []).length && player.engine.sound?.element.played.length")
    assert not page.seen("notice")
    button = page.handle.locator("v3-player .bar [data-act='sound']")
    assert button.is_visible()
    page.call("pause")
    page.wait("player.engine.sound?.element.paused")
    muted = page.state["muted"]
    page.click("sound")
    assert page.state["muted"] is not muted
    page.handle.locator("v3-player .stage").focus()
    page.handle.keyboard.press("m")
    assert page.state["muted"] is muted
    with StreamReader.open(sounding) as reader:
        data, entry = reader.audio_bytes(), reader.manifest.audio
    # The encoder's delay is skipped by the browser's decoder as by ours.
    state = page.evaluate(
        """async (text) => {
          const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
          const sound = await new OfflineAudioContext(1, 1, 48000).decodeAudioData(bytes.buffer);
          const samples = sound.getChannelData(0);
          const loudest = samples.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
          return [samples.findIndex((value) => Math.abs(value) > loudest / 3) / 48000, samples.length]; }""",
        base64.b64encode(data).decode(),
    )
    assert state[0] == pytest.approx(CLICK, abs=0.001)
    assert state[1] >= entry.samples
    page.call("seek", 0)
    page.evaluate(FAKE)
    page.call("play")
    page.wait("window.playing")
    for frame in (2, 3, 6):
        page.evaluate("at => { window.heard = at; }", (frame + 0.5) / FPS)
        page.wait("player.state.frame === argument", frame)
    page.handle.wait_for_timeout(200)  # five frames of the wall clock
    assert page.state["frame"] == 6
    page.call("pause")
    page.wait("!window.playing")
    page.call("seek", 1.5 / FPS)
    page.wait("player.state.frame === 1")
    page.call("play")
    page.wait("window.playing && Math.abs(window.starts.at(-1) - 1 / 25) < 0.001")
    page.evaluate("() => { window.heard = 8.9 / 25; }")
    page.wait("player.state.frame === 8")
    page.evaluate("() => { window.heard = 9 / 25; }")  # the end: sound and frames start over together
    page.wait("(seen.looped ?? []).length && window.starts.at(-1) < 0.08")


def test_a_browser_that_waits_for_the_viewer(sounding: Path, open_page: OpenPage) -> None:
    """Sound is refused before the first input; muted, it plays and leads, however late the browser refuses."""
    refuse = """{
      window.refusals = []; window.silent = 0; window.loud = 0;
      const play = HTMLMediaElement.prototype.play;
      HTMLMediaElement.prototype.play = function () {
        if (!this.muted && !window.allowed)
          return new Promise((_, no) => window.refusals.push(() => no(new DOMException('no', 'NotAllowedError'))));
        if (this.tagName === 'AUDIO') window[this.muted ? 'silent' : 'loud']++;
        return play.call(this);
      };
    }"""
    page = open_page("", WITHOUT_WEB_AUDIO, refuse)
    page.wait("window.refusals.length === 1")
    page.call("pause")
    page.call("play")
    page.wait("window.refusals.length === 2")
    page.evaluate("() => { for (const refuse of window.refusals) refuse(); }")
    page.wait("player.engine.sound?.blocked && player.state.muted && window.silent > 0")
    assert "without sound" in page.handle.locator("v3-player .notice").inner_text()
    page.evaluate("() => { window.allowed = true; }")
    page.call("setMuted", False)
    page.wait("!player.state.muted && window.loud > 0")


def test_sound_that_is_damaged_leaves_the_frames(sounding: Path, open_page: OpenPage) -> None:
    file = next((sounding / "files").glob("*.m4a"))
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(bytes(data))
    page = open_page()
    page.wait("(seen.notice ?? []).length && (seen.looped ?? []).length")
    assert "without sound" in page.seen("notice")[0]
    assert page.state["muted"] is False
    assert not page.handle.locator("v3-player .bar [data-act='sound']").is_visible()
