import random
import struct
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import open_footage

NOISE = np.random.default_rng(0).integers(0, 255, (40, 64, 96, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("closed.mp4", "libx264", {"bf": "3", "g": "10", "crf": "20"}),
        ("open.mp4", "libx264", {"bf": "3", "g": "8", "crf": "20", "x264-params": "open-gop=1:b-pyramid=normal"}),
        ("one_keyframe.mkv", "libx264", {"bf": "2", "g": "250", "crf": "20"}),
        ("no_times.avi", "mpeg4", {"bf": "2", "g": "12", "q": "3"}),
        ("stream.h264", "libx264", {"bf": "3", "g": "10", "crf": "20"}),
    ],
)
def test_frames_in_any_order(
    tmp_path: Path, make: SimpleNamespace, name: str, codec: str, options: dict[str, str]
) -> None:
    path = make.video(tmp_path / name, [make.numbered(index) for index in range(60)], codec=codec, options=options)
    reader = VideoReader(path)
    assert reader.frame_count == 60
    order = [0, 1, 2, 59, 58, 30, 31, 12, 13, 50, 7, *random.Random(1).sample(range(60), 25)]
    assert [make.number_of(reader.read(index)) for index in order] == order


@pytest.mark.parametrize(
    ("matrix", "tag", "red", "blue"),
    [
        ("bt601", None, 0.299, 0.114), ("bt709", None, 0.2126, 0.0722),
        ("auto", None, 0.299, 0.114), ("auto", 1, 0.2126, 0.0722), ("auto", 5, 0.299, 0.114),
    ],
)  # fmt: skip
def test_colors_follow_the_color_matrix(tmp_path: Path, matrix: str, tag: int | None, red: float, blue: float) -> None:
    # One flat YUV color, lossless; expected RGB from the definition of limited-range YCbCr.
    y, u, v = 120, 90, 160
    planes = np.concatenate([np.full(64 * 96, y), np.full(32 * 48, u), np.full(32 * 48, v)]).astype(np.uint8)
    frame = planes.reshape(96, 96)  # PyAV's layout of yuv420p for 96x64: (64 * 3 / 2, 96)
    path = tmp_path / "flat.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.options = 96, 64, "yuv420p", {"qp": "0"}
        if tag is not None:
            stream.codec_context.colorspace = tag
        container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="yuv420p")))
        container.mux(stream.encode())
    luma, cb, cr = (y - 16) / 219, (u - 128) / 224, (v - 128) / 224
    r, b = luma + 2 * (1 - red) * cr, luma + 2 * (1 - blue) * cb
    g = (luma - red * r - blue * b) / (1 - red - blue)
    mean = VideoReader(path, matrix).read(0)[20:40, 20:40].reshape(-1, 3).mean(0)
    np.testing.assert_allclose(mean, 255 * np.array([r, g, b]), atol=1.2)


