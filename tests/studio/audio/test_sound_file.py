"""Sound as recorders write it."""

from pathlib import Path

import av
import numpy as np
import pytest

from v3studio.studio.audio import SoundFile


@pytest.mark.parametrize("count", [2, 4])
def test_several_mono_streams_are_left_and_right(tmp_path: Path, count: int) -> None:
    path, samples = tmp_path / "a.mov", 48_000
    with av.open(str(path), "w") as out:
        streams = [out.add_stream("pcm_s16le", rate=samples, layout="mono") for _ in range(count)]
        for number, stream in enumerate(streams):
            values = np.full((1, samples), 4000 * (number + 1), np.int16)
            frame = av.AudioFrame.from_ndarray(values, format="s16", layout="mono")
            frame.sample_rate = samples
            out.mux(stream.encode(frame))
            out.mux(stream.encode(None))
    sound = SoundFile(path)
    assert sound.channels == 2
    read = np.concatenate([block for _, block in sound.blocks()])
    assert read.shape == (samples, 2)
    np.testing.assert_allclose(read[1000:-1000], [[4000 / 32768, 8000 / 32768]] * (samples - 2000), atol=1e-4)
