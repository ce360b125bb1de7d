import pytest

from studio.counts import cameras_listed, counted, listed, plural


@pytest.mark.parametrize(
    ("count", "words"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames"), (1200, "1,200 frames"), (1.5, "1.5 frames")]
)
def test_counts_carry_their_noun(count, words):
    assert counted(count, "frame") == words
    assert words.endswith(f" {plural('frame', count)}")


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a"], "camera 'a'"),
        (["a", "b"], "cameras 'a' and 'b'"),
        ("abcdef", "cameras 'a', 'b', 'c', 'd', 'e' and 'f'"),
        ("abcdefgh", "cameras 'a', 'b', 'c', 'd', 'e', 'f' and 2 more"),
    ],
)
def test_cameras_are_listed_with_their_noun(names, words):
    assert cameras_listed(names) == words


def test_a_list_ends_with_how_many_are_left_out():
    assert listed(["one", "two", "three"], most=2) == "one, two and 1 more"
