"""Files from outside of the program, and JSON and TOML, within bounds."""

import json
import os
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from v3studio.pipelines.config.loading import load_config
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.bounded_files import Bounds, TextError, check_value, parse_json, parse_toml, read_bounded
from v3studio.studio.calibration.manual.file import read_tie_points
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats
from v3studio.studio.yaml_text import parse_yaml

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


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a busy machine
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
    with pytest.raises(TextError) as yaml_error:
        parse_yaml(HOSTILE[name])
    assert max(len(str(each.value)) for each in (json_error, toml_error, yaml_error)) < 300
    with pytest.raises(TextError, match=r"^.{,300}$"):
        parse_yaml(f"*{'a' * 1000}")


def test_64_levels_are_read() -> None:
    text = "[" * 64 + "]" * 64
    assert parse_json(text) == json.loads(text)
    assert parse_yaml(text) == json.loads(text)


def test_aliases_count_each_time_they_are_used() -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    with pytest.raises(TextError, match="values"):
        parse_yaml("\n".join(lines))
    assert parse_yaml("\n".join(lines[:3]))["a1"][9] == [1] * 10


def test_aliases_may_not_nest_without_end() -> None:
    chain = "\n".join(["a0: &a0 [1]", *(f"a{n}: &a{n} [*a{n - 1}]" for n in range(1, 200))])
    with pytest.raises(TextError, match="deep"):
        parse_yaml(chain)
    loop: list[Any] = []
    loop.append(loop)
    with pytest.raises(TextError, match="deep"):
        check_value(loop)


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", b"\x80", b"", b"\0\0", b"{", b"nul", b'"\x01"'])
def test_what_is_not_json_is_refused(data: bytes) -> None:
    with pytest.raises(TextError):
        parse_json(data)


TERABYTE = 1 << 40


def test_what_has_no_size_takes_no_more_memory_than_it_has_bytes(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    assert read_bounded(tmp_path / "empty", 1 << 60) == b""
    os.mkfifo(tmp_path / "pipe")
    text = bytes(range(256)) * 10_000
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit((tmp_path / "pipe").write_bytes, text)
        assert read_bounded(tmp_path / "pipe", len(text)) == text
        writing.result()
    with pytest.raises(OSError, match="more than the 3,000,000 bytes"):
        read_bounded(Path("/dev/zero"), 3_000_000)


@pytest.mark.parametrize(
    ("name", "start", "read"),
    [
        ("settings.yaml", b"capture:", load_config),
        ("cameras.json", b"{", read_rig),
        ("calib.toml", b"x = 1", read_rig),
        ("calibration.csv", b"name,w", read_rig),
        ("tie_points.yaml", b"a:", read_tie_points),
        ("take.json", b"{", lambda path: Take.open(path.parent)),
        ("a.splat", b"", read_splats),
        ("a.spz", b"NGSP", read_splats),
        ("a.ply", b"ply\nformat ascii 1.0\n", read_splats),
        ("a.safetensors", b"\x02\0\0\0\0\0\0\0{}", read_frame),
    ],
)
def test_a_terabyte_is_refused(tmp_path: Path, name: str, start: bytes, read: Callable[[Path], object]) -> None:
    file = tmp_path / name
    file.write_bytes(start)
    os.truncate(file, TERABYTE)
    with pytest.raises(StudioError) as caught:
        read(file)
    assert name in str(caught.value)
    assert len(str(caught.value)) < 400