def test_damaged_videos_are_refused(tmp_path: Path, make: SimpleNamespace) -> None:
    path = make.video(tmp_path / "a.mp4", NOISE, options={"crf": "20"})
    with refuses("footage.no_such_frame", file=path, value=40, frame=40):
        VideoReader(path).read(40)
    data = path.read_bytes()
    assert b"avc1" in data
    for damaged in (data[: len(data) // 2], b"not a video", data.replace(b"avc1", b"zzzz")):  # the index is last
        path.write_bytes(damaged)
        with refuses("footage.video_unreadable", file=path):
            VideoReader(path)
    path.unlink()
    with refuses("footage.video_missing", file=path):
        VideoReader(path)


def test_a_video_truncated_after_its_index_reports_where_it_ends(tmp_path: Path, make: SimpleNamespace) -> None:
    path = make.video(tmp_path / "fast.mp4", NOISE, options={}, container_options={"movflags": "faststart"})
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    reader = VideoReader(path)
    assert reader.frame_count == 40
    with pytest.raises(StudioError) as caught:
        [reader.read(index) for index in range(40)]
    assert caught.value.code in ("footage.video_truncated", "footage.frame_undecodable")
    assert caught.value.file == path
    assert 0 < caught.value.fields["frame"] < 40
    assert reader.read(0).shape == (64, 96, 3)  # intact frames can still be read


PLAYLISTS = {
    "ffconcat": "ffconcat version 1.0\nfile 'real.mp4'\n",
    "hls": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nreal.mp4\n#EXT-X-ENDLIST\n",
    "sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\n",
}


@pytest.mark.parametrize("kind", PLAYLISTS)
def test_a_playlist_with_the_name_of_a_video_is_refused(tmp_path: Path, make: SimpleNamespace, kind: str) -> None:
    make.video(tmp_path / "real.mp4", [make.numbered(index) for index in range(3)])
    trap = tmp_path / "cam01.mp4"
    trap.write_text(PLAYLISTS[kind])
    with refuses("footage.video_unreadable", file=trap):
        VideoReader(trap)


def with_times(path: Path, make: SimpleNamespace, times: list[int], codec: str, dropped: tuple[int, ...] = ()) -> Path:
    """Numbered frames at these times (1/25 s). Packets of `dropped` become MPEG-4's "not coded" frames."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 25)
        stream.options = {"bf": "0", "g": "6", "q": "3"} if codec == "mpeg4" else {"bf": "2", "g": "6", "crf": "20"}

        def write(packets: list[av.Packet]) -> None:
            for packet in packets:
                if packet.pts in dropped:
                    # ISO/IEC 14496-2, 6.2.5: type P, no second passed, 5 bits of time, vop_coded = 0, stuffing
                    bits = f"0101{packet.pts % 25:05b}1001111"
                    other = av.Packet(b"\0\0\1\xb6" + int(bits, 2).to_bytes(2, "big"))
                    other.pts, other.dts, other.time_base = packet.pts, packet.dts, packet.time_base
                    other.stream = stream
                    packet = other
                container.mux(packet)

        for time in times:
            frame = av.VideoFrame.from_ndarray(make.numbered(time), format="rgb24")
            frame.pts, frame.time_base = time, Fraction(1, 25)
            write(stream.encode(frame))
        write(stream.encode())
    return path


@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "libx264"), ("a.mkv", "libx264"), ("a.avi", "mpeg4")])
def test_skipped_frames_repeat_the_one_before(tmp_path: Path, make: SimpleNamespace, name: str, codec: str) -> None:
    """So that frame numbers stay times, and cameras in sync."""
    times = [time for time in range(30) if time not in (7, 8, 20)]
    reader = VideoReader(with_times(tmp_path / name, make, times, codec))
    assert reader.frame_count == 30
    assert reader.fps == pytest.approx(25, rel=1e-3)
    assert "3 frames repeat" in reader.note
    for index in (0, 6, 7, 8, 9, 29, 20, 21, 19, 8):
        assert make.number_of(reader.read(index)) == {7: 6, 8: 6, 20: 19}.get(index, index)


def test_packets_of_dropped_frames_do_not_make_a_video_truncated(tmp_path: Path, make: SimpleNamespace) -> None:
    path = with_times(tmp_path / "a.avi", make, list(range(30)), "mpeg4", dropped=(10, 11, 20))
    reader = VideoReader(path)
    assert reader.frame_count == 30
    assert "3 dropped frames" in reader.note
    for index in (29, 24, 9, 10, 11, 20, 0, 11, 18):  # others refer to a missing frame until the next keyframe
        assert make.number_of(reader.read(index)) == {10: 9, 11: 9, 20: 19}.get(index, index)


@pytest.mark.parametrize("slow", [range(20, 50), range(30, 36)])
def test_a_rate_that_is_lower_for_a_while(tmp_path: Path, make: SimpleNamespace, slow: range) -> None:
    """As of phones in low light: 24 instead of 30 frames per second."""
    steps = [5 if index in slow else 4 for index in range(99)]
    times = np.concatenate([[0], np.cumsum(steps)])
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 120)
        for index, time in enumerate(times):
            frame = av.VideoFrame.from_ndarray(make.numbered(index), format="rgb24")
            frame.pts, frame.time_base = int(time), Fraction(1, 120)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    reader = VideoReader(path)
    assert reader.fps == pytest.approx(30, rel=1e-3)
    for index in range(0, reader.frame_count, 9):
        shown = make.number_of(reader.read(index))
        assert abs(times[shown] - 4 * index) <= 2.5  # 1/120 s


def test_a_rate_that_is_lower_from_camera_to_camera(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera, rate in (("a", Fraction(30)), ("b", Fraction(2988, 100))):
        make.video(tmp_path / "videos" / f"{camera}.mp4", [make.numbered(0)] * 150, fps=rate)
    with refuses("footage.fps_mismatch"):
        open_footage(CaptureSettings(root=tmp_path, masks="none"))
    assert len(open_footage(CaptureSettings(root=tmp_path, masks="none", frames=":20")).frames) == 20


@pytest.mark.parametrize(
    ("matrix", "shown"),  # of x and y, down, in 1 / 65536
    [
        ((-1, 0, 0, 1), lambda image: image[:, ::-1]),
        ((1, 0, 0, -1), lambda image: image[::-1]),
        ((0, 1, 1, 0), lambda image: image.transpose(1, 0, 2)),
        ((0, 1, -1, 0), lambda image: np.rot90(image, -1)),
    ],
    ids=["left to right", "up and down", "transposed", "clockwise"],
)
def test_a_mirrored_display_matrix(tmp_path: Path, make: SimpleNamespace, matrix: tuple[int, ...], shown: Any) -> None:
    """Written into the header of the track; see ISO/IEC 14496-12, 8.3.2."""
    image = np.zeros((64, 96, 3), np.uint8)
    image[:32, :48] = 255
    path = make.video(tmp_path / "a.mp4", [image] * 2)
    data = path.read_bytes()
    a, b, c, d = (part * 65536 for part in matrix)
    at = data.index(b"tkhd") + 4 + 40
    path.write_bytes(data[:at] + struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30) + data[at + 36 :])
    read = VideoReader(path).read(1)
    assert read.shape == shown(image).shape
    assert np.abs(read.astype(int) - shown(image)).mean() < 3


def test_an_untagged_camera_has_the_matrix_of_the_others(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera, tag in (("a", 1), ("b", None), ("c", 1)):
        make.video(tmp_path / "videos" / f"{camera}.mp4", [np.full((64, 96, 3), (200, 40, 40), np.uint8)] * 2, tag=tag)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none"))
    own = VideoReader(tmp_path / "videos/b.mp4", "bt709").read(0)
    np.testing.assert_array_equal(footage.raw_image("b", 0), own)
    assert "no color matrix" in footage.description


def test_a_rate_without_rhythm_is_refused(tmp_path: Path, make: SimpleNamespace) -> None:
    path = with_times(tmp_path / "a.mkv", make, [0, 1, 2, 3, 40, 41, 42, 80, 81], "libx264")
    with refuses("footage.variable_rate", file=path) as caught:
        VideoReader(path)
    assert "-fps_mode cfr -r 25" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "codec", "pixels"), [("a.mov", "prores_ks", "yuv422p10le"), ("a.mkv", "libx264", "yuv420p10le")]
)
def test_ten_bits_and_prores(tmp_path: Path, make: SimpleNamespace, name: str, codec: str, pixels: str) -> None:
    images = [make.numbered(index) for index in (3, 5)]
    reader = VideoReader(make.video(tmp_path / name, images, codec=codec, pixels=pixels, options={}))
    assert [make.number_of(reader.read(index)) for index in (1, 0)] == [5, 3]
    assert np.abs(reader.read(0)[8:-8, 30:90].astype(int) - make.numbered(3)[8:-8, 30:90]).mean() < 4


@pytest.mark.parametrize(
    ("shape", "rotation", "size"),
    [
        (None, 90, (64, 96)),
        (Fraction(4, 3), 0, (128, 64)),
        (Fraction(4, 3), 90, (64, 128)),
        (Fraction(8, 9), 0, (96, 72)),
        (Fraction(801, 800), 0, (96, 64)),  # as resizing leaves it
    ],
)
@pytest.mark.parametrize("pixels", ["yuv420p", "gray"])
def test_videos_are_turned_and_stretched_for_display(
    tmp_path: Path, make: SimpleNamespace, shape: Fraction, rotation: int, size: tuple[int, int], pixels: str
) -> None:
    image = np.zeros((64, 96, 3), np.uint8)
    image[32:, 48:] = 255  # the lower right quarter
    path = make.video(tmp_path / "wide.mov", [image] * 2, rotation=rotation, shape=shape, pixels=pixels)
    reader = VideoReader(path)
    assert (reader.width, reader.height) == size
    stretched = size not in ((96, 64), (64, 96))
    assert ("stretched" in reader.note) == stretched
    shown = reader.read(1)
    assert shown.shape == (*size[::-1], 3)
    bright = np.argwhere(shown[..., 0] > 127)
    center = (bright.mean(axis=0) + 0.5) / shown.shape[:2]
    np.testing.assert_allclose(center, (0.25 if rotation else 0.75, 0.75), atol=0.02)
    assert reader.chroma is None or not stretched
