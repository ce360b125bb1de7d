"""YAML: what plain values mean, errors with their line, and that what is written is read as the same."""

import datetime
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from v3studio.studio.bounded_files import TextError
from v3studio.studio.yaml_text import dump_with_comments, dump_yaml, parse_with_comments, parse_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("true", True), ("False", False), ("yes", "yes"), ("off", "off"), ("~", None), ("Null", None), ("", None),
        ("none", "none"), ("010", 10), ("0x1F", 31), ("1:30", "1:30"), (".5", 0.5), (".inf", math.inf),
        ("2026-01-02", datetime.date(2026, 1, 2)), ("1e3", 1000.0), ("1e-3", 0.001), ("+1E5", 1e5), ("1.5e3", 1500.0),
        ("5.0e-4", 5e-4), ("-3", -3), ("cam01", "cam01"), ("'010'", "010"), ('"yes"', "yes"),
    ],
)  # fmt: skip
def test_what_plain_values_mean(text: str, value: object) -> None:
    for found in (parse_yaml(text), (parse_yaml(f"a: {text}") or {})["a"], parse_yaml(f"[{text or '~'}]")[0]):
        assert found == value
        assert type(found) is type(value)


def test_a_value_belongs_to_who_parsed_it() -> None:
    parse_yaml("a: {b: []}")["a"]["b"].append(1)
    assert parse_yaml("a: {b: []}") == {"a": {"b": []}}


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("a: 1\nb: [1\n", 3, "expected ',' or ']', but got '<stream end>'"),
        ("a:\n b: 1\n  c: 2\n", 3, "mapping values are not allowed here"),
        ("a: *x\n", 1, "found undefined alias 'x'"),
        ("a: 1\n---\nb: 2\n", 2, "but found another document"),
        ("a: 1\nb: 2026-02-30\n", 2, "'2026-02-30' is not a valid value"),
        ("\n\na: !!int x\n", 3, "'x' is not a valid value"),
        ("a: !!bool 3\n", 1, "'3' is not a valid value"),
        ("a: !thing 3\n", 1, "could not determine a constructor for the tag '!thing'"),
        ("a: 1\nb: {c: 1, c: 2}\n", 2, "duplicate key 'c'"),
        ("a: \x07\n", None, "special characters are not allowed"),
    ],
)
def test_errors_name_the_line(text: str, line: int | None, problem: str) -> None:
    with pytest.raises(TextError) as caught:
        parse_yaml(text)
    assert caught.value.line == line
    assert problem in str(caught.value)


def test_every_value_as_text() -> None:
    assert parse_yaml("01: {a: yes, b: [1.50, ~]}", plain=True) == {"01": {"a": "yes", "b": ["1.50", "~"]}}
    with pytest.raises(TextError) as caught:
        parse_yaml("points:\n  a: 1\n  b: 2\n  a: 3\n", plain=True)
    assert (str(caught.value), caught.value.line) == ("line 4: duplicate key 'a'", 4)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]))
    | st.sampled_from(["yes", "n", "on", "010", "1:30", "1e3", "~", "", "2026-01-02", "=", "<<", "a: b", "- x", "? x"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abyn1:é ", max_size=4), inner, max_size=3),
    max_leaves=8,
)  # fmt: skip


@given(JSON, st.sampled_from([False, True, None]))
@example(["?0", ":0", {"?0": ":0"}], True)
def test_what_is_written_is_read_as_the_same(value: object, flow: bool | None) -> None:
    assert parse_yaml(dump_yaml(value, flow=flow)) == value


def test_comments_and_quotes_stay() -> None:
    text = "# head\na: 'x'  # why\nb: [1, 2]\n\nc:\n  d: 010  # ten\n  e: on\n"
    tree = parse_with_comments(text)
    tree["a"] = "off"
    tree["b"][0] = 7
    found = dump_with_comments(tree)
    assert parse_yaml(found) == {"a": "off", "b": [7, 2], "c": {"d": 10, "e": "on"}}
    assert "# head" in found
    assert "# why" in found
    assert "# ten" in found
