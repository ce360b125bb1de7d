"""The table of video codecs: how FFmpeg's encoders are called for images of numbers, and what each can do.

To add one, see docs/architecture.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

CodecName = Literal["h264", "hevc", "av1"]
Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]

PRESETS: tuple[str, ...] = get_args(Preset)
QP_MAX = 51  # of H.264, on whose scale settings are


@dataclass(frozen=True)
class Codec:
    """Options of an FFmpeg encoder for constant QP, one I frame at the start, one thread, no psychovisual tuning."""

    encoder: str  # FFmpeg's name
    options: Mapping[str, str]  # for QPs above 0; {qp}, {preset} and {b} (B-frames between P-frames) are filled in
    lossless: Mapping[str, str] | None  # for QP 0; None if not supported
    tag: str | None = None  # FourCC in the MP4, if players expect another one than FFmpeg writes
    takes_b_frames: bool = False  # whether it takes {b}
    qp_max: int = QP_MAX  # largest QP on its own scale
    presets: tuple[str, ...] = PRESETS  # its own names of some of `PRESETS`, where they differ

    def own_qp(self, qp: int) -> int:
        """A QP of the H.264 scale on the codec's own."""
        return round(qp * self.qp_max / QP_MAX)

    def own_preset(self, preset: str) -> str:
        """The codec's own name of a preset."""
        return self.presets[PRESETS.index(preset)]


# Psychovisual tuning (psy) helps images, not numbers. Scene cut detection would insert more I frames.
_X264 = {
    "preset": "{preset}",
    "qp": "{qp}",
    "x264-params": "keyint=infinite:scenecut=0:bframes={b}:psy=0:threads=1:lookahead-threads=1:log=0",
}
# One image of many tiles: deblocking blurs across tiles, and a finer I frame does not pay off (measured).
_X264_TILES = {**_X264, "x264-params": f"{_X264['x264-params']}:no-deblock=1:ipratio=1.0"}
_X265_TILES = (  # the lookahead must be longer than a run of B-frames, of which there are at most 7
    "keyint=-1:scenecut=0:bframes={b}:psy-rd=0:psy-rdoq=0:aq-mode=0:cutree=0:ipratio=1.0:no-deblock=1:no-sao=1:"
    "rc-lookahead=8:frame-threads=1:pools=none:no-wpp=1:info=0:log-level=none"
)

CODECS: dict[str, Codec] = {  # codecs of images of many tiles (profile `motion`), by their names in the manifest
    "h264": Codec("libx264", _X264_TILES, _X264_TILES, takes_b_frames=True),
    "hevc": Codec(
        "libx265",
        {"preset": "{preset}", "x265-params": f"qp={{qp}}:{_X265_TILES}"},
        {"preset": "{preset}", "x265-params": f"lossless=1:{_X265_TILES}"},
        "hvc1",
        takes_b_frames=True,
    ),
    "av1": Codec(
        "libsvtav1",
        {"preset": "{preset}", "svtav1-params": "rc=0:aq-mode=0:qp={qp}:pred-struct=1:keyint=-1:lp=1:enable-tf=0"},
        None,
        qp_max=63,
        presets=("12", "11", "10", "10", "9", "8", "7", "6", "5"),  # about as fast as x264's of the same name
    ),
}

PLANE_CODEC = Codec("libx264", _X264, _X264)
"""H.264 for single planes (profile `planes`, VideoGS): with deblocking, and a finer I frame (ipratio 1.4)."""
