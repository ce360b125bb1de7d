import numpy as np

from v3studio.gui.pages.review.numbers import fields_of, with_numbers
from v3studio.studio.edits import EditList, Floaters, World


def test_numbers_in_fields_say_what_is_there_and_set_it() -> None:
    up = np.array([0.0, 0.0, 1.0])
    edits = EditList(world=World(up=(0, 0, 1), origin=(0, 0, 1), scale=2))
    for kind, texts in (
        ("crop", {"low": "-1 0 -1", "high": "1 3.5 1"}),
        ("ground", {"height": "0.25"}),
        ("floaters", {"opacity": "0.05", "share": "", "splats": "20", "distance": "0.1"}),
        ("world", {"up": "0 0 1", "origin": "0 1 0", "scale": "3"}),
    ):
        new = with_numbers(edits, kind, texts, up)
        assert isinstance(new, EditList)
        assert {key: text for key, _, text in fields_of(new, kind, up)} == texts
        assert with_numbers(new, kind, dict.fromkeys(texts, ""), up).model_dump()[kind] is None
    box = with_numbers(edits, "crop", {"low": "-1 0 -1", "high": "1 3.5 1"}, up).crop
    assert box.holds(np.array([[0, 0, 1.1], [0, 0, 2.7], [0, 0, 2.8]])).tolist() == [True, True, False]
    assert with_numbers(edits, "floaters", {"splats": "20"}, up).floaters == Floaters(splats=20)
    for kind, texts in (
        ("crop", {"low": "1 2", "high": "1 2 3"}),
        ("crop", {"low": "1 2 3", "high": "0 0 0"}),
        ("ground", {"height": "x"}),
        ("floaters", {"share": "2"}),
        ("world", {"up": "", "origin": "", "scale": "-1"}),
    ):
        words = with_numbers(edits, kind, texts, up)
        assert isinstance(words, str)
        assert words.endswith(".")
