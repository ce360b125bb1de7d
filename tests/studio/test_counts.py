import pytest

from studio.counts import counted, plural


@pytest.mark.parametrize(
    ("count", "words"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames"), (1200, "1,200 frames"), (1.5, "1.5 frames")]
)
def test_counts_carry_their_noun(count, words):
    assert counted(count, "frame") == words
    assert words.endswith(f" {plural('frame', count)}")
