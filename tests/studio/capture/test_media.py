"""Which stream of a file is the footage, and alpha stored beside the frames."""

from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from av.stream import Disposition

from v3studio.studio.audio.sound_file import SoundFile
from v3studio.studio.capture.timecode import read_timecode
from v3studio.studio.capture.video import VideoReader

Streams = list[tuple[tuple[int, int], int, Disposition]]

FILM = (96, 64)
PREVIEW = ((48, 32), 12, Disposition(0))
COVER = ((256, 256), 1, Disposition.attached_pic)


def write_streams(path: Path, make: SimpleNamespace, streams: Streams, start: int = 0) -> Path:
    """Streams of a size, a number of frames (1: JPEG) and a disposition; frame k of the largest shows number k."""
    with av.open(str(path), "w") as container:
        made = []
        for size, count, disposition in streams:
            stream = container.add_stream("mjpeg" if count == 1 else "libx264", rate=25)
            stream.width, stream.height = size
            stream.pix_fmt, stream.disposition = "yuvj420p" if count == 1 else "yuv420p", disposition
            if size == FILM:
                stream.metadata["timecode"] = "01:00:00:00"
            made.append((stream, count))
        sound = container.add_stream("pcm_s16le", rate=48000, layout="mono") if start else None
        if sound is not None:
            samples = av.AudioFrame.from_ndarray(np.zeros((1, 48000), np.int16), "s16", "mono")
            samples.sample_rate, samples.pts = 48000, 0
            container.mux(sound.encode(samples))
        for index in range(12):
            for stream, count in made:
                if index < count:
                    number = index if (stream.width, stream.height) == FILM else 255
                    image = make.numbered(number, stream.width, stream.height)
                    frame = av.VideoFrame.from_ndarray(image, "rgb24").reformat(format=stream.pix_fmt)
                    frame.pts = index + (start if (stream.width, stream.height) == FILM else 0)
                    container.mux(stream.encode(frame))
        for stream, _ in made:
            container.mux(stream.encode())
    return path


@pytest.mark.parametrize("extension", ["mp4", "mkv", "mov"])
@pytest.mark.parametrize(
    ("others", "film_first"),
    [([PREVIEW], True), ([PREVIEW], False), ([COVER], True), ([COVER], False), ([COVER, PREVIEW], False)],
)
def test_footage_is_neither_cover_art_nor_a_preview(
    tmp_path: Path, make: SimpleNamespace, extension: str, others: Streams, film_first: bool
) -> None:
    film = [(FILM, 12, Disposition(0))]
    path = write_streams(tmp_path / f"a.{extension}", make, film + others if film_first else others + film)
    reader = VideoReader(path)
    assert (reader.width, reader.height, reader.frame_count) == (*FILM, 12)
    assert [make.number_of(reader.read(index)) for index in (11, 0, 5)] == [11, 0, 5]
    assert reader.note == "" or "96x64" in reader.note  # MOV files have no cover art


def test_a_later_stream_marked_as_default_is_the_footage(tmp_path: Path, make: SimpleNamespace) -> None:
    streams = [((192, 128), 12, Disposition(0)), (FILM, 12, Disposition.default)]
    assert VideoReader(write_streams(tmp_path / "a.mkv", make, streams)).width == FILM[0]


def test_sound_and_timecode_refer_to_the_footage(tmp_path: Path, make: SimpleNamespace) -> None:
    path = write_streams(tmp_path / "a.mkv", make, [COVER, PREVIEW, (FILM, 12, Disposition(0))], start=5)
    assert read_timecode(path).frames == 25 * 3600
    first, _ = next(SoundFile(path).blocks())
    assert first == pytest.approx(-48000 * 5 / 25, abs=100)  # the film begins five frames after the sound


@pytest.mark.parametrize(("codec", "options"), [("libvpx", {"auto-alt-ref": "0"}), ("libvpx-vp9", {})])
def test_alpha_of_webm(tmp_path: Path, make: SimpleNamespace, codec: str, options: dict[str, str]) -> None:
    images = []
    for index in range(12):
        alpha = np.zeros((64, 96), np.uint8)
        alpha[:, : 8 * (index + 1)] = 255
        images.append(np.dstack([make.numbered(index), alpha]))
    options = {"g": "4", "crf": "8", **options}
    path = make.video(tmp_path / "a.webm", images, codec=codec, pixels="yuva420p", options=options, source="rgba")
    reader = VideoReader(path)
    assert reader.has_alpha
    for index in (0, 11, 3, 9, 1):
        image = reader.read(index)
        assert make.number_of(image) == index
        assert abs(int((image[32, :, 3] > 127).sum()) - 8 * (index + 1)) <= 1
