"""Figures of a span of frames."""

from gui.models.playback.span import span_rows


def test_figures_are_those_of_the_frames() -> None:
    psnr = [30.0, 31.5, None, 29.0, 35.0]
    series = {
        "psnr_decoded": psnr,
        "bytes": [1000.0, 2000.0, 3000.0, None, 5000.0],
        "flicker": [None, 1.0, 3.0, 5.0, 0.0],
    }
    other = {"psnr_decoded": [0.0, 28.0, 30.5, 29.25], "bytes": [0.0, 4000.0]}
    assert dict(span_rows(series, 1, 3, other)) == {
        "PSNR, mean": "30.25 / 29.25 dB",
        "lowest, frame 3": "29.00 / 28.00 dB",
        "size": "5.0 / 4.0 KB",
        "flicker": "3.00 / - /255",
    }
    assert dict(span_rows(series, 1, 3))["size"] == "5.0 KB"
    assert span_rows({}, 1, 3) == []
