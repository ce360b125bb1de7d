import random
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from studio.capture.video import VideoReader
from studio.errors import StudioError
from tests.support.errors import refuses


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
def test_frames_are_exact_in_any_order(
    tmp_path: Path, make: SimpleNamespace, name: str, codec: str, options: dict[str, str]
) -> None:
    path = make.video(tmp_path / name, [make.numbered(index) for index in range(60)], codec=codec, options=options)
    reader = VideoReader(path)
    assert reader.frame_count == 60
    order = [0, 1, 2, 59, 58, 30, 31, 12, 13, 50, 7, *random.Random(1).sample(range(60), 25)]
    assert [make.number_of(reader.read(index)) for index in order] == order


def test_sequential_reading_decodes_each_frame_once(tmp_path: Path, make: SimpleNamespace) -> None:
    path = make.video(tmp_path / "v.mp4", [make.numbered(index) for index in range(30)])
    reader = VideoReader(path)
    steps = 0
    real = reader._step

    def counting() -> object:
        nonlocal steps
        steps += 1
        return real()

    reader._step = counting  # type: ignore[method-assign,assignment]
    for index in range(30):
        reader.read(index)
        reader.read(index)
    assert steps <= 30


def test_a_closed_reader_reopens(tmp_path: Path, make: SimpleNamespace) -> None:
    path = make.video(tmp_path / "v.mp4", [make.numbered(index) for index in range(30)])
    reader = VideoReader(path)
    reader.read(20)
    reader.close()
    assert not reader.is_open
    assert make.number_of(reader.read(21)) == 21


@pytest.mark.parametrize(
    ("matrix", "tag", "red", "blue"),
    [
        ("bt601", None, 0.299, 0.114),
        ("bt709", None, 0.2126, 0.0722),
        ("auto", None, 0.299, 0.114),
        ("auto", 1, 0.2126, 0.0722),
        ("auto", 5, 0.299, 0.114),
    ],
)
def test_colors_follow_the_color_matrix(tmp_path: Path, matrix: str, tag: int | None, red: float, blue: float) -> None:
    # One flat YUV color, lossless; expected RGB from the definition of limited-range YCbCr.
    y, u, v = 120, 90, 160
    planes = np.concatenate([np.full(64 * 96, y), np.full(32 * 48, u), np.full(32 * 48, v)]).astype(np.uint8)
    frame = planes.reshape(96, 96)  # PyAV's layout of yuv420p for 96x64: (64 * 3 / 2, 96)
    path = tmp_path / "flat.mp4"
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.options = 96, 64, "yuv420p", {"qp": "0"}
        if tag is not None:
            stream.codec_context.colorspace = tag
        container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="yuv420p")))
        container.mux(stream.encode())
    luma, cb, cr = (y - 16) / 219, (u - 128) / 224, (v - 128) / 224
    r = luma + 2 * (1 - red) * cr
    b = luma + 2 * (1 - blue) * cb
    g = (luma - red * r - blue * b) / (1 - red - blue)
    found = VideoReader(path, matrix).read(0)[20:40, 20:40].reshape(-1, 3).mean(0)
    np.testing.assert_allclose(found, 255 * np.array([r, g, b]), atol=1.2)


def test_lossless_gray_video_is_exact(tmp_path: Path, make: SimpleNamespace) -> None:
    ramp = np.arange(64 * 96).reshape(64, 96).astype(np.uint8)
    path = make.video(tmp_path / "m.mkv", [ramp], codec="ffv1", pixels="gray", options={"level": "3"}, source="gray")
    assert np.array_equal(VideoReader(path).read(0), np.repeat(ramp[:, :, None], 3, 2))


def test_rotation_tag_is_applied(tmp_path: Path, make: SimpleNamespace) -> None:
    image = np.zeros((64, 96, 3), np.uint8)
    image[:16, :] = 255  # the stored image is bright at the top
    path = make.video(tmp_path / "rotated.mp4", [image] * 3, rotation=90)
    reader = VideoReader(path)
    assert (reader.width, reader.height) == (64, 96)
    displayed = reader.read(1)
    # Rotated by 90 degrees counterclockwise for display, the top becomes the left.
    assert displayed.shape == (96, 64, 3)
    assert displayed[:, :12].mean() > 200
    assert displayed[:, 20:].mean() < 40


def test_damaged_videos_are_refused(tmp_path: Path, make: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 255, (64, 96, 3), dtype=np.uint8) for _ in range(40)]
    good = make.video(tmp_path / "good.mp4", frames, options={"crf": "20"})
    data = good.read_bytes()
    moov_last = tmp_path / "cut.mp4"
    moov_last.write_bytes(data[: len(data) // 2])
    with refuses("footage.video_unreadable", file=moov_last):
        VideoReader(moov_last)
    text = tmp_path / "text.mp4"
    text.write_text("not a video")
    with refuses("footage.video_unreadable", file=text) as caught:
        VideoReader(text)
    assert str(caught.value) == (
        f"{text}: cannot open the file: it is truncated or not a video. Copy or encode the video again."
    )
    with refuses("footage.video_missing", file=tmp_path / "none.mp4"):
        VideoReader(tmp_path / "none.mp4")
    fast = make.video(tmp_path / "f.mp4", frames, options={"crf": "20", "movflags": "faststart"})
    with refuses("footage.no_such_frame", file=fast, value=40, frame=40) as caught:
        VideoReader(fast).read(40)
    assert "frames 0 to 39" in str(caught.value)


def test_a_video_truncated_after_its_index_reports_where_it_ends(tmp_path: Path, make: SimpleNamespace) -> None:
    import av

    rng = np.random.default_rng(0)
    path = tmp_path / "fast.mp4"
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        for _ in range(40):
            image = rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    reader = VideoReader(path)
    assert reader.frame_count == 40

    def read_all() -> None:
        for index in range(40):
            reader.read(index)

    with pytest.raises(StudioError) as caught:
        read_all()
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


@pytest.mark.parametrize("name", ["http:a.mp4", "concat:a|b.mp4", "cam 1 %d é.mp4"])
def test_any_file_name_is_that_of_a_file(tmp_path: Path, make: SimpleNamespace, monkeypatch, name: str) -> None:
    made = make.video(tmp_path / "v.mp4", [make.numbered(index) for index in range(3)])
    made.rename(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert make.number_of(VideoReader(Path(name)).read(2)) == 2
