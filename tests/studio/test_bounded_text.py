"""Texts that parsers choke on are refused with a clause; every other one is read as by the standard library."""

from __future__ import annotations

import json
import tomllib
import tracemalloc
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from studio.bounded_text import Bounds, TextError, check_value, parse_json, parse_toml
from studio.yaml_text import YamlError, parse_yaml

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**40) + 1, 10**40 - 1) | st.floats(allow_nan=False) | st.text(),
    lambda children: st.lists(children) | st.dictionaries(st.text(), children),
    max_leaves=20,
)
HOSTILE = {
    "deep list": "[" * 100_000 + "]" * 100_000,
    "deep object": '{"a":' * 5000 + "1" + "}" * 5000,
    "a little too deep": "[" * 65 + "]" * 65,
    "long integer": '{"a": ' + "9" * 5000 + "}",
    "long negative integer": "[-" + "9" * 41 + "]",
    "many values": "[" + "[]," * 300_000 + "1]",
    "unclosed": "[" * 100_000,
}


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a busy machine
@given(VALUES)
def test_json_is_read_as_the_standard_library_reads_it(value: Any) -> None:
    text = json.dumps(value)
    assert parse_json(text) == json.loads(text)
    assert parse_json(text.encode("utf-16")) == json.loads(text)


def test_toml_is_read_as_the_standard_library_reads_it() -> None:
    text = 'size = [1, 2.5]\n[cam.1]\nname = "é"\nday = 2026-01-02\n'
    assert parse_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_refused_briefly(name: str) -> None:
    bounds = Bounds(values=200_000)
    with pytest.raises(TextError) as json_error:
        parse_json(HOSTILE[name], bounds)
    with pytest.raises(TextError) as toml_error:
        parse_toml(f"a = {HOSTILE[name].replace(':', '=')}", bounds)
    with pytest.raises(YamlError) as yaml_error:
        parse_yaml(HOSTILE[name])
    assert max(len(str(each.value)) for each in (json_error, toml_error, yaml_error)) < 300


def test_64_levels_are_read() -> None:
    text = "[" * 64 + "]" * 64
    assert parse_json(text) == json.loads(text)
    assert parse_yaml(text) == json.loads(text)


def test_many_values_are_refused_before_they_take_memory() -> None:
    text = b"[" + b"[]," * 5_000_000 + b"1]"
    tracemalloc.start()
    try:
        with pytest.raises(TextError, match="values"):
            parse_json(text)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_aliases_count_each_time_they_are_used() -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    with pytest.raises(YamlError, match="values"):
        parse_yaml("\n".join(lines))
    assert parse_yaml("\n".join(lines[:3]))["a1"][9] == [1] * 10


def test_aliases_may_not_nest_without_end() -> None:
    chain = "\n".join(["a0: &a0 [1]", *(f"a{n}: &a{n} [*a{n - 1}]" for n in range(1, 200))])
    with pytest.raises(YamlError, match="deep"):
        parse_yaml(chain)
    loop: list[Any] = []
    loop.append(loop)
    with pytest.raises(TextError, match="deep"):
        check_value(loop)


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", b"\x80", b"", b"\0\0", b"{", b"nul", b'"\x01"'])
def test_what_is_not_json_is_refused(data: bytes) -> None:
    with pytest.raises(TextError):
        parse_json(data)
